"""Find the optimum by a dynamic program if the LMT skeleton connects all rings of a polygon.

LMT: locally minimal triangulation. After `local_minimality` has excluded edges, a remaining
diagonal that crosses no remaining edge belongs to the skeleton, and to every optimum. Cut a polygon
with holes along diagonals of the skeleton that connect the boundary's rings. If all rings are
connected, the result is a single ring, in which a site at the end of a cut occurs several times:

    outline 0 1 2 3, hole 4 5 6, cut along 2-4:     ring 0 1 2 4 6 5 4 2 3

The remaining edges are the pairs of ring positions that may be joined. No edge crosses a cut, so
each edge lies in a single angle at either end, which determines the positions. Every triangle of
remaining edges is empty, and has sides that are such pairs: a cut inside the triangle would have to
leave across a side. So `compute_far_costs` over these pairs gives the optimum, and potentials that
satisfy the inequality of every remaining triangle, whether contained in a triangulation or not.
"""

import numpy as np

from triangulators.certificate.candidates import Candidates
from triangulators.checking.evidence import Units
from triangulators.compute.kernels import find_root, group_by_key, merge_trees, njit
from triangulators.criteria.cost import Cost
from triangulators.geometry.predicates import do_segments_cross, orientation
from triangulators.optimum.visible_lists import INFEASIBLE_WEIGHT, compute_far_costs


def solve_skeleton(
    candidates: Candidates, alive: np.ndarray, cost: Cost, units: Units
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the optimum (m, 3) over the candidates flagged in `alive` (t,), and its potentials.

    The potentials (e,) prove the optimum. Return None if the skeleton does not connect all rings,
    or if these triangles contain no triangulation.
    """
    c = candidates
    remaining = c.side != 0
    remaining[c.triangle_edges[alive]] = True
    cut = np.zeros(len(c.edges), dtype=np.bool_)
    if _connect_rings(c.points, c.edges, c.side, remaining, cut) > 1:
        return None
    closing = int(np.flatnonzero(c.side)[0])
    ring, inner = make_ring(c, cut, closing), remaining & ~cut & (c.side == 0)
    first, last = _find_ring_positions_of_edges(c, inner, ring)
    if (first < 0).any() or (last < 0).any():
        return None
    n, inner = len(ring), np.flatnonzero(inner)
    # The sides of the ring are pairs as well, with potential 0, except the side from last to first.
    low = np.concatenate((np.minimum(first, last), np.arange(n - 1), [0]))
    high = np.concatenate((np.maximum(first, last), np.arange(1, n), [n - 1]))
    order = np.lexsort((high, low))
    start = np.searchsorted(low[order], np.arange(n + 1))
    costs, triangles = compute_far_costs(
        start, high[order].astype(np.int32), c.points, ring, cost, units
    )
    by_pair = np.empty_like(costs)
    by_pair[order] = costs
    if by_pair[-1] >= INFEASIBLE_WEIGHT or len(triangles) == 0:
        return None
    potentials = np.zeros(len(c.edges), dtype=np.int64)
    # The potential from the earlier to the later ring position is the far cost, negated (see
    # `compute_far_costs`). Potentials of edges a < b are those from a to b.
    potentials[inner] = np.where(first < last, -by_pair[: len(inner)], by_pair[: len(inner)])
    potentials[closing] = c.side[closing] * by_pair[-1]
    return ring[triangles], potentials


@njit(nogil=True)
def _connect_rings(
    points: np.ndarray, edges: np.ndarray, side: np.ndarray, remaining: np.ndarray, cut: np.ndarray
) -> int:
    """Mark uncrossed diagonals that connect rings in `cut`; return the number of components."""
    parent = np.arange(len(points))
    # Flags of sites: if rings touch, one of several equal points is the site.
    on_boundary = np.zeros(len(points), dtype=np.bool_)
    parts = 0
    for e in range(len(edges)):
        if side[e] != 0:
            for v in edges[e]:
                parts += not on_boundary[v]
                on_boundary[v] = True
            parts -= merge_trees(parent, edges[e, 0], edges[e, 1])
    # Only edges whose x ranges overlap can cross: so edges are sorted by lowest x, and a search for
    # a crossing edge stops at the width of the widest edge.
    low_x = np.empty(len(edges))
    widest = 0.0
    for e in range(len(edges)):
        x, other_x = points[edges[e, 0], 0], points[edges[e, 1], 0]
        low_x[e] = min(x, other_x)
        if remaining[e]:
            widest = max(widest, abs(x - other_x))
    order = np.argsort(low_x)
    for position in range(len(order)):
        if parts == 1:
            break
        e = order[position]
        if not remaining[e] or side[e] != 0:
            continue
        a, b = edges[e, 0], edges[e, 1]
        is_separate = find_root(parent, a) != find_root(parent, b)
        if is_separate and not _is_crossed(
            points, edges, remaining, order, low_x, position, widest
        ):
            cut[e] = True
            parts -= merge_trees(parent, a, b)
    return parts


@njit(nogil=True)
def _is_crossed(
    points: np.ndarray,
    edges: np.ndarray,
    remaining: np.ndarray,
    order: np.ndarray,
    low_x: np.ndarray,
    position: int,
    widest: float,
) -> bool:
    """Whether a remaining edge crosses edge `order[position]`; low_x (e,): their lowest x."""
    e = order[position]
    a, b = edges[e, 0], edges[e, 1]
    max_x = max(points[a, 0], points[b, 0])
    for step in (-1, 1):
        index = position + step
        while 0 <= index < len(order):
            f = order[index]
            index += step
            if (step > 0 and low_x[f] >= max_x) or (step < 0 and low_x[f] + widest <= low_x[e]):
                break
            if remaining[f] and do_segments_cross(points, a, b, edges[f, 0], edges[f, 1]):
                return True
    return False


@njit
def _is_in_angle(points: np.ndarray, before: int, vertex: int, after: int, other: int) -> bool:
    """Whether `other` is inside a vertex's angle, counter-clockwise from `after` to `before`."""
    is_left_of_exit = orientation(points, vertex, after, other) > 0.0
    is_left_of_entry = orientation(points, before, vertex, other) > 0.0
    if orientation(points, before, vertex, after) > 0.0:
        return is_left_of_exit and is_left_of_entry
    return is_left_of_exit or is_left_of_entry


@njit(nogil=True)
def make_ring(candidates: Candidates, cut: np.ndarray, root: int) -> np.ndarray:
    """Return the cut polygon's ring through edge `root`: sites in order, with repetitions.

    The polygon is on the left; the last site leads to the first along `root`, a boundary edge. The
    edge after u-v is the first that leaves v, clockwise from u: no cut lies between the two.
    """
    points, edges, side = candidates.points, candidates.edges, candidates.side
    count = 2 * cut.sum() + (side != 0).sum()
    leaving = np.empty((count, 2), dtype=np.int32)  # directed sides of all rings of the cut polygon
    n = 0
    for e in range(len(edges)):
        if side[e] > 0 or cut[e]:
            leaving[n, 0], leaving[n, 1] = edges[e, 0], edges[e, 1]
            n += 1
        if side[e] < 0 or cut[e]:
            leaving[n, 0], leaving[n, 1] = edges[e, 1], edges[e, 0]
            n += 1
    start, items = group_by_key(leaving[:, 0].copy(), len(points))
    first, second = edges[root, 0], edges[root, 1]
    if side[root] < 0:
        first, second = second, first
    u, v = first, second
    ring = np.empty(count, dtype=np.int32)
    size = 0
    while size < count and (size == 0 or u != first or v != second):
        ring[size] = v
        size += 1
        next_site = u  # none yet: with -1, of another type, all predicates are compiled twice
        for item in range(start[v], start[v + 1]):
            w = leaving[items[item], 1]
            if w != u and (next_site == u or _is_in_angle(points, u, v, next_site, w)):
                next_site = w
        u, v = v, next_site
    return ring[:size]


@njit(nogil=True)
def find_ring_position(
    points: np.ndarray, ring: np.ndarray, start: np.ndarray, items: np.ndarray, v: int, other: int
) -> int:
    """Return the position in the ring at which the angle of site v contains `other`, or -1."""
    n = len(ring)
    for item in range(start[v], start[v + 1]):
        position: int = items[item]
        before, after = ring[position - 1], ring[position + 1 if position + 1 < n else 0]
        if _is_in_angle(points, before, v, after, other):
            return position
    return -1


@njit(nogil=True)
def _find_ring_positions_of_edges(
    candidates: Candidates, selected: np.ndarray, ring: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the ring positions of the ends a and b, a < b, of the `selected` edges."""
    points, edges = candidates.points, candidates.edges
    start, items = group_by_key(ring, len(points))
    positions = np.empty((selected.sum(), 2), dtype=np.int64)
    row = 0
    for e in range(len(edges)):
        if selected[e]:
            for end in range(2):
                site, other = edges[e, end], edges[e, 1 - end]
                positions[row, end] = find_ring_position(points, ring, start, items, site, other)
            row += 1
    return positions[:, 0], positions[:, 1]
