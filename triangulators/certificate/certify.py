"""How far a triangulation is from the optimum, with a bound that is checked apart."""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import shapely

from triangulators import criteria
from triangulators.certificate.proof import SECONDS, prove
from triangulators.checking import checker
from triangulators.checking.evidence import Certificate, Evidence
from triangulators.checking.units import Units, doubles_add_up, exact_total, is_proof, units_for
from triangulators.criteria import Criterion
from triangulators.criteria.cost import Cost, cost_of, require_number
from triangulators.errors import TriangulationError
from triangulators.geometry.half_edges import twins_of
from triangulators.geometry.visibility import visible_pairs
from triangulators.initial import ring_triangulation
from triangulators.optimum.best_way import optimum
from triangulators.optimum.visible_lists import far_costs
from triangulators.polygon import Boundary, boundary_area, checked_boundary
from triangulators.verify import verify_boundary

TABLE = 2000  # vertices up to which a polygon without holes is proven by the table


def certify(
    polygon: shapely.Polygon,
    triangles: np.ndarray,
    criterion: Criterion | str | Callable[..., float] = "half-perimeter",
    *,
    seconds: float = SECONDS,
    evidence: bool = True,
    **parameters: Any,
) -> Certificate:
    """Return what a triangulation costs, and the least that any could cost.

    triangles: (m, 3) indices into `vertices(polygon)`, conforming. Any criterion that sums over
    triangles will do; parameters are the criterion's. Without holes, up to 2,000 vertices, the
    bound is the table over all sub-polygons. Otherwise it is a linear program's over all empty
    triangles. `checker` checks either in whole numbers; costs that are no whole numbers are rounded
    down after the tenth digit of the total first (see `checking.units` and `Certificate`). A
    polygon with more than eight million triples that see each other gets no bound. seconds: for
    each linear program; where they do not suffice the bound is lower than it could be and nothing
    is proven. evidence: if False, a table whose sums are exact in doubles is taken at its word,
    without evidence, in a fraction of the time.

    Raises `TriangulationError` if the triangles are no conforming triangulation of the polygon,
    or the criterion is no number for a triangle; `InvalidPolygonError`, `UnknownNameError`.

    >>> from shapely import Polygon
    >>> from triangulators import certify, triangulate
    >>> square = Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(2, 2), (2, 4), (4, 3)]])
    >>> certify(square, triangulate(square, "optimal:half-perimeter"))
    Certificate(cost=75.0, lower_bound=75.0, gap=0.0, proven=True)
    >>> certify(square, triangulate(square, "delaunay"))
    Certificate(cost=79.0, lower_bound=75.0, gap=0.0506..., proven=False)
    """
    outline = checked_boundary(polygon)
    wanted = criteria.find(criterion, **parameters)
    corners = _conforming(outline, triangles)
    require_number(wanted, outline.points, corners)
    cost = cost_of(wanted, boundary_area(outline), outline.expected_triangles)
    if outline.holes == 0 and len(outline.edges) <= TABLE:
        units = units_for(outline, corners, cost)
        if not evidence and doubles_add_up(outline, cost):
            return _by_table(outline, corners, cost, units)
        return certificate_of(outline, corners, cost, _ring_evidence(outline, corners, cost, units))
    proof = prove(outline, corners, cost, seconds)
    if proof is None:
        total = exact_total(outline, corners, cost, units_for(outline, corners, cost))
        return Certificate(float(total), -math.inf, math.inf, False)
    return certificate_of(outline, corners, cost, proof.evidence())


def _ring_evidence(outline: Boundary, triangles: np.ndarray, cost: Cost, units: Units) -> Evidence:
    """Return evidence of the least that a triangulation of a polygon without holes costs.

    triangles: (m, 3), any triangulation of it, between sites; units: those of the claim. The costs
    of all sub-polygons are potentials of the pairs that see each other: see `far_costs`.
    """
    ring = outline.edges[:, 0].copy()
    place = np.empty(len(outline.points), dtype=np.int32)
    place[ring] = np.arange(len(ring), dtype=np.int32)
    local = np.ascontiguousarray(place[triangles])
    start, target = visible_pairs(outline.points[ring], local, twins_of(local), len(ring) ** 2)
    far, _ = far_costs(start, target, outline.points, ring, cost, units)
    a, b = np.repeat(ring, np.diff(start)), ring[target]
    edges = np.column_stack((np.minimum(a, b), np.maximum(a, b)))
    return Evidence(*units[:3], edges, np.where(a < b, -far, far), 0)


def certificate_of(
    outline: Boundary, triangles: np.ndarray, cost: Cost, evidence: Evidence
) -> Certificate:
    """Return the certificate of a triangulation (m, 3), between sites, that evidence gives it.

    Raises `CertificateError` if the evidence does not hold.
    """
    units = units_for(outline, triangles, cost)
    total = exact_total(outline, triangles, cost, units)
    # A unit is more than the noise of any triangulation: what exceeds a whole number of units is
    # noise.
    least = checker.lower_bound(outline, triangles, cost, evidence) // units.factor
    proven = is_proof(total, least, len(triangles), units)
    if not (units.exact or units.real):  # doubles do not compute it: each is off by under a unit
        least -= len(triangles)
    bound = Fraction(least) / Fraction(units.scale)
    return Certificate(float(total), _down(bound), _gap(total, bound), proven, evidence)


def _conforming(outline: Boundary, triangles: np.ndarray) -> np.ndarray:
    """Return triangles between sites; raises `TriangulationError` if they do not conform."""
    found = verify_boundary(outline, triangles)
    if not found.conforming:
        where = found.problems[0] if found.problems else f"T-junction at {found.t_junctions[0]}"
        raise TriangulationError(f"not a conforming triangulation: {where}")
    return np.ascontiguousarray(outline.site[triangles], dtype=np.int32)


def _by_table(outline: Boundary, triangles: np.ndarray, cost: Cost, units: Units) -> Certificate:
    """Return a certificate by the table in doubles, where these are exact."""
    cycle = outline.edges[:, 0]
    best = cycle[optimum(outline.points[cycle], ring_triangulation(outline, cycle), cost)]
    total = exact_total(outline, triangles, cost, units)
    bound = exact_total(outline, best, cost, units)
    return Certificate(float(total), _down(bound), _gap(total, bound), total == bound)


def _down(value: Fraction) -> float:
    """Return the greatest float that is not above a number."""
    nearest = float(value)
    return nearest if nearest <= value else math.nextafter(nearest, -math.inf)


def _gap(total: Fraction, bound: Fraction) -> float:
    """Return (total - bound) / |total|; 0 where they are equal."""
    if total == bound:
        return 0.0
    return float((total - bound) / abs(total)) if total else math.inf
