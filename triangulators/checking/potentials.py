"""Check that potentials exceed no triangle's weight, by a merge of what two ends of an edge see.

For every empty triangle of the edges given, y(ab) + y(bc) + y(ca) + lift is at most its weight.
Triangles are found one after the other and none is kept: the time goes by their number, the memory
by the edges.
"""

import numpy as np

from triangulators.checking.edges import Edges, around_hole
from triangulators.checking.evidence import Refused
from triangulators.checking.units import Units
from triangulators.checking.weights import TOO_LARGE, weight_of
from triangulators.compute.kernels import njit
from triangulators.compute.threads import shared_out
from triangulators.criteria.cost import Cost
from triangulators.geometry.predicates import turn

_FEW, _SLICES = 20_000, 16  # edges from which on they are shared out among threads; slices


def check_potentials(
    edges: Edges, potential: np.ndarray, lift: int, cost: Cost, units: Units
) -> None:
    """Raise `Refused` unless potentials (e,) and lift hold for every empty triangle.

    They are below 2^60: sums of three then fit 64 bits.
    """
    n = len(edges.points)
    starts = np.searchsorted(edges.keys, np.arange(n + 1, dtype=np.int64) * n)
    slices = _SLICES if len(edges.ends) > _FEW else 1

    def worst_of(number: int) -> list[int]:
        found = _exceeded(edges, starts, potential, lift, cost, units, number, slices)
        return list(found.tolist())

    wrong = [each for each in shared_out(worst_of, slices) if each]
    if wrong and len(wrong[0]) == 1:
        raise Refused("a weight is too large for exact arithmetic")
    if wrong:
        raise Refused(f"the potentials exceed the weight of the triangle {wrong[0]}")


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
    """Return an empty triangle whose weight the potentials exceed by more than -lift.

    From every `slices`-th edge on, which is its lowest corner's edge to the next. An empty array if
    there is none, one of length 1 where a weight is too large.
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
                    weight = weight_of(edges.points, i, j, k, cost, units)
                    if weight >= TOO_LARGE:
                        return np.zeros(1, dtype=np.int32)
                    # Potentials count from lower to higher end, so that a-c counts against.
                    around = run * (potential[e] + potential[q] - potential[p])
                    if weight - around < lift:
                        return np.array((i, j, k), dtype=np.int32)
                p += 1
                q += 1
    return np.empty(0, dtype=np.int32)
