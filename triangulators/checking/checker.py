"""Check a certificate of optimality in exact arithmetic, without code of the search.

1. The polygon, the criterion and the triangles determine the units of weights (`find_units`);
   evidence in other units is rejected.
2. The polygon's edges and empty triangles are enumerated here, from exact orientations (`edges`): a
   triangle is three edges that do not surround a hole.
3. With y the potential of an edge (negative in the opposite direction, 0 if missing from the
   evidence), y(ab) + y(bc) + y(ca) + lift must be at most the weight of abc, for every empty
   triangle. In the sum over a triangulation the potentials of diagonals cancel. What remains is the
   lower bound: the potentials of the boundary, plus lift times the number of triangles.
4. A bound above the weight of the certified triangles is a contradiction, and is rejected.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from triangulators.checking.edges import Edges, find_edges, surrounds_hole
from triangulators.checking.evidence import (
    TOO_LARGE,
    CertificateError,
    Evidence,
    Units,
    compute_weight,
    compute_weights,
    find_units,
)
from triangulators.compute.kernels import count_usable_cores, njit
from triangulators.criteria.cost import Cost
from triangulators.geometry.predicates import orientation
from triangulators.polygon import Boundary

_MAX_SINGLE_THREAD_EDGES = 20_000
_SLICES = 16  # number of subsets of the edges that threads check at the same time


def compute_lower_bound(
    outline: Boundary, triangles: np.ndarray, cost: Cost, evidence: Evidence
) -> int:
    """Return the bound that evidence proves, as a weight; raise `CertificateError` if invalid."""
    units = find_units(outline, triangles, cost)
    if evidence.weight_parameters != units[:3]:
        raise CertificateError(
            f"evidence: scale, factor and bits are {evidence.weight_parameters}; "
            f"expected {units[:3]}"
        )
    edges = find_edges(outline)
    if (edges.find_indices(triangles[:, [0, 1, 1, 2, 2, 0]]) < 0).any():
        raise CertificateError("triangles: a side is not an edge of the polygon")
    pairs, potentials, lift = evidence.edges, evidence.potentials, int(evidence.lift)
    if ((pairs < 0) | (pairs >= len(edges.points))).any():
        raise CertificateError("evidence: an edge has a vertex that is out of range")
    if len(potentials) != len(pairs):
        raise CertificateError("evidence: the numbers of potentials and edges differ")
    if max(map(abs, [lift, *potentials.tolist()])) >= TOO_LARGE:
        raise CertificateError("evidence: a potential or the lift is too large")
    indices = edges.find_indices(pairs)  # potentials of pairs that are not edges (-1) are ignored
    if len(np.unique(indices[indices >= 0])) != np.count_nonzero(indices >= 0):
        raise CertificateError("evidence: an edge is repeated")
    potential = np.zeros(len(edges.ends), dtype=np.int64)
    potential[indices[indices >= 0]] = potentials[indices >= 0]
    _check_potentials(edges, potential, lift, cost, units)
    terms = zip(potential.tolist(), edges.directions.tolist(), strict=True)
    bound: int = sum(y * direction for y, direction in terms) + lift * outline.expected_triangles
    if bound > sum(compute_weights(outline.points, triangles, cost, units).tolist()):
        raise CertificateError("evidence: the bound exceeds the weight of the triangulation")
    return bound


def _check_potentials(
    edges: Edges, potential: np.ndarray, lift: int, cost: Cost, units: Units
) -> None:
    """Check y(ab) + y(bc) + y(ca) + lift <= weight(abc) for every empty triangle.

    All terms are below 2^60, so that sums of five fit 64 bits. Triangles are not stored: the time
    is proportional to the sum of the degrees of all ends, the memory to the number of edges.
    """
    n = len(edges.points)
    starts = np.searchsorted(edges.keys, np.arange(n + 1, dtype=np.int64) * n)
    slices = _SLICES if len(edges.ends) > _MAX_SINGLE_THREAD_EDGES else 1

    def check_slice(number: int) -> list[int]:
        vertices = _find_violation(edges, starts, potential, lift, cost, units, number, slices)
        return list(vertices.tolist())

    with ThreadPoolExecutor(min(slices, count_usable_cores())) as pool:
        violations = [violation for violation in pool.map(check_slice, range(slices)) if violation]
    if violations and len(violations[0]) == 1:
        raise CertificateError("criterion: a triangle's cost is NaN, or too negative for 64 bits")
    if violations:
        raise CertificateError(
            f"evidence: potentials exceed the weight of triangle {violations[0]}"
        )


@njit(nogil=True)
def _find_violation(
    edges: Edges,
    starts: np.ndarray,
    potential: np.ndarray,
    lift: int,
    cost: Cost,
    units: Units,
    number: int,
    slices: int,
) -> np.ndarray:
    """Return the vertices of the first empty triangle a < b < c that violates the inequality.

    a-b is edge `number`, or every `slices`-th edge after it; starts (n + 1,): first edge of each a.
    The result is empty if there is no violation, and of length 1 if a weight is too large.
    """
    ends, directions = edges.ends, edges.directions
    for e in range(number, len(ends), slices):
        a, b = ends[e, 0], ends[e, 1]
        # Edges are in ascending order: the edges of a after e, and those of b from starts[b] on,
        # lead to vertices c > b. If both lists contain c, a-b-c is a triangle; each triangle is
        # visited once, as a < b < c.
        p, q = e + 1, starts[b]
        while p < starts[a + 1] and q < starts[b + 1]:
            if ends[p, 1] < ends[q, 1]:
                p += 1
            elif ends[p, 1] > ends[q, 1]:
                q += 1
            else:
                # A counter-clockwise triangle runs a to b, b to c and c to a: along the first two
                # edges and against the third; a clockwise one the other way. A triangle that runs
                # against a boundary edge is outside.
                c = ends[p, 1]
                sign = 1 if orientation(edges.points, a, b, c) > 0.0 else -1
                outside = directions[e] == -sign or directions[q] == -sign or directions[p] == sign
                i, j, k = (a, b, c) if sign > 0 else (a, c, b)
                if not outside and not surrounds_hole(edges.points, edges.holes, i, j, k):
                    triangle_weight = compute_weight(edges.points, i, j, k, cost, units)
                    if triangle_weight >= TOO_LARGE:
                        return np.zeros(1, dtype=np.int32)
                    # Potentials run from the lower to the higher end, so a-c is subtracted.
                    sums = sign * (potential[e] + potential[q] - potential[p])
                    if triangle_weight - sums < lift:
                        return np.array((i, j, k), dtype=np.int32)
                p += 1
                q += 1
    return np.empty(0, dtype=np.int32)
