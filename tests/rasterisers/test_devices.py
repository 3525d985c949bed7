"""Other devices than llvmpipe, each in a process of its own.

Where one is not installed, the error that says how to install it is tested, and the test skipped.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from harness.errors import NoRasteriser
from harness.measuring import tasks
from harness.measuring.worker import Worker
from harness.rasterisers import Counters, Options, find_device, get, names
from harness.rasterisers.reference import SHADED, disagreements
from tests.rasterisers import pictures


def counted_elsewhere(rasteriser: str, name: str, cases: list, options: Options) -> list[Counters]:
    """Count each (frame, triangles) of `cases` in a process of the device's own."""
    device = find_device(rasteriser, name)
    with Worker(name, device.environment) as worker:
        return [
            worker.call(tasks.count, rasteriser, device, *case, options, timeout_s=120)
            for case in cases
        ]


def need(rasteriser: str, device: str) -> None:
    """Skip the test where the device is not installed; the error must say what to run."""
    if device not in [found.name for found in get(rasteriser).devices()]:
        with pytest.raises(NoRasteriser, match="apt-get install -y") as error:
            find_device(rasteriser, device)
        pytest.skip(str(error.value))


@pytest.mark.parametrize(("rasteriser", "device"), [("opengl", "zink"), ("osmesa", "osmesa")])
def test_counters_equal_the_reference_for_every_polygon(rasteriser, device, reference, scattered):
    need(rasteriser, device)
    cases = [
        scattered(seed=size + grid, size=size, number=100, grid=grid)
        for size in (64, 250, 1024)
        for grid in (1, 128)
    ]
    for (frame, triangles), drawn in zip(
        cases, counted_elsewhere(rasteriser, device, cases, Options()), strict=True
    ):
        exact = reference.count(frame, triangles, Options())
        assert set(drawn) >= set(SHADED)
        assert disagreements(frame, drawn, exact) == []
        assert drawn["samples_passed"] == exact["fragments"].sum()


def test_what_counts_quads_counts_partial_ones():
    of_quads = [name for name in names() if "quads" in get(name).counters]
    assert {"opengl", "osmesa", "webgpu", "reference", "simulated"} <= set(of_quads)
    assert all(set(get(name).counters) >= set(SHADED) for name in of_quads)


def test_zink_tests_the_bounding_box_as_predicted(reference, scattered):
    need("bounding-box", "zink")
    cases = [scattered(seed=5, size=300, number=50, grid=grid) for grid in (1, 128)]
    for (frame, triangles), drawn in zip(
        cases, counted_elsewhere("bounding-box", "zink", cases, Options()), strict=True
    ):
        exact = reference.count(frame, triangles, Options())
        assert np.array_equal(drawn["bbox_tests"], exact["bbox_tests"])
        assert np.array_equal(drawn["hits"], exact["fragments"])


TOLD = re.compile(r"(\w+) differ in \d+ of \d+ polygons; polygon (\d+): (\d+) instead of (\d+)")


def test_softpipe_counts_consistently_and_what_differs_is_named(reference, scattered):
    """Softpipe rounds edges in floating point: some pixels on an edge fall to the other side."""
    case = scattered(seed=6, size=128, number=60, grid=128)
    (drawn,) = counted_elsewhere("opengl", "softpipe", [case], Options())
    assert np.array_equal(4 * drawn["quads"], drawn["fragments"] + drawn["helper_lanes"])
    frame, triangles = case
    exact = reference.count(frame, triangles, Options())
    assert abs(drawn["fragments"] - exact["fragments"]).sum() < 0.01 * exact["fragments"].sum()
    for found in disagreements(frame, drawn, exact):
        name, polygon, count, expected = TOLD.fullmatch(found).groups()
        assert name in SHADED
        assert drawn[name][int(polygon)] == int(count) != int(expected)
        assert exact[name][int(polygon)] == int(expected)


def test_softpipe_counts_the_quads_of_its_own_pictures(scattered):
    device = find_device("opengl", "softpipe")
    frame, triangles = scattered(seed=7, size=64, number=12, grid=1)
    with Worker("softpipe", device.environment) as worker:
        for number, triangle in enumerate(triangles):
            case = ("opengl", device, frame, triangle[None], Options())
            drawn = worker.call(tasks.count, *case, timeout_s=120)
            picture = worker.call(pictures.image, *case, timeout_s=120)[::-1, :, 3] > 0
            lanes = picture.reshape(32, 2, 32, 2).sum(axis=(1, 3))
            counted = [drawn[name][number] for name in SHADED]
            quads, partial = (lanes > 0).sum(), ((lanes > 0) & (lanes < 4)).sum()
            assert counted == [lanes.sum(), quads, 4 * quads - lanes.sum(), partial]


def test_a_device_in_the_wrong_environment_is_refused():
    device = find_device("opengl", "softpipe")
    with pytest.raises(NoRasteriser, match=r"softpipe needs \w+=\w+ before"):
        get("opengl")(device)


def test_disagreements_name_counter_and_polygon(loose):
    frame, _ = loose([[0, 0], [512, 0], [0, 512]] * 3, 8)
    expected = {"fragments": np.array([1, 2, 3]), "blocks": np.array([1, 1, 1])}
    drawn = {"fragments": np.array([1, 5, 4]), "samples_passed": np.array(10)}
    (found,) = disagreements(frame, drawn, expected)
    assert found == "fragments differ in 2 of 3 polygons; polygon 1: 5 instead of 2"
