"""The optimum that a device's compute shaders find is the CPU's, triangle for triangle.

On llvmpipe, or on the device that DEVICE names. What it leaves to the CPU has holes, over 64
vertices or no grid.
"""

import os
from dataclasses import replace

import numpy as np
import pytest

from harness.frame import View, make_frame
from scenes import load
from tests.triangulators.test_gpu import NAME, WORST, assert_same
from triangulators.polygon_arrays import PolygonArray

DEVICE = os.environ.get("DEVICE", "llvmpipe")
VIEWS = (View(256), View(1024, 30.0), View(4096))
MIDDLE_M = 6000.0
"""Moves a city of the size below to where no coordinate is negative."""


@pytest.mark.parametrize(
    "scene", ["city", "helsinki", "cad", "glyphs", "counties", "meshes", "paper"]
)
@pytest.mark.parametrize("name", [NAME, WORST])
def test_scenes_in_pixels(scene, name, done, tell):
    for view in VIEWS:
        polygons = make_frame(load(scene).polygons, view).polygons
        assert_same(polygons, name, DEVICE)
        tell({"polygons": len(polygons)})
    assert sum(done) > 0
    tell({"of which the device did": sum(done)})


@pytest.mark.parametrize("seed", range(12))
def test_footprints_of_a_city(seed, done, times, tell):
    city = PolygonArray.from_shapely(load("city", buildings=times(100_000), seed=seed).polygons)
    points = np.round((city.coords + MIDDLE_M) * 256) / 256
    assert_same(replace(city, coords=points), NAME, DEVICE)
    assert sum(done) > 0
    tell({"polygons": len(city), "of which the device did": sum(done)})
