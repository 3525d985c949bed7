"""How far a triangulation is from the optimum, with a bound that is checked apart."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely

from triangulators import criteria
from triangulators.certificate.proof import SECONDS, prove
from triangulators.checking import checker
from triangulators.checking.evidence import Certificate, Evidence, Refused
from triangulators.criteria import Criterion
from triangulators.criteria.cost import Cost, cost_of, evaluate
from triangulators.criteria.integer_costs import costs_of
from triangulators.errors import TriangulationError
from triangulators.optimum.simple_polygon import optimum
from triangulators.polygon import Boundary, boundary, boundary_area, check
from triangulators.starting.starts import ring_triangulation
from triangulators.verify import verify_boundary

TABLE = 2000  # vertices up to which a polygon without holes is proven by the table
_ROUNDING = 1e-12  # by which two sums of floats may differ


def certify(
    polygon: shapely.Polygon,
    triangles: np.ndarray,
    criterion: Criterion | str | Callable[..., float] = "half-perimeter",
    *,
    seconds: float = SECONDS,
    **parameters: Any,
) -> Certificate:
    """Return what a triangulation costs, and the least that any could cost.

    triangles: (m, 3) indices into `vertices(polygon)`, conforming. Any criterion that sums over
    triangles will do; parameters are the criterion's. Without holes, up to 2,000 vertices, the
    bound is the table over all sub-polygons. Otherwise it is a linear program's over all empty
    triangles, checked in integers by `checker`; costs that are not whole on a grid are rounded
    down at the tenth digit of the total first. seconds: for each linear program; where they do not
    suffice the bound is lower than it could be and nothing is proven. A polygon with more than
    eight million empty triangles gets no bound if few of its edges can be excluded.

    Raises `TriangulationError` if the triangles are no conforming triangulation of the polygon,
    `InvalidPolygon`, `UnknownName`, and `ValueError` for a criterion that is a maximum.

    >>> from shapely import Polygon
    >>> from triangulators import certify, triangulate
    >>> square = Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(2, 2), (2, 4), (4, 3)]])
    >>> certify(square, triangulate(square, "optimal:half-perimeter"))
    Certificate(cost=75.0, lower_bound=75.0, gap=0.0, proven=True)
    >>> certify(square, triangulate(square, "delaunay"))
    Certificate(cost=79.0, lower_bound=75.0, gap=0.0506..., proven=False)
    """
    check(polygon)
    outline = boundary(polygon)
    wanted = criteria.find(criterion, **parameters)
    if wanted.maximum:
        raise ValueError(f"{wanted.name}: only a sum over triangles can be certified")
    corners = _conforming(outline, triangles)
    cost = cost_of(wanted, boundary_area(outline), outline.expected_triangles)
    if outline.holes == 0 and len(outline.edges) <= TABLE:
        return _by_table(outline, corners, cost)
    proof = prove(outline, corners, cost, seconds)
    if proof is None:
        total = evaluate(outline.points, corners, cost)
        return Certificate(total, -math.inf, math.inf, False)
    return certificate_of(outline, corners, cost, proof.evidence)


def certificate_of(
    outline: Boundary, triangles: np.ndarray, cost: Cost, evidence: Evidence
) -> Certificate:
    """Return the certificate of a triangulation (m, 3), between sites, that evidence gives it.

    Raises `Refused` if the evidence does not hold.
    """
    costs = costs_of(outline.points, triangles, cost)
    units = sum(np.floor(costs * evidence.scale).astype(np.int64).tolist())
    # A unit is more than the noise of any triangulation: what exceeds a whole number of units is
    # noise (see `integer_costs`).
    least = checker.lower_bound(outline, cost, evidence) // evidence.factor
    total, bound = math.fsum(costs.tolist()), float(least / evidence.scale)
    return Certificate(total, bound, _gap(total, bound), least >= units, evidence)


def check_certificate(
    polygon: shapely.Polygon,
    triangles: np.ndarray,
    criterion: Criterion | str | Callable[..., float],
    certificate: Certificate,
    **parameters: Any,
) -> None:
    """Raise `Refused` unless a certificate with evidence holds for a triangulation.

    triangles: (m, 3) indices into `vertices(polygon)`. Raises `TriangulationError` if they are no
    conforming triangulation.
    """
    outline = boundary(polygon)
    corners = _conforming(outline, triangles)
    if certificate.evidence is None:
        raise Refused("the certificate has no evidence")
    cost = cost_of(
        criteria.find(criterion, **parameters), boundary_area(outline), outline.expected_triangles
    )
    true = certificate_of(outline, corners, cost, certificate.evidence)
    if certificate.cost != true.cost:
        raise Refused(f"the cost is {true.cost}, not {certificate.cost}")
    if certificate.lower_bound > true.lower_bound:
        raise Refused(f"the bound is {true.lower_bound}, not {certificate.lower_bound}")
    if certificate.gap < true.gap or (certificate.proven and not true.proven):
        raise Refused(f"the gap is {true.gap}: optimality is not proven")


def _conforming(outline: Boundary, triangles: np.ndarray) -> np.ndarray:
    """Return triangles between sites; raises `TriangulationError` if they do not conform."""
    found = verify_boundary(outline, triangles)
    if not found.conforming:
        where = found.problems[0] if found.problems else f"T-junction at {found.t_junctions[0]}"
        raise TriangulationError(f"not a conforming triangulation: {where}")
    return np.ascontiguousarray(outline.site[triangles], dtype=np.int32)


def _by_table(outline: Boundary, triangles: np.ndarray, cost: Cost) -> Certificate:
    cycle = outline.edges[:, 0]
    best = cycle[optimum(outline.points[cycle], ring_triangulation(outline, cycle), cost)]
    total = math.fsum(costs_of(outline.points, triangles, cost).tolist())
    bound = math.fsum(costs_of(outline.points, best, cost).tolist())
    if total <= bound + _ROUNDING * abs(bound):
        return Certificate(total, min(total, bound), _gap(total, min(total, bound)), True)
    return Certificate(total, bound, _gap(total, bound), False)


def _gap(total: float, bound: float) -> float:
    return (total - bound) / abs(total) if total != bound else 0.0
