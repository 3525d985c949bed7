"""Check a certificate of optimality: exact arithmetic, and nothing of the search that found it.

What is checked, from the polygon's boundary, the criterion and the triangles alone:

1. Units of weights follow from them (`units`); evidence that was made in others is refused.
2. The polygon's edges and empty triangles are enumerated here, from exact orientations (`edges`): a
   triangle is three edges that run round no hole.
3. With y the potential of an edge (its negative, run the other way), y(ab) + y(bc) + y(ca) + lift
   is at most the weight of abc, for every empty triangle; an edge that the evidence
   does not name has 0. Summed over a triangulation the potentials of diagonals cancel: what is left
   is the sum over the boundary plus lift times the number of triangles. That is the lower bound.
4. A bound above the weight of the triangles that it is about contradicts itself, and is refused.

Shared with the search are definitions: a polygon's boundary, the sign of an orientation, what a
triangle costs and in which units.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from triangulators.checking.edges import Edges, around_hole, edges_of
from triangulators.checking.evidence import CertificateError, Evidence
from triangulators.checking.units import TOO_LARGE, Units, units_for, weight, weights_of
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost
from triangulators.devices import cores
from triangulators.geometry.predicates import turn
from triangulators.polygon import Boundary

_FEW, _SLICES = 20_000, 16  # edges from which on they are shared out among threads; slices


def lower_bound(outline: Boundary, triangles: np.ndarray, cost: Cost, evidence: Evidence) -> int:
    """Return the proven bound, in weights; raise `CertificateError` if the evidence is invalid.

    triangles: (m, 3), the triangulation that the evidence is about, between sites.
    """
    units = units_for(outline, triangles, cost)
    if evidence.units != units[:3]:
        raise CertificateError(
            f"the evidence has the units {evidence.units}; here they are {units[:3]}"
        )
    edges = edges_of(outline)
    if (edges.find(triangles[:, [0, 1, 1, 2, 2, 0]]) < 0).any():
        raise CertificateError("a side of a triangle is no edge")
    pairs, potentials, lift = evidence.edges, evidence.potentials, int(evidence.lift)
    if ((pairs < 0) | (pairs >= len(edges.points))).any():
        raise CertificateError("the evidence has an edge between vertices that are none")
    if len(potentials) != len(pairs):
        raise CertificateError("potentials and edges differ in number")
    if max(map(abs, [lift, *potentials.tolist()])) >= TOO_LARGE:
        raise CertificateError("a potential or the lift is too large for exact arithmetic")
    at = edges.find(pairs)  # what is no edge bounds nothing
    if len(np.unique(at[at >= 0])) != np.count_nonzero(at >= 0):
        raise CertificateError("an edge is given twice")
    potential = np.zeros(len(edges.ends), dtype=np.int64)
    potential[at[at >= 0]] = potentials[at >= 0]
    _check_potentials(edges, potential, lift, cost, units)
    around = zip(potential.tolist(), edges.ways.tolist(), strict=True)
    bound: int = sum(y * way for y, way in around) + lift * outline.expected_triangles
    if bound > sum(weights_of(outline.points, triangles, cost, units).tolist()):
        raise CertificateError("the bound is above what the triangulation costs")
    return bound


def _check_potentials(
    edges: Edges, potential: np.ndarray, lift: int, cost: Cost, units: Units
) -> None:
    """Check y(ab) + y(bc) + y(ca) + lift <= weight(abc) for every empty triangle.

    Raises `CertificateError` if a triangle violates it.

    potential (e,), lift and weights are below 2^60: sums of five then fit 64 bits. Triangles are
    found one after the other, by a merge of what two ends of an edge see, and none is kept: the
    time goes by how many see each end, summed over the edges, the memory by the edges.
    """
    n = len(edges.points)
    starts = np.searchsorted(edges.keys, np.arange(n + 1, dtype=np.int64) * n)
    slices = _SLICES if len(edges.ends) > _FEW else 1

    def first_of(number: int) -> list[int]:
        found = _exceeded(edges, starts, potential, lift, cost, units, number, slices)
        return list(found.tolist())

    with ThreadPoolExecutor(min(slices, cores())) as pool:
        wrong = [each for each in pool.map(first_of, range(slices)) if each]
    if wrong and len(wrong[0]) == 1:
        raise CertificateError("a weight is too large for exact arithmetic")
    if wrong:
        raise CertificateError(f"the potentials exceed the weight of the triangle {wrong[0]}")


@njit(nogil=True)
def _exceeded(
    edges: Edges,
    starts: np.ndarray,
    potential: np.ndarray,
    lift: int,
    cost: Cost,
    units: Units,
    number: int,
    slices: int,
) -> np.ndarray:
    """Return the corners of the first empty triangle that breaks the inequality.

    Looked at are the edges `number`, `number` + `slices` and so on, each with the triangles of
    which it joins the lowest two corners. An empty array if none breaks it; an array of length 1
    where a weight is too large.
    """
    ends, ways = edges.ends, edges.ways
    for e in range(number, len(ends), slices):
        a, b = ends[e, 0], ends[e, 1]
        # Edges ascend: those of a after e lead to c > b, those of b from starts[b] on, too. What
        # both reach is a third corner, so that each triangle comes up once, as a < b < c.
        p, q = e + 1, starts[b]
        while p < starts[a + 1] and q < starts[b + 1]:
            if ends[p, 1] < ends[q, 1]:
                p += 1
            elif ends[p, 1] > ends[q, 1]:
                q += 1
            else:
                # Counter-clockwise, a left turn runs a to b, b to c and c to a: with the first two
                # edges and against the third; a right turn the other way. A side of the boundary
                # must be run in its own way, or the triangle is outside.
                c = ends[p, 1]
                run = 1 if turn(edges.points, a, b, c) > 0.0 else -1
                outside = ways[e] == -run or ways[q] == -run or ways[p] == run
                i, j, k = (a, b, c) if run > 0 else (a, c, b)
                if not outside and not around_hole(edges.points, edges.holes, i, j, k):
                    own = weight(edges.points, i, j, k, cost, units)
                    if own >= TOO_LARGE:
                        return np.zeros(1, dtype=np.int32)
                    # Potentials count from lower to higher end, so that a-c counts against.
                    around = run * (potential[e] + potential[q] - potential[p])
                    if own - around < lift:
                        return np.array((i, j, k), dtype=np.int32)
                p += 1
                q += 1
    return np.empty(0, dtype=np.int32)
