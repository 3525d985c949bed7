"""Speed of H- and Q-optimal triangulation in compute shaders, in polygons per second.

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
from triangulators.criteria.criterion import FEATURES
from triangulators.criteria.features import sum_features_of_many
from triangulators.gpu import engine, is_software

DEVICE = os.environ.get("DEVICE", "llvmpipe")

QUADS = "optimal:expected-quads"
TARGET_S = 0.1
"""Target for a million footprints on a GPU; printed, not asserted."""


def read_renderer() -> str:
    opening = engine._get_context_thread().submit(engine._open_engine, DEVICE)
    return opening.result().compute.renderer


@pytest.fixture(scope="module")
def software() -> bool:
    renderer = read_renderer()
    print(f"\n{DEVICE}: {renderer}")
    return is_software(renderer)


def measure_min(call: Callable[[], Any], rounds: int) -> float:
    call()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def compare(benchmark: Any, arrays: PolygonArray, name: str, rounds: int) -> tuple[float, float]:
    """Return the minimum seconds on device and CPU; require equal triangles, or sums for Q."""

    def run(device: str) -> Any:
        return triangulate_many(arrays, name, device=device)

    by_device, expected = run(DEVICE), run("cpu")
    sums, sums_of_cpu = (
        sum_features_of_many(arrays.coords, arrays.vertex_offsets, t.triangles, t.triangle_offsets)
        for t in (by_device, expected)
    )
    feature = FEATURES.index(name.partition(":")[2].replace("-", "_"))
    np.testing.assert_allclose(sums[:, feature], sums_of_cpu[:, feature], rtol=1e-9)
    equal = np.array_equal(by_device.triangles, expected.triangles)
    assert equal or name == QUADS
    device_s, cpu_s = (measure_min(lambda d=d: run(d), rounds) for d in (DEVICE, "cpu"))
    assert not engine._warned
    benchmark.extra_info.update(
        device=DEVICE,
        renderer=read_renderer(),
        device_s=device_s,
        cpu_s=cpu_s,
        equal_triangles=equal,
    )
    benchmark.pedantic(lambda: run(DEVICE), rounds=1)
    return device_s, cpu_s


@pytest.mark.parametrize(
    ("name", "buildings", "copies_on_gpu", "rounds"),
    [("optimal:half-perimeter", 100_000, 10, 3), (QUADS, 10_000, 1, 1)],
)
def test_footprints(benchmark, software, name, buildings, copies_on_gpu, rounds):
    copies = 1 if software else copies_on_gpu
    arrays = PolygonArray.from_shapely(load("city", buildings=buildings).polygons)
    snapped = replace(arrays, coords=np.round((arrays.coords + 6000) * 256) / 256)
    footprints = PolygonArray.concatenate([snapped] * copies)
    count = len(footprints)
    device_s, cpu_s = compare(benchmark, footprints, name, rounds)
    benchmark.extra_info.update(polygons=count, polygons_per_s=count / device_s)
    print(
        f"\n{count:,} footprints, {name}: {count / device_s:,.0f} per second on {DEVICE}, "
        f"{count / cpu_s:,.0f} on the CPU; a million in {device_s * 1e6 / count:.3f} s "
        f"(target for H on a GPU {TARGET_S} s)"
    )
