"""Equality of optima by all interfaces, and of flips in three languages."""

import os
from pathlib import Path

import numpy as np
import pytest
import shapely

from harness.frame import View, make_frame
from scenes import load
from tests.conftest import run_command, write_geojson
from tests.ports import languages
from tests.ports.languages import Cases, flip_in_python, read_flips
from tests.ports.polygons import Rings, earcut_rings, flatten_rings, is_equivalent, random_polygons
from tests.triangulators.cases import convex, read_rings, smooth, star, touching_polygons
from tests.triangulators.test_many import polygons as with_holes
from triangulators import triangulate, triangulate_many, vertices
from triangulators.criteria import FLIP_TESTS, find
from triangulators.dropin import triangulate_float64
from triangulators.optimum.full_table import solve_ring
from triangulators.verify import verify

CRITERIA = ("half-perimeter", "overdraw")
TOLERANCE = 1e-9  # relative difference of costs that are summed in another order
SCENES = (
    *("city", "helsinki", "counties", "counties:level=state", "glyphs", "cad", "paper"),
    *("stress", "meshes"),
)


def export(polygons: list[shapely.Polygon], name: str, folder: Path) -> dict[int, np.ndarray]:
    """Return the triangles written by the command line, by polygon number."""
    source, target = write_geojson(folder / "in.geojson", polygons), folder / "out.npz"
    arguments = ("triangulate", str(source), "-o", str(target), "--triangulator", name, "--quiet")
    assert run_command(*arguments) == 0
    with np.load(target) as arrays:
        corners, starts = arrays["vertex_offsets"], arrays["triangle_offsets"]
        triangles = {}
        for row, number in enumerate(arrays["attribute_id"].tolist()):
            indices = arrays["triangles"][starts[row] : starts[row + 1]] - corners[row]
            triangles[number] = indices.astype(np.int32)
    target.unlink()
    return triangles


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("kind", ["holes", "touching"])
def test_optimum_is_equal_by_all_interfaces(kind, seed, scale_count, report_counts, tmp_path):
    count = max(40, scale_count(2000 if kind == "holes" else 200))
    scale = (1.0, 0.1, 1 / 3)[seed % 3]
    shapes = with_holes(scale, count, seed) if kind == "holes" else touching_polygons(seed, count)
    # The reader orients rings this way, which determines the indices of vertices.
    polygons = list(shapely.orient_polygons(np.array(list(shapes))))
    for criterion in CRITERIA:
        name, total = f"optimal:{criterion}", find(criterion).total
        batch, files = triangulate_many(polygons, name), export(polygons, name, tmp_path)
        assert not batch.failed
        for number, polygon in enumerate(polygons):
            points, single = vertices(polygon), triangulate(polygon, name)
            results = {"single": single, "batch": batch[number], "file": files[number]}
            if criterion == "half-perimeter":
                flat = triangulate_float64(*earcut_rings(polygon), method="optimal:half-perimeter")
                results["drop-in"] = flat.reshape(-1, 3).astype(np.int32)
            optimum = total(points, single)
            for method, triangles in results.items():
                assert verify(polygon, triangles).conforming, (method, polygon.wkt)
                cost = total(points, triangles)
                assert abs(cost - optimum) <= TOLERANCE * abs(optimum), (method, polygon.wkt)
    report_counts({f"polygons, {kind}": len(polygons)})


@pytest.mark.parametrize("make", [star, smooth, convex])
@pytest.mark.parametrize("n", [500, 1000, 2000, 4000, 6000])
def test_large_rings_equal_the_full_table(n, make):
    polygon = shapely.Polygon(np.round(vertices(make(n)) * 256) / 256)
    if not polygon.is_valid:
        pytest.skip("invalid after rounding to 1/256")
    ring = np.ascontiguousarray(vertices(shapely.orient_polygons(polygon)))
    for criterion, weights in zip(CRITERIA, ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), strict=True):
        total = find(criterion).total
        table = np.empty((len(ring) - 2, 3), dtype=np.int32)
        solve_ring(ring, np.array(weights), table)
        optimum = total(ring, table)
        triangles = triangulate(polygon, f"optimal:{criterion}", limit=10_000)
        assert abs(total(vertices(polygon), triangles) - optimum) <= TOLERANCE * abs(optimum)


def load_rings(name: str) -> list[Rings]:
    """Return valid and invalid polygons of third-party data, or the polygons of a scene.

    Those are original, snapped to 1/256 px, and as integers of a tile.
    """
    if name.endswith(".json"):
        return [flatten_rings(rings) for _, rings in read_rings(name)]
    polygons = load(name).polygons
    pixels = [earcut_rings(polygon) for polygon in make_frame(polygons, View(1024)).polygons]
    tile = [
        (np.rint((xy - xy.min(axis=0)) * (4096.0 / max(np.ptp(xy, axis=0).max(), 1.0))), ends)
        for xy, ends in pixels
    ]
    return [*map(earcut_rings, polygons), *pixels, *tile]


@pytest.mark.parametrize(
    "source", [*SCENES, "earcut_fixtures.json", "poly2tri_testbed.json", *range(10)]
)
def test_flips_are_equal_in_three_languages(source, scale_count, report_counts, tmp_path):
    compilers = languages.find_compilers()
    if not (compilers and languages.find_node() and languages.find_earcut()):
        pytest.skip("needs Node.js, a C++ compiler and npm's earcut")
    if isinstance(source, int):
        polygons = list(random_polygons(source, scale_count(10_000)))
    else:
        polygons = load_rings(source)
    cases = Cases.of(polygons)
    cases.write(tmp_path)
    languages.flip_in_cpp(tmp_path, languages.compile_flips(tmp_path, compilers[0], "-O2"))
    languages.flip_in_javascript(tmp_path)
    for by in (*FLIP_TESTS, *languages.SCALED, "l1-native", "reorder", "earcut-refine"):
        corners, flips = flip_in_python(cases, by)
        assert is_equivalent(cases, corners), by
        for language in ("javascript",) if by == "earcut-refine" else ("javascript", "cpp"):
            assert np.array_equal(corners, read_flips(tmp_path, language, by)[0]), (language, by)
        report_counts({"polygons": len(polygons), "flips": int(flips.sum())})


def test_refine_equals_earcut_hpp(scale_count, report_counts, tmp_path):
    """The header is from the source package of mapbox_earcut 2.1.0."""
    header = os.environ.get("EARCUT_HPP", "")
    compilers = languages.find_compilers()
    if not (Path(header) / "mapbox" / "earcut.hpp").is_file() or not compilers:
        pytest.skip(
            "needs a C++ compiler and earcut.hpp: run pip download --no-deps --no-binary :all: "
            "mapbox_earcut==2.1.0, unpack it, and set EARCUT_HPP to its folder include"
        )
    polygons = list(random_polygons(0, scale_count(10_000)))
    for source in (*SCENES, "earcut_fixtures.json", "poly2tri_testbed.json"):
        polygons += load_rings(source)
    cases = Cases.of(polygons)
    cases.write(tmp_path)
    flags = ("-O2", "-isystem", header)
    languages.flip_in_cpp(tmp_path, languages.compile_flips(tmp_path, compilers[0], *flags))
    expected = np.fromfile(tmp_path / "cpp-earcut-refine.i32", dtype=np.int32)
    actual, flips = flip_in_python(cases, "earcut-refine")
    assert np.array_equal(actual, expected)
    # By::delaunay has a narrower margin for ties.
    port = read_flips(tmp_path, "cpp", "delaunay")[0]
    ends = zip(cases.bounds[:-1, 1], cases.bounds[1:, 1], strict=True)
    differ = sum(not np.array_equal(port[begin:end], expected[begin:end]) for begin, end in ends)
    counts = {"polygons": len(polygons), "flips": int(flips.sum())}
    report_counts({**counts, "By::delaunay differs": differ})
