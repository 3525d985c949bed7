"""Triangulations by a simple rule: fan, strip, greedy, largest triangle first."""

from collections.abc import Callable
from typing import Any

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.errors import SkippedError
from triangulators.geometry.half_edges import twins_of
from triangulators.geometry.predicates import turn
from triangulators.geometry.shortest_diagonals import by_length, shortest_first
from triangulators.geometry.visibility import visible_sites
from triangulators.initial import cycle_of, initial_triangulations
from triangulators.polygon import Boundary

MOST_GREEDY = 3000
"""Vertices of a greedy triangulation, as pairs of them are looked at."""

MOST_LARGEST = 1500
"""Vertices of one by largest triangles: the search takes a time that grows with their cube."""


def fan(outline: Boundary) -> np.ndarray:
    """Return all diagonals from one vertex; raise `SkippedError` for holes or if none sees all."""
    return _of_ring(outline, "fan", _fan_of, "no vertex sees the whole polygon")


def strip(outline: Boundary) -> np.ndarray:
    """Return a zigzag of diagonals, as a triangle strip would be drawn.

    Raises `SkippedError` for holes and where no start gives a valid one.
    """
    return _of_ring(outline, "strip", _zigzag, "no zigzag stays inside the polygon")


def _of_ring(outline: Boundary, name: str, rule: Callable[..., Any], why_not: str) -> np.ndarray:
    if outline.holes:
        raise SkippedError(f"{name}: the polygon has holes")
    triangles: np.ndarray = rule(outline.points, outline.edges[:, 0].copy())
    if len(triangles) == 0:
        raise SkippedError(f"{name}: {why_not}")
    return triangles


@njit
def _fan_of(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Return the first valid fan of a counter-clockwise ring, (n - 2, 3), or no rows.

    A fan is valid if all its triangles turn left: their edges then add up to the boundary.
    """
    n = len(ring)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    for centre in range(n):
        valid = True
        for row in range(n - 2):
            a, b, c = ring[centre], ring[(centre + row + 1) % n], ring[(centre + row + 2) % n]
            if turn(points, a, b, c) <= 0.0:
                valid = False
                break
            triangles[row, 0], triangles[row, 1], triangles[row, 2] = a, b, c
        if valid:
            return triangles
    return triangles[:0]


@njit
def _zigzag(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Return the first valid zigzag of a counter-clockwise ring, (n - 2, 3), or no rows.

    A zigzag starts at a side and takes its next vertex from either end in turn. It is valid if all
    its triangles turn left: their edges then add up to the boundary.
    """
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
            if turn(points, a, b, c) <= 0.0:
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


def greedy(outline: Boundary) -> np.ndarray:
    """Return all diagonals, shortest first, each kept if it crosses none kept, as triangles (m, 3).

    Raises `SkippedError` beyond 3000 vertices.
    """
    if len(outline.edges) > MOST_GREEDY:
        raise SkippedError(f"greedy: {len(outline.edges)} vertices, more than {MOST_GREEDY}")
    if not outline.holes:
        return _greedy_of_cycle(outline)
    start = initial_triangulations(outline)[0]
    return shortest_first(
        outline.points, outline.edges, visible_sites(outline.points, start, twins_of(start))
    )


def _greedy_of_cycle(outline: Boundary) -> np.ndarray:
    ring = cycle_of(outline, "greedy")
    n = len(ring.cycle)
    tails = np.repeat(np.arange(n, dtype=np.int32), np.diff(ring.start))
    pairs = by_length(ring.points, np.column_stack((tails, ring.target)))
    sides = np.column_stack((np.arange(n), (np.arange(n) + 1) % n))
    kept = np.concatenate((pairs[_keep_in_cycle(n, pairs)], np.sort(sides, axis=1)))
    kept = kept[np.lexsort((kept[:, 1], kept[:, 0]))]
    kept = kept[np.r_[True, np.any(kept[1:] != kept[:-1], axis=1)]]
    # The corners above i that i is joined to, in order, are the far sides of its triangles.
    same = np.flatnonzero(kept[1:, 0] == kept[:-1, 0])
    return np.asarray(ring.cycle[np.column_stack((kept[same], kept[same + 1, 1]))])


@njit
def _keep_in_cycle(n: int, pairs: np.ndarray) -> np.ndarray:
    """Mark the pairs (i, j) of a cycle's corners, i < j, that cross no earlier one kept.

    Diagonals of a cycle cross if the ends of one are apart on the cycle between those of the other:
    no coordinates are needed. least, most: the range of corners that each is joined to by what is
    kept. So i-j crosses one of them if a corner strictly between i and j is joined to one outside
    i..j; a pair takes j - i steps.
    """
    least, most = np.arange(n), np.arange(n)
    kept = np.zeros(len(pairs), dtype=np.bool_)
    for index in range(len(pairs)):
        i, j = pairs[index]
        crossed = False
        for v in range(i + 1, j):
            crossed |= least[v] < i or most[v] > j
        if not crossed:
            kept[index] = True
            most[i], least[j] = max(most[i], j), min(least[j], i)
    return kept


def largest_first(outline: Boundary) -> np.ndarray:
    """Return the largest triangle, then the same in what is left on each side of it, (n - 2, 3).

    Raises `SkippedError` for holes and beyond 1500 vertices. Source: E. Persson, "Triangulation",
    2009, for convex polygons; here corners that see each other are joined, so any simple polygon
    will do.
    """
    if len(outline.edges) > MOST_LARGEST:
        raise SkippedError(f"max-area: {len(outline.edges)} vertices, more than {MOST_LARGEST}")
    ring = cycle_of(outline, "max-area")
    n = len(ring.cycle)
    sees = np.zeros((n, n), dtype=np.bool_)
    sees[np.repeat(np.arange(n), np.diff(ring.start)), ring.target] = True
    return np.asarray(ring.cycle[_largest_of(ring.points, sees)])


@njit
def _largest_of(points: np.ndarray, sees: np.ndarray) -> np.ndarray:
    """Return the triangles (n - 2, 3) of a counter-clockwise cycle (n, 2); sees (n, n), i < j.

    A stack of sub-polygons, each the corners of it in the cycle's order, so that every triangle
    i < k < j of corners that see each other turns left, and its doubled area needs no sign. The
    largest one cuts three sub-polygons off, of the corners p to q, q to r, and r round to p; those
    that are a side only are not kept. Of equal areas it is the first, by i, k and j.
    """
    n = len(points)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    found = 0
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
        triangles[found, 0] = corners[p]
        triangles[found, 1] = corners[q]
        triangles[found, 2] = corners[r]
        found += 1
        if q - p > 1:
            waiting.append(corners[p : q + 1].copy())
        if r - q > 1:
            waiting.append(corners[q : r + 1].copy())
        if size - (r - p) > 1:
            waiting.append(np.concatenate((corners[: p + 1], corners[r:])))
    return triangles
