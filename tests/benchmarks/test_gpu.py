"""Speed of the optimum for H in compute shaders: polygons a second.

Run with `DEVICE=gpu0 python -m pytest tests/benchmarks/test_gpu.py --benchmark-enable -s`; by
default on llvmpipe, with fewer polygons. Transfers and all that is done around them
are counted.
"""

import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from scenes import load
from triangulators import Ragged, triangulate_many
from triangulators.devices import is_software
from triangulators.gpu import engine
from triangulators.gpu.rings import MOST, Rings, place, prepare
from triangulators.ragged import Batch, ragged

DEVICE = os.environ.get("DEVICE", "llvmpipe")

WANTED = {"footprints_s_a_million": 0.1}
"""What a GPU is meant to reach; written beside what it does, not asserted."""


@pytest.fixture(scope="module")
def software() -> bool:
    renderer, version = engine.describe(DEVICE)
    print(f"\n{DEVICE}: {renderer}, {version}")
    return is_software(renderer)


@pytest.fixture(scope="module")
def footprints(software: bool) -> Ragged:
    arrays = ragged(load("city", buildings=100_000).polygons)
    points = np.round((arrays.coordinates + 6000) * 256) / 256
    return repeated(Ragged(points, *arrays[1:]), 1 if software else 10)


def repeated(arrays: Ragged, times: int) -> Ragged:
    def ends(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values + k * values[-1] for k in range(times)])

    return Ragged(
        np.tile(arrays.coordinates, (times, 1)), ends(arrays.ring_ends), ends(arrays.polygon_ends)
    )


def least(call: Callable[[], Any], rounds: int) -> float:
    call()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def both(benchmark: Any, arrays: Ragged, rounds: int) -> tuple[float, float]:
    """Return the least seconds on the device and on the CPU; the results must be the same."""

    def on(device: str) -> Any:
        return triangulate_many(arrays, device=device)

    assert np.array_equal(on(DEVICE).triangles, on("cpu").triangles)
    device_s, cpu_s = (least(lambda d=d: on(d), rounds) for d in (DEVICE, "cpu"))
    assert not engine._said
    benchmark.extra_info.update(
        device=DEVICE, renderer=engine.describe(DEVICE)[0], device_s=device_s, cpu_s=cpu_s
    )
    benchmark.pedantic(lambda: on(DEVICE), rounds=1)
    return device_s, cpu_s


def test_footprints(benchmark, footprints):
    count = len(footprints.polygon_ends)
    device_s, cpu_s = both(benchmark, footprints, 3)
    million = device_s * 1e6 / count
    benchmark.extra_info.update(
        polygons=count,
        polygons_a_second=count / device_s,
        footprints_s_a_million=million,
        wanted=WANTED["footprints_s_a_million"],
    )
    print(
        f"\n{count:,} footprints: {count / device_s:,.0f} a second on {DEVICE}, "
        f"{count / cpu_s:,.0f} on the CPU; a million in {million:.3f} s, wanted on a GPU "
        f"{WANTED['footprints_s_a_million']} s"
    )


def test_what_the_host_does_of_footprints(benchmark, footprints):
    """Preparing and placing, in one thread: what no device takes over."""
    ends = footprints.ring_ends[footprints.polygon_ends - 1]
    begins = np.r_[0, ends].astype(np.int64)
    wanted = np.diff(np.r_[0, footprints.polygon_ends]) == 1
    rings = Rings.of(begins)
    coordinates = np.ascontiguousarray(footprints.coordinates)
    count = len(wanted)

    def prepared() -> None:
        prepare(coordinates, wanted, MOST, rings)

    preparing_s = least(prepared, 5)
    which = np.flatnonzero(rings.kind >= 0)
    bases, starts = fans(rings, which)
    triangles, done = np.empty((starts[-1], 3), np.int32), np.zeros(count, bool)
    bounds = (np.r_[0, ends] for ends in (footprints.ring_ends, footprints.polygon_ends))
    work = Batch(coordinates, *bounds, begins, starts, triangles, done)
    placing_s = least(lambda: place(which, bases, False, rings, work), 5)
    benchmark.extra_info.update(preparing_s=preparing_s, placing_s=placing_s, polygons=len(which))
    benchmark.pedantic(prepared, rounds=1)
    each = 1e9 / len(which)
    print(
        f"\n{len(which):,} footprints in one thread: prepared in {preparing_s * each:.0f} ns each, "
        f"placed in {placing_s * each:.0f} ns each"
    )


def fans(rings: Rings, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what a device gives for the optimum, from the CPU's triangles; and `starts`."""
    sizes = np.diff(rings.begins)
    polygons = Ragged(rings.corners.astype(float), rings.begins[1:], np.arange(1, len(sizes) + 1))
    found = triangulate_many(polygons, device="cpu")
    bases = np.zeros(len(rings.corners), np.uint32)
    for index in which.tolist():
        begin, own = int(rings.begins[index]), np.sort(found[index], axis=1).astype(np.uint32)
        bases[begin + own[:, 1]] = own[:, 0] | own[:, 2] << 16
        corners = rings.corners[begin : begin + sizes[index]].astype(np.int64)
        inner = (own[:, 2] - own[:, 0]) < sizes[index] - 1
        lengths = np.abs(corners[own[:, 2]] - corners[own[:, 0]]).sum(axis=1)
        bases[begin] = lengths[inner].sum()
    return bases, np.r_[0, np.cumsum(np.maximum(sizes - 2, 0))]
