"""Check a certificate of optimality: exact arithmetic, and nothing of the search that found it.

What is checked, from the polygon's boundary, the criterion and the triangles alone:

1. Units of weights follow from them (`units`); evidence that was made in others is refused.
2. The polygon's edges and empty triangles are enumerated here, from exact orientations (`edges`): a
   triangle is three edges that run round no hole.
3. Each excluded edge, in the evidence's order: every pair of triangles of edges not yet excluded,
   one on each of its sides, makes a strictly convex quadrilateral whose other diagonal weighs less
   (`exclusions`). So no triangulation of least weight contains the edge.
4. With y the potential of an edge (its negative, run the other way), y(ab) + y(bc) + y(ca) + lift
   is at most the weight of abc, for every triangle of edges that are not excluded (`potentials`).
   Summed over a triangulation the potentials of diagonals cancel: what is left is the sum over the
   boundary plus lift times the number of triangles. That is the lower bound. Where the evidence
   branches, once with an edge and once without it, the lower of the two bounds holds.
5. A bound above the weight of the triangles that it is about contradicts itself, and is refused.

Shared with the search are definitions: a polygon's boundary, the sign of an orientation, what a
triangle costs and in which units.
"""

import operator
from typing import Any, NamedTuple

import numpy as np

from triangulators.checking.edges import Edges, crossing, edges_of
from triangulators.checking.evidence import Branch, Evidence, Leaf, Refused
from triangulators.checking.exclusions import check_excluded
from triangulators.checking.potentials import check_potentials
from triangulators.checking.units import Units, units_for, wide_costs
from triangulators.checking.weights import TOO_LARGE, weights_in_order
from triangulators.criteria.cost import Cost
from triangulators.polygon import Boundary

_DEEPEST = 200  # branches below each other


def lower_bound(outline: Boundary, triangles: np.ndarray, cost: Cost, evidence: Evidence) -> int:
    """Return the bound, in weights, that the evidence proves; raises `Refused` if it does not.

    triangles: (m, 3), the triangulation that the evidence is about, between sites.
    """
    units = units_for(outline, triangles, cost)
    if evidence.units != units[:3]:
        raise Refused(f"the evidence has the units {evidence.units}; here they are {units[:3]}")
    edges = edges_of(outline)
    if (edges.find(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)) < 0).any():
        raise Refused("a side of a triangle is no edge")
    pairs = _whole(evidence.edges, "edges").reshape(-1, 2)
    order = _whole(evidence.excluded, "exclusions")
    if ((pairs < 0) | (pairs >= len(edges.points))).any():
        raise Refused("the evidence has an edge between vertices that are none")
    if ((order < 0) | (order >= len(pairs))).any():
        raise Refused("the evidence excludes an edge that it does not have")
    order = edges.find(pairs[order])
    order = order[order >= 0]  # what is no edge needs no excluding
    if len(np.unique(order)) != len(order):
        raise Refused("an edge is excluded twice")
    excluded = np.zeros(len(edges.ends), dtype=np.bool_)
    if len(order):
        if units.wide:
            raise Refused("costs this large are proven without excluding edges")
        check_excluded(edges, order, cost, units)
    excluded[order] = True
    given = _Given(edges, edges.find(pairs), cost, units, outline.expected_triangles)
    bound = _bound(given, evidence.root, excluded, 0)
    if bound > _weight(outline, triangles, cost, units):
        raise Refused("the bound is above what the triangulation costs")
    return bound


class _Given(NamedTuple):
    """What a bound is about; at (k,): the number of each of the evidence's edges, -1 for none."""

    edges: Edges
    at: np.ndarray
    cost: Cost
    units: Units
    triangles: int


def _bound(given: _Given, node: Leaf | Branch, out: np.ndarray, depth: int) -> int:
    """Return the bound for triangulations without the edges that are out (e,)."""
    edges = given.edges
    if isinstance(node, Branch):
        ends = _whole(node.edge, "branches")
        inside = ends.shape == (2,) and ends.min() >= 0 and ends.max() < len(edges.points)
        edge = int(edges.find(ends)[0]) if inside else -1
        if edge < 0 or edges.ways[edge] != 0:
            raise Refused(f"the evidence branches on {node.edge}, which is no diagonal")
        if depth == _DEEPEST:
            raise Refused("the evidence branches too often")
        # Without the edge, or with it: then nothing that crosses it is there.
        without = out.copy()
        without[edge] = True
        within = out | crossing(edges.points, edges.ends, *edges.ends[edge].tolist())
        return min(
            _bound(given, node.without, without, depth + 1),
            _bound(given, node.within, within, depth + 1),
        )
    wide = given.units.wide
    potentials = _whole(node.potentials, "potentials", object if wide else np.int64)
    if len(potentials) != len(given.at):
        raise Refused("potentials and edges differ in number")
    lift = _integer(node.lift)
    if not wide and max(abs(lift), *(abs(int(p)) for p in _ends(potentials))) >= TOO_LARGE:
        raise Refused("a potential or the lift is too large for exact arithmetic")
    potential = np.zeros(len(edges.ends), dtype=potentials.dtype)
    potential[given.at[given.at >= 0]] = potentials[given.at >= 0]
    left = np.flatnonzero(~out)
    check_potentials(edges.left(left), potential[left], lift, given.cost, given.units)
    on = edges.ways != 0
    around = zip(potential[on].tolist(), edges.ways[on].tolist(), strict=True)
    return sum(y * way for y, way in around) + lift * given.triangles


def _ends(values: np.ndarray) -> list[int]:
    return [values.min(), values.max()] if len(values) else [0]


def _weight(outline: Boundary, triangles: np.ndarray, cost: Cost, units: Units) -> int:
    """Return what a triangulation weighs."""
    if units.wide:
        return sum(wide_costs(outline.points, triangles, cost))
    return sum(weights_in_order(outline.points, triangles, cost, units).tolist())


def _whole(values: Any, what: str, kind: type = np.int64) -> np.ndarray:
    """Return values as an array of whole numbers; raises `Refused` unless they are."""
    found = np.asarray(values)
    try:
        if found.size == 0:
            return np.empty(found.shape, dtype=kind)
        if found.dtype == object or kind is object:
            listed = [operator.index(value) for value in found.ravel().tolist()]
            return np.array(listed, dtype=kind).reshape(found.shape)
    except (TypeError, OverflowError):
        found = np.empty(0)
    if not np.issubdtype(found.dtype, np.integer) or found.dtype == np.uint64:
        raise Refused(f"the evidence's {what} are not whole numbers of 64 bits")
    return found.astype(kind)


def _integer(value: Any) -> int:
    try:
        return operator.index(value)
    except TypeError:
        raise Refused("the lift is not a whole number") from None
