"""The law of squares, and the count of them that needs no design."""

from __future__ import annotations

import numpy as np
import pytest

from harness.frame import WHOLE, View, frame_of
from harness.rasterisers import Options
from harness.rasterisers.reference import count_tiles
from scenes import load
from scripts.studies.skybox import descent
from tests.simulated.conftest import triangles_of
from tests.simulated.test_skybox import BUILDS
from triangulators import triangulate

DRAIN = 5
"""Most cycles from a draw's last square to the end of what follows, where nothing holds it up."""


@pytest.mark.parametrize(
    ("device", "tile", "block"), [*zip(BUILDS, (32, 64, 16), (4, 4, 8), strict=True)]
)
def test_the_descent_tests_the_squares_that_the_slice_tests(opened, device, tile, block):
    frame, triangles = triangles_of(128, 30, seed=6)
    drawn = opened(device).count(frame, triangles, Options())
    counts = descent(frame, triangles, tile, block)
    np.testing.assert_array_equal(counts[:, 0], drawn["nodes"])
    np.testing.assert_array_equal(counts[:, 1], drawn["tested_blocks"])


@pytest.mark.parametrize("scene", ["city:buildings=60", "glyphs:limit=20"])
@pytest.mark.parametrize("size", [256, 1024])
@pytest.mark.parametrize("name", ["ear-clipping", "optimal:half-perimeter"])
def test_squares_predict_the_cycles_of_a_scene_but_for_what_follows_the_last(
    opened, scene, size, name
):
    frame = frame_of(load(scene), View(size))
    base, _, criterion = name.partition(":")
    chosen = {"criterion": criterion} if criterion else {}
    triangles = frame.join([triangulate(p, base, **chosen) for p in frame.polygons])
    drawn = opened("skybox").count(frame, triangles, Options())
    assert 0 <= int(drawn["cycles"]) - descent(frame, triangles, 32, 4)[:, 2].sum() <= DRAIN


@pytest.mark.parametrize("side", [2, 4, 8, 16, 32])
def test_the_mean_number_of_squares_follows_half_perimeter_and_area(side):
    """Monte Carlo over positions: 1 + H / s + S / s^2, to three standard errors."""
    rng = np.random.default_rng(7)
    for _ in range(8):
        shape = rng.integers(-60 * 256, 60 * 256, (3, 2))
        (ax, ay), (bx, by) = shape[1] - shape[0], shape[2] - shape[0]
        doubled = int(ax * by - ay * bx)
        shape = shape if doubled > 0 else shape[::-1]
        moves = rng.integers(128 * 256, 256 * 256, (4000, 1, 2))
        points = (shape + moves).reshape(-1, 2).astype(np.int32)
        rows = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
        found = count_tiles(points, rows, side * 256, WHOLE)[:, 1]
        area = np.float64(abs(doubled) / 2 / 256**2)
        half_perimeter = np.float64(np.ptp(shape, axis=0).sum() / 256)
        mean = 1 + half_perimeter / side + area / side**2
        error = found.std() / np.sqrt(len(found))
        assert abs(found.mean() - mean) < 3.5 * error + 1e-9
