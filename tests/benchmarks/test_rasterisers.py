"""Speed of the reference, and exact counters of all devices on all scenes: `make bench`.

The scenes are city, Helsinki, glyphs and 1,000 random polygons with vertices on pixel centres, at
256, 1024 and 4096 px. Differences from the reference are reported with the polygon.
"""

from functools import cache

import numpy as np
import pytest
import shapely
from shapely import Polygon

import scenes
from harness.frame import Frame, View, make_bare_frame, make_frame
from harness.grid import SUBPIXEL, to_grid
from harness.rasterisers import Options, Triangles, find_device, get
from harness.rasterisers.reference import count_per_triangle
from tests.rasterisers.conftest import require_reference_counts
from triangulators import triangulate

SIZES = (256, 1024, 4096)
SCENES = ("city", "helsinki", "glyphs", "pixel centres")
TRIANGULATORS = ("delaunay", "ear-clipping")
RANDOM_POLYGONS = 1000
REFERENCE = get("reference")(find_device("reference"))
SIDE = 32
"""Random polygons fill a grid of SIDE x SIDE cells."""


@pytest.mark.parametrize("side", [20, 100, 1000])
def test_reference_fills_100_million_bounding_box_pixels_a_second(benchmark, side):
    rng = np.random.default_rng(side)
    number = 2_000_000 // side**2 + 500
    low = rng.integers(1, 1024 - side, (number, 1, 2))
    points = low * SUBPIXEL + rng.integers(0, side * SUBPIXEL, (number, 3, 2))
    frame = make_bare_frame(1024, points.reshape(-1, 2).astype(np.int32), 3)
    triangles = np.arange(len(frame.points), dtype=np.int32).reshape(-1, 3)
    tests = int(count_per_triangle(frame.points, triangles)["bbox_tests"].sum())
    with REFERENCE.prepare(frame, triangles, Options()) as drawing:
        benchmark(drawing.sample, 1)
        seconds = min(drawing.sample(1).wall for _ in range(5))
    benchmark.extra_info["bbox_pixels_per_s"] = tests / seconds
    print(f"\n{side:5} px: {tests / seconds / 1e6:,.0f} million bounding-box pixels a second")
    assert tests / seconds >= 100e6


def make_pixel_centre_frame(size: int) -> Frame:
    """Return random simple polygons with vertices, and often edges, on pixel centres."""
    rng = np.random.default_rng(size)
    cell = size // SIDE
    polygons: list[Polygon] = []
    while len(polygons) < RANDOM_POLYGONS:
        number = int(rng.integers(3, 12))
        angle = np.sort(rng.uniform(0, 2 * np.pi, number))
        radius = rng.uniform(0.2, 0.48, number) * cell
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius[:, None] + cell / 2
        centres = np.clip(np.floor(ring), 0, cell - 1) + 0.5
        centres = centres[(centres != np.roll(centres, 1, axis=0)).any(axis=1)]
        if len(centres) < 3:
            continue
        polygon = Polygon(centres + np.array(divmod(len(polygons), SIDE)) * cell)
        if polygon.is_valid and polygon.area > 0:
            polygons.append(shapely.orient_polygons(polygon))
    numbers = np.arange(len(polygons))
    return Frame(size, size, 1.0, View(size), numbers, to_grid(polygons))


DEVICES = [
    *(("opengl", "llvmpipe"), ("opengl", "zink"), ("osmesa", "osmesa")),
    *((walker, name) for walker in ("bounding-box", "scanline") for name in ("llvmpipe", "zink")),
]


@cache
def make_case(scene: str, size: int) -> tuple[Frame, list[Triangles]]:
    if scene == "pixel centres":
        frame = make_pixel_centre_frame(size)
    else:
        frame = make_frame(scenes.load(scene).polygons, View(size))
    return frame, [
        frame.join_triangles([triangulate(polygon, name) for polygon in frame.polygons])
        for name in TRIANGULATORS
    ]


@pytest.mark.parametrize("on_device", DEVICES, indirect=True, ids="-".join)
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("size", SIZES)
def test_counters_equal_the_reference_for_every_polygon(on_device, size, scene):
    frame, triangulations = make_case(scene, size)
    for triangles in triangulations:
        require_reference_counts(on_device, REFERENCE, frame, triangles)
