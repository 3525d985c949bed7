"""Evidence for a polygon without holes: the table over all its sub-polygons, as potentials.

Number the corners 0..n-1 counter-clockwise and let far(i, j), for i < j that see each other, be the
least weight of a triangulation of the sub-polygon i, i + 1, ..., j:

    far(i, i + 1) = 0,    far(i, j) = the least far(i, k) + far(k, j) + weight(ikj) over k between.

Take -far(i, j) as the potential of the edge run from i to j, and so far(i, j) run from j to i. A
triangle i < k < j runs i-k, k-j and j-i, and the inequality that potentials must satisfy,

    -far(i, k) - far(k, j) + far(i, j) <= weight(ikj),

is what the least means. Sides of the boundary have 0, but for the one from n - 1 to 0, which has
far(0, n - 1): the bound is the optimum. Source: G. T. Klincsek, "Minimal triangulations of
polygonal domains", 1980. With v pairs that see each other it takes as many steps as triples do, at
most n^3 / 6, and 16 n^2 bytes.
"""

import numpy as np

from triangulators.certificate.integer_costs import weight
from triangulators.checking.evidence import Evidence
from triangulators.checking.units import Units
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost
from triangulators.geometry.half_edges import twins_of
from triangulators.geometry.visibility import visible_pairs
from triangulators.polygon import Boundary

_NOTHING = np.int64(2**62)  # of a pair that does not see each other; no weight reaches it


def ring_evidence(outline: Boundary, triangles: np.ndarray, cost: Cost, units: Units) -> Evidence:
    """Return evidence of the least that a triangulation of a polygon without holes costs.

    triangles: (m, 3), any triangulation of it, between sites; units: those of the claim.
    """
    cycle = outline.edges[:, 0].copy()
    n = len(cycle)
    place = np.empty(len(outline.points), dtype=np.int32)
    place[cycle] = np.arange(n, dtype=np.int32)
    local = np.ascontiguousarray(place[triangles])
    ring = outline.points[cycle]
    start, target = visible_pairs(ring, local, twins_of(local), n * n)
    first = np.repeat(np.arange(n, dtype=np.int32), np.diff(start))
    far = _far_costs(outline.points, cycle, start, target, cost, units)
    a, b = cycle[first], cycle[target[: len(first)]]
    edges = np.column_stack((np.minimum(a, b), np.maximum(a, b)))
    return Evidence(*units[:3], edges, np.where(a < b, -far, far), 0)


@njit(nogil=True)
def _far_costs(
    points: np.ndarray,
    cycle: np.ndarray,
    start: np.ndarray,
    target: np.ndarray,
    cost: Cost,
    units: Units,
) -> np.ndarray:
    """Return far (p,) of the pairs i, target[q] for q from start[i] to start[i + 1].

    Rows from the last to the first, and pairs of a row from near to far: what far(i, j) is made of
    is known by then. `back[j, k]` is far(k, j), so that both are read along a row.
    """
    n = len(cycle)
    row, back = np.full((n, n), _NOTHING), np.full((n, n), _NOTHING)
    far = np.zeros(start[n], dtype=np.int64)
    for i in range(n - 1, -1, -1):
        for q in range(start[i], start[i + 1]):
            j = target[q]
            if j > i + 1:
                best = _NOTHING
                for r in range(start[i], q):
                    k = target[r]
                    if back[j, k] < _NOTHING:
                        own = weight(points, cycle[i], cycle[k], cycle[j], cost, units)
                        best = min(best, row[i, k] + back[j, k] + own)
                far[q] = best
            row[i, j] = back[j, i] = far[q]
    return far
