"""Vertex batches: how often the order of an index buffer makes a GPU transform a vertex.

A GPU transforms a vertex once in each batch that uses it. A batch ends before the triangle with
which it would transform more than `max_vertices` vertices, and after `max_triangles` triangles.
Source: B. Kerbl, M. Kenzel, E. Ivanchenko, D. Schmalstieg and M. Steinberger, "Revisiting The
Vertex Cache: Understanding and Optimizing Vertex Processing on the modern GPU", Proceedings of the
ACM on Computer Graphics and Interactive Techniques 1(2), 2018.

Some GPUs also lose vertices within a batch: a first-in first-out cache holds the last `cache_size`
transformed vertices. With `cache_size` alone this is the classical vertex cache, in one batch.

Let `time` be the number of vertices transformed so far, and `entered[v]` its value when vertex v
was last transformed. A batch that began at time s reuses v if entered[v] >= s and
time - entered[v] <= cache_size. So ending a batch is one assignment, s = time, and m triangles take
O(m). Invariant of the loop: the current batch has transformed time - s vertices.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from triangulators.compute.kernels import njit

UNLIMITED = 2**31 - 1  # a limit that no index buffer reaches


class VertexReuse(NamedTuple):
    """Vertex reuse of a GPU: maximum vertices and triangles of a batch, and size of the cache."""

    max_vertices: int = 32
    max_triangles: int = 32
    cache_size: int = UNLIMITED


NVIDIA = VertexReuse()  # measured by Kerbl et al. on a GTX 1080 Ti: batches of 96 indices

# Waves of 64 vertices and a cache of 14 vertices, as the developers of meshoptimizer evaluate
# orders; Kerbl et al. measured batches of 384 indices on an R7 200.
AMD = VertexReuse(64, 128, 14)


def make_fifo_cache(size: int) -> VertexReuse:
    """Return the classical model: a first-in first-out cache of `size` vertices."""
    return VertexReuse(UNLIMITED, UNLIMITED, size)


def count_batches(
    triangles: NDArray[np.int32],
    max_vertices: int = NVIDIA.max_vertices,
    max_triangles: int = NVIDIA.max_triangles,
    cache_size: int = UNLIMITED,
) -> tuple[int, int]:
    """Return the numbers of vertex batches and transformed vertices of triangles (m, 3)."""
    if max_vertices < 3 or max_triangles < 1 or cache_size < 3:
        raise ValueError(
            f"max_vertices {max_vertices}, max_triangles {max_triangles}, cache_size {cache_size}: "
            "out of range (at least 3, 1 and 3)"
        )
    if not len(triangles):
        return 0, 0
    rows = np.ascontiguousarray(triangles, np.int32)
    batches, transformed = _count_batches(rows, max_vertices, max_triangles, cache_size)
    return int(batches), int(transformed)


@njit(nogil=True)
def _count_batches(
    triangles: np.ndarray, max_vertices: int, max_triangles: int, cache_size: int
) -> tuple[int, int]:
    first = triangles.min()
    # -1, a time before the first batch, which begins at time 0: not transformed yet.
    entered = np.full(triangles.max() - first + 1, -1, dtype=np.int64)
    batches, size, begin, time = 1, 0, 0, 0
    for row in range(len(triangles)):
        added = 0
        for corner in range(3):
            since = entered[triangles[row, corner] - first]
            if since < begin or time - since > cache_size:
                added += 1
        if size == max_triangles or time - begin + added > max_vertices:
            batches += 1
            begin, size = time, 0
        for corner in range(3):
            vertex = triangles[row, corner] - first
            if entered[vertex] < begin or time - entered[vertex] > cache_size:
                entered[vertex] = time
                time += 1
        size += 1
    return batches, time


def sum_batches_of_draws(
    frame: Frame, triangles: NDArray[np.int32], reuse: VertexReuse = NVIDIA
) -> dict[str, int]:
    """Return the numbers of `count_batches`, summed over draws (map tiles, a model's views)."""
    counts = [count_batches(triangles[rows], *reuse) for rows in frame.split_by_draw(triangles)]
    batches, transformed = np.array(counts, np.int64).sum(axis=0).tolist()
    return {"vertex_batches": batches, "transformed_vertices": transformed}
