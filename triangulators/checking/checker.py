"""Check a certificate of optimality: exact arithmetic, and nothing of the search that found it.

What is checked, from the polygon's boundary, the criterion and the triangles alone:

1. Units of weights follow from them (`units`); evidence that was made in others is refused.
2. The polygon's edges and empty triangles are enumerated here, from exact orientations (`edges`): a
   triangle is three edges that run round no hole.
3. With y the potential of an edge (its negative, run the other way), y(ab) + y(bc) + y(ca) + lift
   is at most the weight of abc, for every empty triangle (`potentials`); an edge that the evidence
   does not name has 0. Summed over a triangulation the potentials of diagonals cancel: what is left
   is the sum over the boundary plus lift times the number of triangles. That is the lower bound.
4. A bound above the weight of the triangles that it is about contradicts itself, and is refused.

Shared with the search are definitions: a polygon's boundary, the sign of an orientation, what a
triangle costs and in which units.
"""

import operator
from typing import Any

import numpy as np

from triangulators.checking.edges import edges_of
from triangulators.checking.evidence import Evidence, Refused
from triangulators.checking.potentials import check_potentials
from triangulators.checking.units import units_for
from triangulators.checking.weights import TOO_LARGE, weights_in_order
from triangulators.criteria.cost import Cost
from triangulators.polygon import Boundary


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
    if ((pairs < 0) | (pairs >= len(edges.points))).any():
        raise Refused("the evidence has an edge between vertices that are none")
    potentials, lift = _whole(evidence.potentials, "potentials"), _integer(evidence.lift)
    if len(potentials) != len(pairs):
        raise Refused("potentials and edges differ in number")
    if max(abs(lift), *(abs(int(p)) for p in _ends(potentials))) >= TOO_LARGE:
        raise Refused("a potential or the lift is too large for exact arithmetic")
    at = edges.find(pairs)  # what is no edge bounds nothing
    if len(np.unique(at[at >= 0])) != np.count_nonzero(at >= 0):
        raise Refused("an edge is given twice")
    potential = np.zeros(len(edges.ends), dtype=np.int64)
    potential[at[at >= 0]] = potentials[at >= 0]
    check_potentials(edges, potential, lift, cost, units)
    around = zip(potential.tolist(), edges.ways.tolist(), strict=True)
    bound: int = sum(y * way for y, way in around) + lift * outline.expected_triangles
    if bound > sum(weights_in_order(outline.points, triangles, cost, units).tolist()):
        raise Refused("the bound is above what the triangulation costs")
    return bound


def _ends(values: np.ndarray) -> list[int]:
    return [values.min(), values.max()] if len(values) else [0]


def _whole(values: Any, what: str) -> np.ndarray:
    """Return values as an array of whole numbers; raises `Refused` unless they are."""
    found = np.asarray(values)
    try:
        if found.size == 0:
            return np.empty(found.shape, dtype=np.int64)
        if found.dtype == object:
            listed = [operator.index(value) for value in found.ravel().tolist()]
            return np.array(listed, dtype=np.int64).reshape(found.shape)
    except (TypeError, OverflowError):
        found = np.empty(0)
    if not np.issubdtype(found.dtype, np.integer) or found.dtype == np.uint64:
        raise Refused(f"the evidence's {what} are not whole numbers of 64 bits")
    return found.astype(np.int64)


def _integer(value: Any) -> int:
    try:
        return operator.index(value)
    except TypeError:
        raise Refused("the lift is not a whole number") from None
