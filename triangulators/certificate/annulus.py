"""Kinds of edges of a polygon with one hole, and positions around the hole (see `bridges`)."""

import numpy as np

from triangulators.certificate.candidates import Candidates
from triangulators.certificate.skeleton import find_ring_position, make_ring
from triangulators.compute.kernels import group_by_key, njit
from triangulators.geometry.predicates import orientation

# Kinds of edges: CUT includes sides of rings; a POCKET has both ends on one ring, and a BRIDGE
# leads from the outer ring to the hole (see `bridges`); UNUSED edges cross a cut.
CUT, UNUSED, POCKET, BRIDGE = range(4)


@njit(nogil=True)
def find_annulus_rings(
    candidates: Candidates, ring_offsets: np.ndarray, hole: int, cut: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the cut polygon's outer ring (m,), and the hole's ring (q,) from its leftmost site."""
    points, edges, side = candidates.points, candidates.edges, candidates.side
    first, last = ring_offsets[hole], ring_offsets[hole + 1]
    root = inner_root = len(edges)
    for e in range(len(edges) - 1, -1, -1):
        if side[e] != 0:
            root = e  # in the end the first boundary edge, at the first site: on the exterior
            if first <= edges[e, 0] < last:
                inner_root = e
    outer, inner = make_ring(candidates, cut, root), make_ring(candidates, cut, inner_root)
    leftmost = 0
    for k in range(len(inner)):
        if points[inner[k], 0] < points[inner[leftmost], 0]:
            leftmost = k
    inner_from_leftmost = np.empty_like(inner)
    for k in range(len(inner)):
        inner_from_leftmost[k] = inner[(leftmost + k) % len(inner)]
    return outer, inner_from_leftmost


@njit(nogil=True)
def classify_edges(
    candidates: Candidates,
    outer: np.ndarray,
    inner: np.ndarray,
    cut: np.ndarray,
    usable: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the kind of each edge (CUT to BRIDGE), and two numbers that locate it, (e,) each.

    outer (m,), inner (q,): rings of sites; inner[0] is leftmost. For a bridge, the numbers are the
    positions on both rings. For the pocket of an edge a-b, a < b, the first is the number of ring
    sides that the pocket spans, negative if these lead from b to a; the second is 0.
    """
    points, edges, side = candidates.points, candidates.edges, candidates.side
    m, q, tip, upper = len(outer), len(inner), inner[0], inner[1]
    outer_start, outer_items = group_by_key(outer, len(points))
    inner_start, inner_items = group_by_key(inner, len(points))
    turn = np.zeros(m, dtype=np.int64)
    for k in range(1, m):
        turn[k] = turn[k - 1] + _count_crossings(points, outer[k - 1], outer[k], tip)
    kind = np.full(len(edges), UNUSED, dtype=np.int8)
    first, second = np.zeros(len(edges), dtype=np.int64), np.zeros(len(edges), dtype=np.int64)
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        if side[e] != 0 or cut[e]:
            kind[e] = CUT
            continue
        on_hole, to_hole = inner_start[a] < inner_start[a + 1], inner_start[b] < inner_start[b + 1]
        if on_hole and not to_hole:
            a, b = b, a
        i = j = 0
        if not on_hole or not to_hole:
            i = find_ring_position(points, outer, outer_start, outer_items, a, b)
        if not on_hole and not to_hole:
            j = find_ring_position(points, outer, outer_start, outer_items, b, a)
        if not usable[e] or i < 0 or j < 0:
            continue
        if on_hole != to_hole:
            kind[e], first[e] = BRIDGE, i
            second[e] = q * turn[i] + _find_hole_position(
                points, a, b, inner, inner_items[inner_start[b]]
            )
            continue
        kind[e] = POCKET
        if on_hole:
            i, j = inner_items[inner_start[a]], inner_items[inner_start[b]]
            around, length = _count_turns(points, a, b, i, j, tip, upper), (j - i) % q
            first[e] = length if around == 0 else length - q
        else:
            around = _count_crossings(points, b, a, tip) + turn[j] - turn[i] + (1 if i > j else 0)
            length = (j - i) % m
            first[e] = length if around == 0 else length - m
    return kind, first, second


@njit(nogil=True)
def _find_hole_position(
    points: np.ndarray, outer_end: int, end: int, inner: np.ndarray, index: int
) -> int:
    """Return a bridge's position on the hole, counted from the turn that its outer end is in."""
    tip, q = inner[0], len(inner)
    if index == 0:
        return q if _is_above(points, outer_end, tip, inner[1]) else 0
    return q * _count_crossings(points, outer_end, end, tip) + q - index


@njit(nogil=True)
def _count_turns(points: np.ndarray, a: int, b: int, i: int, j: int, tip: int, upper: int) -> int:
    """Return how often the hole's ring from i to j, then the edge b-a, turns around the hole."""
    around = _count_crossings(points, b, a, tip)
    if i == 0:
        return around if _is_above(points, b, tip, upper) else around - 1
    if j == 0:
        return around - 1 if _is_above(points, a, tip, upper) else around
    return around - 1 if i > j else around


@njit(nogil=True)
def _count_crossings(points: np.ndarray, a: int, b: int, tip: int) -> int:
    """Return 1 if a-b runs down across the ray left of `tip`, -1 if up across the ray, else 0."""
    y = points[tip, 1]
    above, other_above = points[a, 1] > y, points[b, 1] > y
    if above == other_above:
        return 0
    side = orientation(points, a, b, tip)
    return (1 if side > 0.0 else 0) if above else (-1 if side < 0.0 else 0)


@njit(nogil=True)
def _is_above(points: np.ndarray, v: int, tip: int, upper: int) -> bool:
    """Whether v sees a hole's leftmost vertex `tip` from above; upper: the next site."""
    if points[v, 0] < points[tip, 0]:
        return bool(points[v, 1] > points[tip, 1])
    return bool(orientation(points, tip, upper, v) > 0.0)
