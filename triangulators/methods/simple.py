"""Simple triangulators: fan, strip, greedy (shortest diagonals first), largest triangle first."""

from collections.abc import Callable
from typing import Any

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.errors import SkippedError
from triangulators.geometry.half_edges import find_twins
from triangulators.geometry.predicates import orientation
from triangulators.geometry.visibility import find_visible_sites
from triangulators.initial import (
    find_any_triangulation,
    make_cycle,
    require_few_vertices,
    sort_by_length,
    triangulate_greedily,
)
from triangulators.polygon import Boundary

MAX_GREEDY_VERTICES = 3000  # for `triangulate_greedy`, which compares pairs of vertices
MAX_LARGEST_VERTICES = 1500  # for `triangulate_largest_first`, whose time is cubic


def triangulate_fan(outline: Boundary) -> np.ndarray:
    """Return a fan (n - 2, 3): all triangles at one vertex, which sees the whole polygon."""
    return _triangulate_ring(outline, "fan", _find_fan, "no vertex sees the whole polygon")


def triangulate_strip(outline: Boundary) -> np.ndarray:
    """Return the triangles (n - 2, 3) of a zigzag of diagonals, a triangle strip."""
    return _triangulate_ring(outline, "strip", _find_zigzag, "no zigzag stays inside the polygon")


def _triangulate_ring(
    outline: Boundary, name: str, rule: Callable[..., Any], reason: str
) -> np.ndarray:
    if outline.holes:
        raise SkippedError(f"{name}: the polygon has holes")
    triangles: np.ndarray = rule(outline.points, outline.edges[:, 0].copy())
    if len(triangles) == 0:
        raise SkippedError(f"{name}: {reason}")
    return triangles


@njit
def _find_fan(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Return the first fan whose triangles are all counter-clockwise, so valid, or no rows."""
    n = len(ring)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    for centre in range(n):
        valid = True
        for row in range(n - 2):
            a, b, c = ring[centre], ring[(centre + row + 1) % n], ring[(centre + row + 2) % n]
            if orientation(points, a, b, c) <= 0.0:
                valid = False
                break
            triangles[row, 0], triangles[row, 1], triangles[row, 2] = a, b, c
        if valid:
            return triangles
    return triangles[:0]


@njit
def _find_zigzag(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Return the first zigzag whose triangles are all counter-clockwise, so valid, or no rows."""
    n = len(ring)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    for start in range(2 * n):
        low = start // 2
        forward = start % 2 == 0
        high = low + n - 1
        valid = True
        for row in range(n - 2):
            apex = low + 1 if forward else high - 1
            a, b, c = ring[low % n], ring[apex % n], ring[high % n]
            if orientation(points, a, b, c) <= 0.0:
                valid = False
                break
            triangles[row, 0], triangles[row, 1], triangles[row, 2] = a, b, c
            if forward:
                low += 1
            else:
                high -= 1
            forward = not forward
        if valid:
            return triangles
    return triangles[:0]


def triangulate_greedy(outline: Boundary) -> np.ndarray:
    """Return the greedy triangulation (m, 3): shortest diagonals first, without crossings."""
    require_few_vertices(outline, "greedy", MAX_GREEDY_VERTICES)
    if not outline.holes:
        return _triangulate_cycle_greedily(outline)
    start = find_any_triangulation(outline)
    return triangulate_greedily(
        outline.points, outline.edges, find_visible_sites(outline.points, start, find_twins(start))
    )


def _triangulate_cycle_greedily(outline: Boundary) -> np.ndarray:
    ring = make_cycle(outline, "greedy")
    n = len(ring.cycle)
    tails = np.repeat(np.arange(n, dtype=np.int32), np.diff(ring.start))
    pairs = sort_by_length(ring.points, np.column_stack((tails, ring.target)))
    sides = np.column_stack((np.arange(n), (np.arange(n) + 1) % n))
    selected = np.concatenate(
        (pairs[_select_uncrossed_pairs_of_cycle(n, pairs)], np.sort(sides, axis=1))
    )
    selected = selected[np.lexsort((selected[:, 1], selected[:, 0]))]
    selected = selected[np.r_[True, np.any(selected[1:] != selected[:-1], axis=1)]]
    # Two consecutive neighbours of vertex i with numbers above i form a triangle with i.
    same = np.flatnonzero(selected[1:, 0] == selected[:-1, 0])
    return np.asarray(ring.cycle[np.column_stack((selected[same], selected[same + 1, 1]))])


@njit
def _select_uncrossed_pairs_of_cycle(n: int, pairs: np.ndarray) -> np.ndarray:
    """Return flags of the pairs (i, j) of a cycle, i < j, that cross no earlier selected pair."""
    # The lowest and the highest vertex to which selected pairs join each vertex: i-j is crossed if
    # a vertex strictly between i and j is joined to a vertex outside i..j.
    lowest, highest = np.arange(n), np.arange(n)
    selected = np.zeros(len(pairs), dtype=np.bool_)
    for index in range(len(pairs)):
        i, j = pairs[index]
        crossed = False
        for v in range(i + 1, j):
            crossed |= lowest[v] < i or highest[v] > j
        if not crossed:
            selected[index] = True
            highest[i], lowest[j] = max(highest[i], j), min(lowest[j], i)
    return selected


def triangulate_largest_first(outline: Boundary) -> np.ndarray:
    """Return triangles (n - 2, 3), the largest first (E. Persson, "Triangulation", 2009)."""
    require_few_vertices(outline, "max-area", MAX_LARGEST_VERTICES)
    ring = make_cycle(outline, "max-area")
    n = len(ring.cycle)
    sees = np.zeros((n, n), dtype=np.bool_)
    sees[np.repeat(np.arange(n), np.diff(ring.start)), ring.target] = True
    return np.asarray(ring.cycle[_cut_largest_triangles_first(ring.points, sees)])


@njit
def _cut_largest_triangles_first(points: np.ndarray, sees: np.ndarray) -> np.ndarray:
    """Return the triangles (n - 2, 3) of a counter-clockwise cycle (n, 2), the largest first.

    sees (n, n): [i, j], i < j, is True if the vertices see each other. A stack has the remaining
    sub-polygons as vertices in the cycle's order, so every triangle i < k < j of mutually visible
    vertices is counter-clockwise. The largest, p, q, r, cuts off the sub-polygons p to q, q to r,
    and r around to p, unless that is a side. Of equal areas, the lowest i, k, j is taken.
    """
    n = len(points)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    count = 0
    waiting = [np.arange(n)]
    while len(waiting) > 0:
        corners = waiting.pop()
        size = len(corners)
        best, p, q, r = -1.0, 0, 0, 0
        for i in range(size):
            xi, yi = points[corners[i]]
            for k in range(i + 1, size):
                if not sees[corners[i], corners[k]]:
                    continue
                dx, dy = points[corners[k], 0] - xi, points[corners[k], 1] - yi
                for j in range(k + 1, size):
                    area = dx * (points[corners[j], 1] - yi) - dy * (points[corners[j], 0] - xi)
                    if (
                        area > best
                        and sees[corners[i], corners[j]]
                        and sees[corners[k], corners[j]]
                    ):
                        best, p, q, r = area, i, k, j
        triangles[count, 0] = corners[p]
        triangles[count, 1] = corners[q]
        triangles[count, 2] = corners[r]
        count += 1
        if q - p > 1:
            waiting.append(corners[p : q + 1].copy())
        if r - q > 1:
            waiting.append(corners[q : r + 1].copy())
        if size - (r - p) > 1:
            waiting.append(np.concatenate((corners[: p + 1], corners[r:])))
    return triangles
