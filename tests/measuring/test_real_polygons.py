"""On a real OpenGL device: however a polygon is triangulated, it covers the same pixels."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
import pytest
from shapely import Polygon, make_valid

from harness import rasterisers
from harness.frame import View, make_frame
from harness.measuring import tasks
from harness.measuring.worker import Worker
from harness.rasterisers.base import Device, Options
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse
from scenes import load
from tests.paths import shared_data

TRIANGULATORS = ("fan", "ear-clipping", "delaunay", "optimal:overdraw", "optimal:half-perimeter")


@pytest.fixture(scope="module")
def llvmpipe() -> Iterator[tuple[Device, Worker]]:
    device = rasterisers.find_device("opengl", "llvmpipe")
    with Worker("llvmpipe", device.environment) as worker:
        yield device, worker


def helsinki() -> list[Polygon]:
    rings = [entry["rings"] for entry in json.loads(shared_data("helsinki.json").read_text())]
    polygons = [Polygon(each[0], each[1:]) for each in rings]
    mended = [polygon if polygon.is_valid else make_valid(polygon) for polygon in polygons]
    return [polygon for polygon in mended if isinstance(polygon, Polygon)]


def city() -> list[Polygon]:
    return load("city").polygons


@pytest.mark.parametrize("polygons", [city, helsinki])
@pytest.mark.parametrize("resolution", [256, 1024])
def test_every_triangulation_covers_the_same_pixels(llvmpipe, polygons, resolution):
    device, worker = llvmpipe
    frame = make_frame(polygons(), View(resolution))
    expected = None
    for name in TRIANGULATORS:
        result = triangulate_polygons(parse(name), frame.polygons)
        assert result.failed == []
        counted = worker.call(
            tasks.count, "opengl", device, frame, frame.join(result.parts), Options()
        )
        fragments, quads = counted["fragments"], counted["quads"]
        assert (4 * quads == fragments + counted["helper_lanes"]).all()
        conforming = np.array(
            [p is not None and not t for p, t in zip(result.parts, result.t_junctions, strict=True)]
        )
        if name != "fan":
            assert conforming.sum() > 0.98 * len(frame.polygons)
        if expected is None:
            expected = np.full(len(fragments), -1)
        known = conforming & (expected >= 0)
        assert (fragments[known] == expected[known]).all(), name
        expected = np.where(conforming & (expected < 0), fragments, expected)
    assert expected is not None
    assert (expected >= 0).all()
    assert expected.sum() > 0.05 * resolution**2
