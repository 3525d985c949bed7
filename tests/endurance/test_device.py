"""Optimal triangulations by a device's compute shaders equal those of the CPU.

The device is llvmpipe or that of the variable DEVICE. The CPU solves polygons with holes, more than
64 vertices or coordinates off the grid.
"""

import os
from dataclasses import replace

import numpy as np
import pytest

from harness.frame import View, make_frame
from scenes import load
from tests.triangulators.test_gpu import NAME, QUADS, WORST, assert_same
from triangulators import criteria, triangulate_many, vertices
from triangulators.polygon_arrays import PolygonArray

DEVICE = os.environ.get("DEVICE", "llvmpipe")
VIEWS = (View(256), View(1024, 30.0), View(4096))
OFFSET_M = 6000.0
"""Offset that makes the coordinates of a city of 100,000 buildings positive."""


@pytest.mark.parametrize(
    "scene", ["city", "helsinki", "cad", "glyphs", "counties", "meshes", "paper"]
)
@pytest.mark.parametrize("name", [NAME, WORST])
def test_scenes_in_pixels(scene, name, device_counts, report_counts):
    for view in VIEWS:
        polygons = make_frame(load(scene).polygons, view).polygons
        assert_same(polygons, name, DEVICE)
        report_counts({"polygons": len(polygons)})
    assert sum(device_counts) > 0
    report_counts({"solved by the device": sum(device_counts)})


@pytest.mark.parametrize("seed", range(12))
def test_footprints_of_a_city(seed, device_counts, scale_count, report_counts):
    city = PolygonArray.from_shapely(
        load("city", buildings=scale_count(100_000), seed=seed).polygons
    )
    points = np.round((city.coords + OFFSET_M) * 256) / 256
    assert_same(replace(city, coords=points), NAME, DEVICE)
    assert sum(device_counts) > 0
    report_counts({"polygons": len(city), "solved by the device": sum(device_counts)})


@pytest.mark.parametrize("seed", range(4))
def test_expected_quads_of_a_city(seed, device_counts, scale_count, report_counts):
    """A device may round a cost otherwise than the CPU, so the sums are compared, not triangles."""
    city = load("city", buildings=scale_count(20_000), seed=seed).polygons
    rings = [p for p in make_frame(city, View(1024)).polygons if not p.interiors]
    total = criteria.find("expected-quads").total
    by_device, by_cpu = (
        [total(vertices(ring), rows) for ring, rows in zip(rings, batch, strict=True)]
        for batch in (triangulate_many(rings, QUADS, device=device) for device in (DEVICE, "cpu"))
    )
    assert by_device == pytest.approx(by_cpu, rel=1e-9)
    report_counts({"polygons": len(rings), "solved by the device": sum(device_counts)})
    assert sum(device_counts) > 0.9 * len(rings)
