"""Exclude edges that no optimum contains, by local minimality (the LMT skeleton).

Source: M. Dickerson and M. Montague, "A (usually?) connected subgraph of the minimum weight
triangulation", 1996.

Let an optimum contain the diagonal a-b, with the triangles a-b-c on its left and b-a-d on its
right. If c-d crosses a-b, then d-b-c and c-a-d are empty triangles too, and a flip of a-b to c-d
gives another triangulation; so

    weight(abc) + weight(bad) <= weight(dbc) + weight(cad).

This uses only that the cost is a sum over triangles. Pair each remaining triangle on the left of an
edge with each on the right: if a flip makes every pair lighter, the edge is excluded, and so are
all triangles with that edge, until a fixed point is reached. A pair without a strictly convex
quadrilateral cannot be flipped and blocks the exclusion, whatever the weight. With the noise of
`checking.evidence` ties are very rare; a tie would retain both diagonals of a rectangle.

The fixed point does not depend on the order in which edges are examined: fewer triangles make fewer
pairs, so an edge that can be excluded now can be excluded later. The order of exclusion is stored
because each exclusion is justified by the earlier exclusions. An edge with t left and u right
triangles takes at most t * u trial flips, plus at most t + u for examining the edge again.

Potentials of excluded edges. The checker knows nothing of exclusions: it requires a potential of
every edge (see `proof`, also for the source). The potentials of the remaining edges always extend
to the excluded edges.

Take the excluded edges in reverse, the last first. Let a-b be the next, and let abc on the left
and bad on the right be the triangles at a-b whose other sides have potentials. The potential y(ab)
must satisfy

    y(ab) <= weight(abc) - y(bc) - y(ca)     and     -y(ab) <= weight(bad) - y(ad) - y(db),

which is possible if each such pair weighs at least y(bc) + y(ca) + y(ad) + y(db). Every pair does,
because a-b was excluded, so a flip makes the pair lighter:

    weight(abc) + weight(bad) > weight(dbc) + weight(cad)
                             >= y(db) + y(bc) + y(cd)  +  y(ca) + y(ad) + y(dc),

and y(cd) + y(dc) = 0. (c-d was not excluded before a-b: abc and bad were alive then, too, and would
have been the lighter pair. So the inequalities of cad and dbc hold already.) No potential of the
boundary changes, nor does the bound. With a lift, which is at most 0, dbc and cad may exceed their
weights by -lift each; y(ab) is then the midpoint, so that abc and bad exceed theirs by no more.

If no triangle on one side of a-b has potentials at both other sides, y(ab) is unbounded above or
below. A triangle with several excluded sides is considered when the last of them gets a potential,
so the inequality of every triangle is considered once.
"""

import numpy as np

from triangulators.certificate.candidates import Candidates
from triangulators.checking.evidence import TOO_LARGE, Units, compute_noise, compute_units
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost
from triangulators.geometry.predicates import orientation

_MAX_POTENTIAL = np.int64(TOO_LARGE)


def exclude_edges(
    candidates: Candidates, weights: np.ndarray, cost: Cost, units: Units
) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges (k,) in order of exclusion, and flags (t,) of the remaining triangles."""
    points, edges = candidates.points, candidates.edges
    spans = np.abs(points[edges[:, 0]] - points[edges[:, 1]]).sum(axis=1)
    queue = np.argsort(-spans, kind="stable")  # excluding a long edge removes many triangles
    alive = np.ones(len(candidates.triangles), dtype=np.bool_)
    value = weights // units.factor
    return _exclude_queued_edges(candidates, value, queue, alive, cost, units), alive


@njit
def _is_lighter_flipped(
    points: np.ndarray, a: int, b: int, c: int, d: int, value: int, cost: Cost, units: Units
) -> np.bool_:
    """Whether the triangles a-b-c and b-a-d weigh less after a flip of a-b to c-d.

    value: cost of both triangles, in units. The quadrilateral a-d-b-c is strictly convex if its
    boundary also turns left at b and at a. The noise of the sides cancels; that of the diagonals
    only breaks ties, because twice an edge's noise is less than a unit.
    """
    if orientation(points, d, b, c) <= 0.0 or orientation(points, c, a, d) <= 0.0:
        return np.bool_(False)
    flipped = compute_units(points, d, b, c, cost, units) + compute_units(
        points, c, a, d, cost, units
    )
    if flipped == value:
        return compute_noise(c, d, units.bits) < compute_noise(a, b, units.bits)
    return flipped < value


@njit(nogil=True)
def _exclude_queued_edges(
    candidates: Candidates,
    value: np.ndarray,
    queue: np.ndarray,
    alive: np.ndarray,
    cost: Cost,
    units: Units,
) -> np.ndarray:
    """Return the edges in order of exclusion; clear `alive` of the triangles at these edges.

    value (t,): costs in units; queue (e,): all edges. An edge without a triangle on one side is
    excluded, too. The pairs at an edge are all right triangles for each left triangle. Invariant:
    no pair before the position (left index, right index) blocks. Whether a flip makes a pair
    lighter never changes, and an excluded triangle never returns: the search stops at the pair that
    blocks, and continues there when a triangle at the edge was excluded (`_requeue_sides`).
    """
    points, edges, side, triangles, _sides, start, items = candidates
    excluded = np.empty(len(queue), dtype=np.int32)
    # The left triangles of edge e are in `items` from start[2 e] on, the right triangles from
    # start[2 e + 1] on, up to start[2 e + 2] - 1.
    at_left, at_right = start[0:-1:2].copy(), start[1::2].copy()
    # Flags of the diagonals in the queue or on the stack, so that each is there at most once.
    waiting = side == 0
    stack = np.empty(len(edges), dtype=np.int32)
    head, height, count = 0, 0, 0
    while head < len(queue) or height > 0:
        if height > 0:
            height -= 1
            e = stack[height]
        else:
            e = queue[head]
            head += 1
        if not waiting[e]:
            continue  # a boundary edge, which is never excluded
        waiting[e] = False
        a, b = edges[e, 0], edges[e, 1]
        right_start, end = start[2 * e + 1], start[2 * e + 2]
        left_index, right_index = at_left[e], at_right[e]
        is_blocked = False
        while left_index < right_start and not is_blocked:
            t = items[left_index]
            # The third vertex: the sum of all three without a and b.
            c = triangles[t, 0] + triangles[t, 1] + triangles[t, 2] - a - b
            while alive[t] and right_index < end:
                u = items[right_index]
                d = triangles[u, 0] + triangles[u, 1] + triangles[u, 2] - a - b
                total = value[t] + value[u]
                if alive[u] and not _is_lighter_flipped(points, a, b, c, d, total, cost, units):
                    is_blocked = True
                    break
                right_index += 1
            if not is_blocked:
                left_index += 1  # no pair with the left triangle t blocks
                right_index = right_start
        at_left[e], at_right[e] = left_index, right_index
        if is_blocked:
            continue
        excluded[count] = e
        count += 1
        for index in range(start[2 * e], end):
            t = items[index]
            if alive[t]:
                alive[t] = False
                height = _requeue_sides(candidates, t, at_left, waiting, stack, height)
    return excluded[:count].copy()


@njit
def _requeue_sides(
    candidates: Candidates,
    t: int,
    at_left: np.ndarray,
    waiting: np.ndarray,
    stack: np.ndarray,
    height: int,
) -> int:
    """Push the sides of an excluded triangle t that may now be excluded; return the new height."""
    for edge in candidates.triangle_edges[t]:
        # If no pair of triangles remains to be examined, the edge has been excluded.
        is_open = at_left[edge] < candidates.start[2 * edge + 1]
        if candidates.side[edge] == 0 and is_open and not waiting[edge]:
            waiting[edge] = True
            stack[height] = edge
            height += 1
    return height


def extend_potentials(
    candidates: Candidates, weights: np.ndarray, excluded: np.ndarray, potentials: np.ndarray
) -> np.ndarray | None:
    """Return potentials (e,) also valid for triangles with excluded edges, or None if too large."""
    extended = potentials.copy()
    is_set = np.ones(len(extended), dtype=np.bool_)
    is_set[excluded] = False
    last_first = excluded[::-1].astype(np.int64)
    is_valid = _set_excluded_potentials(candidates, weights, last_first, is_set, extended)
    return extended if is_valid else None


@njit(nogil=True)
def _set_excluded_potentials(
    candidates: Candidates,
    weights: np.ndarray,
    last_first: np.ndarray,
    is_set: np.ndarray,
    potentials: np.ndarray,
) -> bool:
    """Set the potentials (e,) of the excluded edges; return False if one would be too large.

    Invariant: the module's inequality, up to the lift, for triangles of edges in `is_set` (e,).
    """
    triangles, sides, start = candidates.triangles, candidates.triangle_edges, candidates.start
    for e in last_first:
        low, high = -_MAX_POTENTIAL, _MAX_POTENTIAL
        # Left triangles come first and run along a-b; right triangles run against a-b, so that
        # they require -y(ab) <= room.
        for index in range(start[2 * e], start[2 * e + 2]):
            t = candidates.items[index]
            is_left = index < start[2 * e + 1]
            room, is_complete = weights[t], True
            for k in range(3):
                side = sides[t, k]
                if side == e:
                    continue
                is_complete = is_complete and is_set[side]
                is_forward = triangles[t, k] < triangles[t, (k + 1) % 3]
                room -= potentials[side] if is_forward else -potentials[side]
            if is_complete and is_left:
                high = min(high, room)
            elif is_complete:
                low = max(low, -room)
        # The number nearest to zero in low..high, or the midpoint if that range is empty.
        potentials[e] = min(max(0, low), high) if low <= high else (low + high) // 2
        if abs(potentials[e]) >= _MAX_POTENTIAL:
            return False
        is_set[e] = True
    return True
