"""Vertex batches: hand-counted index buffers, limits, and an independent analyzer."""

import platform

import numpy as np
import pytest

from harness.frame import make_scene_frame
from harness.rasterisers import Options
from harness.rasterisers.base import ORDERS, order_submission
from harness.rasterisers.vertex_batches import (
    AMD,
    NVIDIA,
    UNLIMITED,
    VertexReuse,
    count_batches,
    make_fifo_cache,
)
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons
from scenes import load
from tests.measuring.test_run import MOCK, make_plan, measure
from tests.mock import MockRasteriser
from triangulators.geometry.order import sort_for_vertex_cache


def fan(size: int) -> np.ndarray:
    """Return triangles (size, 3) around vertex 0, over size + 2 vertices."""
    second = np.arange(1, size + 1, dtype=np.int32)
    return np.stack([np.zeros_like(second), second, second + 1], axis=1)


@pytest.mark.parametrize(
    ("triangles", "reuse", "expected"),
    [
        (fan(0), NVIDIA, (0, 0)),
        (fan(1), NVIDIA, (1, 3)),
        (fan(30), NVIDIA, (1, 32)),  # 32 vertices fill a batch
        (fan(31), NVIDIA, (2, 32 + 3)),
        (fan(61), NVIDIA, (3, 32 + 32 + 3)),
        (np.tile(fan(1), (32, 1)), NVIDIA, (1, 3)),
        (np.tile(fan(1), (33, 1)), NVIDIA, (2, 3 + 3)),
        (fan(7), VertexReuse(5, 32), (3, 5 + 5 + 3)),
        (fan(7), VertexReuse(32, 3), (3, 5 + 5 + 3)),
        # A cache of 4 vertices loses the fan's centre, which triangles 1, 4 and 8 load again.
        (fan(11), make_fifo_cache(4), (1, 12 + 3)),
        (fan(11), VertexReuse(UNLIMITED, UNLIMITED), (1, 13)),
    ],
)
def test_index_buffers_counted_by_hand(triangles, reuse, expected):
    assert count_batches(triangles, *reuse) == expected
    shifted = triangles + np.int32(10**8)  # no array of that size is needed
    assert count_batches(shifted, *reuse) == expected


@pytest.mark.parametrize("reuse", [(2, 32, 32), (32, 0, 32), (32, 32, 2)])
def test_limits_below_one_triangle_are_refused(reuse):
    with pytest.raises(ValueError, match="out of range"):
        count_batches(fan(3), *reuse)


def index_buffers(count: int) -> list[np.ndarray]:
    """Return index buffers of meshes and of random triangles, in orders with and without reuse."""
    buffers = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        vertices, size = int(rng.integers(3, 300)), int(rng.integers(1, 600))
        if seed % 2:
            rows = np.array([rng.permutation(vertices)[:3] for _ in range(size)])
        else:  # triangles with near neighbours
            rows = (np.sort(rng.integers(0, vertices, size))[:, None] + [0, 1, 2]) % vertices
        buffers.append(rows.astype(np.int32))
        if seed % 4 == 0:
            buffers[-1] = sort_for_vertex_cache(buffers[-1], vertices, int(rng.integers(4, 33)))
    return buffers


@pytest.mark.skipif(
    (platform.system(), platform.machine()) != ("Linux", "x86_64"),
    reason="almeshopt, a binding of meshoptimizer, is installed on Linux on x86-64 only",
)
def test_meshoptimizer_counts_the_same():
    from almeshopt import analyze_vertex_cache

    models = {
        (32, 32, 32): NVIDIA,
        (14, 64, 128): AMD,
        (16, 0, 0): make_fifo_cache(16),
        (5, 8, 3): VertexReuse(8, 3, 5),
    }
    buffers = index_buffers(1000)
    for parameters, reuse in models.items():
        for triangles in buffers:
            indices = triangles.ravel().astype(np.uint32)
            result = analyze_vertex_cache(indices, int(indices.max()) + 1, *parameters)
            expected = result["warps_executed"], result["vertices_transformed"]
            assert count_batches(triangles, *reuse) == expected


def test_records_count_the_order_as_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(MockRasteriser, "draws_indexed", True)
    options = tuple(Options(order=order) for order in ORDERS)
    both = {"rasterisers": (MOCK, "binning"), "options": options}
    plan = make_plan("city:buildings=40", triangulators=("delaunay",), **both)
    outcome = measure(plan, tmp_path / "out")
    frame = make_scene_frame(load(plan.scene), plan.views[0])
    parts = triangulate_polygons(parse("delaunay"), frame.polygons).parts
    transformed = {}
    for record in outcome.records:
        names = {"vertex_batches", "transformed_vertices"} & {*record.counters}
        if record.id.rasteriser == "binning":
            assert not names
            continue
        drawn = order_submission(frame, frame.join_triangles(parts), record.id.options)
        counted = record.counters["vertex_batches"], record.counters["transformed_vertices"]
        assert counted == count_batches(drawn)
        transformed[record.id.options.order] = counted[1]
    assert transformed["walk"] < transformed["native"] < transformed["shuffled"]
