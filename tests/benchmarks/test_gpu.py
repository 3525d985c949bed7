"""Speed of the optimum for H in compute shaders: polygons a second.

Run with `DEVICE=gpu0 python -m pytest tests/benchmarks/test_gpu.py --benchmark-enable -s`; by
default on llvmpipe, with fewer polygons. Transfers and all that is done around them
are counted.
"""

import os
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scenes import load
from triangulators import PolygonArray, triangulate_many
from triangulators.devices import is_software
from triangulators.gpu import engine

DEVICE = os.environ.get("DEVICE", "llvmpipe")

WANTED = 0.1
"""Seconds for a million footprints on a GPU; written beside what it does, not asserted."""


@pytest.fixture(scope="module")
def software() -> bool:
    renderer, version = engine.describe(DEVICE)
    print(f"\n{DEVICE}: {renderer}, {version}")
    return is_software(renderer)


@pytest.fixture(scope="module")
def footprints(software: bool) -> PolygonArray:
    arrays = PolygonArray.from_shapely(load("city", buildings=100_000).polygons)
    snapped = replace(arrays, coords=np.round((arrays.coords + 6000) * 256) / 256)
    return PolygonArray.concatenate([snapped] * (1 if software else 10))


def least(call: Callable[[], Any], rounds: int) -> float:
    call()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def both(benchmark: Any, arrays: PolygonArray, rounds: int) -> tuple[float, float]:
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
    count = len(footprints)
    device_s, cpu_s = both(benchmark, footprints, 3)
    million = device_s * 1e6 / count
    benchmark.extra_info.update(
        polygons=count,
        polygons_a_second=count / device_s,
        footprints_s_a_million=million,
        wanted=WANTED,
    )
    print(
        f"\n{count:,} footprints: {count / device_s:,.0f} a second on {DEVICE}, "
        f"{count / cpu_s:,.0f} on the CPU; a million in {million:.3f} s, wanted on a GPU "
        f"{WANTED} s"
    )
