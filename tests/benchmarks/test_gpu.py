"""Speed of H-optimal triangulation in compute shaders, in polygons per second.

Run with `DEVICE=gpu0 python -m pytest tests/benchmarks/test_gpu.py --benchmark-enable -s`; the
default is llvmpipe, with fewer polygons. Times include transfers and preparation.
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

TARGET_S = 0.1
"""Target for a million footprints on a GPU; printed, not asserted."""


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


def measure_min(call: Callable[[], Any], rounds: int) -> float:
    call()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def compare(benchmark: Any, arrays: PolygonArray, rounds: int) -> tuple[float, float]:
    """Return the minimum seconds on the device and the CPU, and require equal results."""

    def run(device: str) -> Any:
        return triangulate_many(arrays, device=device)

    assert np.array_equal(run(DEVICE).triangles, run("cpu").triangles)
    device_s, cpu_s = (measure_min(lambda d=d: run(d), rounds) for d in (DEVICE, "cpu"))
    assert not engine._warned
    benchmark.extra_info.update(
        device=DEVICE, renderer=engine.describe(DEVICE)[0], device_s=device_s, cpu_s=cpu_s
    )
    benchmark.pedantic(lambda: run(DEVICE), rounds=1)
    return device_s, cpu_s


def test_footprints(benchmark, footprints):
    count = len(footprints)
    device_s, cpu_s = compare(benchmark, footprints, 3)
    seconds_per_million = device_s * 1e6 / count
    benchmark.extra_info.update(
        polygons=count,
        polygons_per_s=count / device_s,
        seconds_per_million=seconds_per_million,
        target_s=TARGET_S,
    )
    print(
        f"\n{count:,} footprints: {count / device_s:,.0f} per second on {DEVICE}, "
        f"{count / cpu_s:,.0f} on the CPU; a million in {seconds_per_million:.3f} s "
        f"(target on a GPU {TARGET_S} s)"
    )
