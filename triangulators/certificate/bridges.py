"""The optimum of a polygon with holes for any cost, by shortest closed walks over bridges.

One hole. A *bridge* is an edge between the outer ring and the hole. Any other edge has both ends on
one ring and cuts off a *pocket*, the side without the hole. A triangle with a bridge has exactly
two bridges, and its third side closes a pocket, or is a side of a ring:

    pocket(e) = min over the triangles at e in e's pocket of weight + the pockets of both other
                sides; 0 for a side of a ring,
    walk(b) = min over the triangles with the bridges a and b of walk(a) + weight + the pocket of
              the third side.

Around the hole, the bridges of a triangulation form a closed walk, counter-clockwise, in which each
triangle advances one end, along the outer ring or along the hole. Pockets are the same for all
walks. Walks begin at an extreme vertex of the hole, such as the leftmost: the polygon's angle there
exceeds 180 degrees, a triangle's does not, so each triangulation has a bridge that leads from there
further to the left. Of the four extreme vertices, that with the fewest such bridges is taken.

Order of a walk. Number the sites of both rings counter-clockwise, the outer ring 0..m - 1, the hole
0..q - 1 from the leftmost vertex on; each further turn around the hole adds m and q. A bridge ends
in the same turn on both rings, or one turn apart if the bridge crosses the ray from the leftmost
vertex to the left (exact predicates count the turns). Two bridges cross if their positions are in
opposite order on the two rings. So a walk from a bridge visits bridges whose two positions have an
ascending sum, until the sum has grown by m + q: an acyclic graph.

More holes. The extreme vertex of all holes in a direction has an edge to the ring outside. Cut
along one such edge, and repeat until one hole is left; all choices of cuts are tried. Edges that
cross a cut are not used.

Cost: each choice of cuts takes t additions for t triangles, and t more for each bridge at which
walks begin. For 113 letters with holes, the total is a tenth of the time of linear programs.
"""

from typing import Any

import numpy as np

from triangulators.certificate.annulus import (
    BRIDGE,
    CUT,
    POCKET,
    UNUSED,
    classify_edges,
    find_annulus_rings,
)
from triangulators.certificate.candidates import Candidates
from triangulators.compute.kernels import group_by_key, njit
from triangulators.geometry.predicates import do_segments_cross

MAX_CUTS = 250  # `solve_by_bridges` gives up if there are more ways to cut


@njit(nogil=True)
def solve_by_bridges(
    candidates: Candidates,
    ring_offsets: np.ndarray,
    alive: np.ndarray,
    weights: np.ndarray,
    none: Any,
) -> np.ndarray:
    """Return the indices (m,) of the candidates that form the triangulation of minimum weight.

    ring_offsets (h + 2,), h > 0: rings that do not touch; none: exceeds the weight of every
    triangulation, but the sum of three does not overflow. The result is empty if there are more
    than `MAX_CUTS` ways to cut, or no triangulation of the triangles flagged in `alive` (t,).
    """
    c = candidates
    holes, size = len(ring_offsets) - 2, len(c.edges)
    usable = np.zeros((holes, size), dtype=np.bool_)  # at each depth, edges that cross no cut
    for t in range(len(alive)):
        if alive[t]:
            for e in c.triangle_edges[t]:
                usable[0, e] = True
    cut = np.zeros(size, dtype=np.bool_)
    merged = np.zeros(holes + 1, dtype=np.bool_)
    choices = np.empty((holes, size), dtype=np.int32)
    # Number of choices at each depth, -1 if they are not listed yet.
    count = np.full(holes, -1, dtype=np.int64)
    taken, hole_at = np.zeros(holes, dtype=np.int64), np.zeros(holes, dtype=np.int64)
    best, solution = none, np.empty(0, dtype=np.int64)
    depth, cuts = 0, 0
    while depth >= 0:
        if count[depth] < 0:
            count[depth], hole_at[depth] = _list_bridges(
                c, ring_offsets, merged, usable[depth], choices[depth]
            )
            taken[depth] = 0
        if depth == holes - 1 and count[depth] > 0:
            cuts += 1
            if cuts > MAX_CUTS:
                return solution[:0]
            starts = choices[depth, : count[depth]]
            total, triangles = _solve_annulus(
                c, ring_offsets, hole_at[depth], cut, usable[depth], alive, weights, starts, none
            )
            if total < best:
                best, solution = total, triangles
        if depth == holes - 1 or taken[depth] == count[depth]:
            count[depth] = -1
            depth -= 1
            if depth >= 0:
                cut[choices[depth, taken[depth] - 1]] = False
                merged[hole_at[depth]] = False
            continue
        e = choices[depth, taken[depth]]
        taken[depth] += 1
        cut[e], merged[hole_at[depth]] = True, True
        a, b = c.edges[e, 0], c.edges[e, 1]
        for f in range(size):
            usable[depth + 1, f] = usable[depth, f] and not do_segments_cross(
                c.points, a, b, c.edges[f, 0], c.edges[f, 1]
            )
        depth += 1
    return solution


@njit(nogil=True)
def _list_bridges(
    candidates: Candidates,
    ring_offsets: np.ndarray,
    merged: np.ndarray,
    usable: np.ndarray,
    bridges: np.ndarray,
) -> tuple[int, int]:
    """Write the outward bridges of a hole's extreme vertex to `bridges`; return count and hole.

    The vertex is the leftmost, rightmost, lowest or highest of all holes not in `merged`. Outward
    bridges are the `usable` edges from the vertex that lead further in that direction.
    """
    points, edges = candidates.points, candidates.edges
    min_count, tip_owner = len(edges) + 1, 0
    indices = np.empty(len(edges), dtype=np.int32)
    for direction in range(4):
        axis, sign = direction // 2, 1.0 if direction % 2 == 0 else -1.0
        tip, tip_hole = -1, 0
        for hole in range(1, len(ring_offsets) - 1):
            if not merged[hole]:
                for v in range(ring_offsets[hole], ring_offsets[hole + 1]):
                    if tip < 0 or sign * points[v, axis] < sign * points[tip, axis]:
                        tip, tip_hole = v, hole
        limit, count = sign * points[tip, axis], 0
        for e in range(len(edges)):
            a, b = edges[e, 0], edges[e, 1]
            if usable[e] and (a == tip or b == tip):
                end = b if a == tip else a
                if sign * points[end, axis] < limit:
                    indices[count] = e
                    count += 1
        if count < min_count:
            min_count, tip_owner = count, tip_hole
            for k in range(count):
                bridges[k] = indices[k]
    return min_count, tip_owner


@njit(nogil=True)
def _find_pockets_and_steps(
    candidates: Candidates,
    kind: np.ndarray,
    length: np.ndarray,
    alive: np.ndarray,
    on_hole: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pocket (t,) that each triangle can close, and the steps (s, 4) of walks.

    A triangle without a bridge closes the pocket of the side across which the hole lies: an edge
    index, or the number of edges if there is none. A triangle with two bridges is a step: indices
    of the bridges before and after it, of the triangle, and of its third edge. A triangle is
    outside the pocket of a side if it runs along the side in the direction of the pocket.
    """
    c = candidates
    pocket_of = np.full(len(alive), len(c.edges), dtype=np.int64)
    steps, count = np.empty((len(alive), 4), dtype=np.int32), 0
    for t in range(len(alive)):
        bridges, inside, pocket, base = 0, 0, 0, 0
        for s in range(3):
            e = c.triangle_edges[t, s]
            if kind[e] == UNUSED or not alive[t]:
                bridges = 3
            elif kind[e] == BRIDGE:
                bridges += 1
            else:
                base = s
                forward = c.triangles[t, s] < c.triangles[t, s + 1 if s < 2 else 0]
                if kind[e] == POCKET and forward != (length[e] > 0):
                    inside += 1
                    pocket = e
        if bridges == 0 and inside == 1:
            pocket_of[t] = pocket
        elif bridges == 2 and inside == 0:
            # Along the third edge, counter-clockwise around the triangle, the outer ring ascends
            # and the hole descends.
            before, after = c.triangle_edges[t, (base + 2) % 3], c.triangle_edges[t, (base + 1) % 3]
            if on_hole[c.triangles[t, base]]:
                before, after = after, before
            steps[count, 0], steps[count, 1] = before, after
            steps[count, 2], steps[count, 3] = t, c.triangle_edges[t, base]
            count += 1
    return pocket_of, steps[:count]


@njit(nogil=True)
def _minimise_pockets(
    candidates: Candidates,
    kind: np.ndarray,
    length: np.ndarray,
    pocket_of: np.ndarray,
    weights: np.ndarray,
    none: Any,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the minimum weight (e,) of each edge's pocket, and the triangle (e,) at the edge.

    The weight is 0 for sides and cuts, and `none` for bridges, unused edges and impossible pockets.
    """
    sides, count = candidates.triangle_edges, len(kind)
    pocket = np.full(count, none, dtype=weights.dtype)
    apex = np.full(count, -1, dtype=np.int64)
    start, items = group_by_key(pocket_of, count + 1)
    lengths = np.zeros(count, dtype=np.int64)
    for e in range(count):
        if kind[e] == CUT:
            pocket[e] = 0
        elif kind[e] == POCKET:
            lengths[e] = abs(length[e])
    by_length, in_order = group_by_key(lengths, lengths.max() + 1)
    for e in in_order[by_length[1] :]:
        best, best_triangle = none, -1
        for index in range(start[e], start[e + 1]):
            t = items[index]
            total = weights[t]
            for s in range(3):
                if sides[t, s] != e:
                    total += pocket[sides[t, s]]
            if total < best:
                best, best_triangle = total, t
        pocket[e], apex[e] = best, best_triangle
    return pocket, apex


@njit(nogil=True)
def _solve_annulus(
    candidates: Candidates,
    ring_offsets: np.ndarray,
    hole: int,
    cut: np.ndarray,
    usable: np.ndarray,
    alive: np.ndarray,
    weights: np.ndarray,
    starts: np.ndarray,
    none: Any,
) -> tuple[Any, np.ndarray]:
    """Return the minimum weight of a cut polygon with one hole, or `none`, and its triangles (m,).

    Each triangulation contains at least one of the bridges `starts`.
    """
    c, (outer, inner) = candidates, find_annulus_rings(candidates, ring_offsets, hole, cut)
    m, q = len(outer), len(inner)
    on_hole = np.zeros(len(c.points), dtype=np.bool_)
    on_hole[inner] = True
    kind, first, second = classify_edges(c, outer, inner, cut, usable)
    pocket_of, steps = _find_pockets_and_steps(c, kind, first, alive, on_hole)
    pocket, apex = _minimise_pockets(c, kind, first, pocket_of, weights, none)
    # Shift both positions of each bridge by full turns, so that their sum is in 0..period - 1.
    period = m + q
    sums = np.full(len(kind), period, dtype=np.int64)
    for e in range(len(kind)):
        if kind[e] == BRIDGE:
            turns = (first[e] + second[e]) // period
            first[e] -= turns * m
            second[e] -= turns * q
            sums[e] = first[e] + second[e]
    by_sum, order = group_by_key(sums, period + 1)
    order = order[: by_sum[period]]
    rank = np.zeros(len(kind), dtype=np.int64)
    for k in range(len(order)):
        rank[order[k]] = k
    # Group the steps by the bridge after each. A step whose positions do not advance by the sides
    # that its third edge spans leads around the wrong side of the hole: it stays in the last group,
    # which no walk reads.
    after = np.full(len(steps), len(kind), dtype=np.int64)
    sizes, costs = np.empty(len(steps), dtype=np.int64), np.empty(len(steps), weights.dtype)
    for k in range(len(steps)):
        a, b, t, base = steps[k]
        size = max(1, abs(first[base]))
        sizes[k], costs[k] = size, weights[t] + pocket[base]
        turn = (sums[a] + size - sums[b]) // period
        o, h = first[b] + turn * m - first[a], second[b] + turn * q - second[a]
        along = (o == 0 and h == size) if on_hole[c.edges[base, 0]] else (o == size and h == 0)
        if along and costs[k] < none:
            after[k] = b
    by_target = group_by_key(after, len(kind) + 1)
    best, solution = none, np.empty(0, dtype=np.int64)
    walk, via = np.empty(len(kind), dtype=weights.dtype), np.empty(len(kind), dtype=np.int64)
    for s in starts:
        if kind[s] != BRIDGE:
            continue
        total = _find_lightest_walk(
            s, order, rank, (m, q), first, second, steps, sizes, costs, by_target, none, walk, via
        )
        if total < best:
            best, solution = total, _list_walk_triangles(c, kind, apex, steps, via, s)
    return best, solution


@njit(nogil=True)
def _find_lightest_walk(
    start: int,
    order: np.ndarray,
    rank: np.ndarray,
    turn: tuple[int, int],
    first: np.ndarray,
    second: np.ndarray,
    steps: np.ndarray,
    sizes: np.ndarray,
    costs: np.ndarray,
    by_target: tuple[np.ndarray, np.ndarray],
    none: Any,
    walk: np.ndarray,
    via: np.ndarray,
) -> Any:
    """Return the minimum weight of a closed walk over bridges; write the last steps to `via`.

    order: bridges by their sums of positions; rank (e,): index of each bridge in `order`. The walk
    visits those after `start`, then, a turn ahead (m, q), those from the beginning to `start`.
    sizes, costs (s,): ring sides that a step advances, and weight of its triangle and pocket.
    by_target: steps by the bridge after them. walk, via (e,): weight and last step of the lightest
    walk to each bridge.
    """
    begin, items = by_target
    m, q = turn
    walk[:] = none
    walk[start] = 0
    total, after = none, rank[start] + 1
    for number in range(after, after + len(order)):
        is_ahead = number >= len(order)
        b = order[number - len(order) if is_ahead else number]
        o, h = first[b] - first[start], second[b] - second[start]
        if is_ahead:
            o, h = o + m, h + q
        if not (0 <= o <= m and 0 <= h <= q):
            continue  # b crosses the bridge `start`, so no walk visits b
        total = none
        for index in range(begin[b], begin[b + 1]):
            k = items[index]
            value = walk[steps[k, 0]] + costs[k]
            if o + h >= sizes[k] and value < total:
                total, via[b] = value, k
        if b != start:
            walk[b] = total
    return total


@njit(nogil=True)
def _list_walk_triangles(
    candidates: Candidates,
    kind: np.ndarray,
    apex: np.ndarray,
    steps: np.ndarray,
    via: np.ndarray,
    start: int,
) -> np.ndarray:
    """Return the triangles (m,) of the lightest closed walk from bridge `start` and its pockets."""
    triangles = np.empty(len(apex), dtype=np.int64)
    stack = np.empty(len(apex), dtype=np.int64)
    size, height, b = 0, 0, start
    while size == 0 or b != start:
        step = steps[via[b]]
        b = step[0]
        triangles[size] = step[2]
        size += 1
        stack[height] = step[3]
        height += 1
    while height > 0:
        height -= 1
        e = stack[height]
        if kind[e] == POCKET:
            t = apex[e]
            triangles[size] = t
            size += 1
            for other in candidates.triangle_edges[t]:
                if other != e:
                    stack[height] = other
                    height += 1
    return triangles[:size]
