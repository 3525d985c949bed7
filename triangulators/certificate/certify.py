"""Certificates: a triangulation's gap to the optimum, by an independently checked lower bound."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import shapely

from triangulators import criteria
from triangulators.certificate.proof import PROGRAM_TIMEOUT_S, prove
from triangulators.checking import checker
from triangulators.checking.evidence import (
    Certificate,
    Evidence,
    Units,
    compute_exact_total,
    find_units,
    has_exact_sums,
    proves_optimality,
)
from triangulators.criteria.cost import Cost, make_cost, require_finite_total
from triangulators.criteria.criterion import CriterionLike
from triangulators.errors import TriangulationError
from triangulators.initial import find_ring_triangulation, make_cycle
from triangulators.optimum.best_way import find_optimum
from triangulators.optimum.visible_lists import compute_far_costs
from triangulators.polygon import Boundary, boundary_area, checked_boundary
from triangulators.verify import verify_boundary

MAX_RING_VERTICES = 2000  # for rings whose lower bound a dynamic program computes


def certify(
    polygon: shapely.Polygon,
    triangles: np.ndarray,
    criterion: CriterionLike = "half-perimeter",
    *,
    seconds: float = PROGRAM_TIMEOUT_S,
    evidence: bool = True,
    **parameters: Any,
) -> Certificate:
    """Return the cost of a triangulation, and a checked lower bound over all triangulations.

    Parameters
    ----------
    polygon
        A valid polygon; holes are allowed.
    triangles
        (m, 3) indices into `vertices(polygon)`, a conforming triangulation.
    criterion
        A name, a `Criterion`, or a Numba function of three points (six numbers).
    seconds
        Time limit of each linear program. A program that reaches the limit gives a weak bound, and
        the triangulation is not proven optimal.
    evidence
        False to omit the evidence and its check for polygons without holes, if a dynamic program
        finds the optimum with exact sums in doubles, which takes a fraction of the time; no effect
        on other polygons.
    **parameters
        Parameters of the criterion.

    Returns
    -------
    Certificate
        The cost, the bound, and evidence of the bound.

    Raises
    ------
    InvalidPolygonError
        If the polygon is invalid or empty.
    UnknownNameError
        If there is no such criterion.
    TriangulationError
        If the triangles are not a conforming triangulation of the polygon, or the criterion is not
        a finite number for a triangle.

    Notes
    -----
    For polygons without holes, up to 2,000 vertices, a dynamic program over all sub-polygons gives
    the bound; for all others a dynamic or a linear program over the triangles that local minimality
    does not exclude. `checker` verifies either bound in integers; costs that are not integers are
    rounded down after the tenth digit of the total (see `checking.evidence`). A polygon with more
    than eight million triples of mutually visible vertices gets no bound.

    Examples
    --------
    >>> from shapely import Polygon
    >>> from triangulators import certify, triangulate
    >>> square = Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(2, 2), (2, 4), (4, 3)]])
    >>> certify(square, triangulate(square, "optimal:half-perimeter"))
    Certificate(cost=75.0, lower_bound=75.0, gap=0.0, proven=True)
    >>> certify(square, triangulate(square, "delaunay"))
    Certificate(cost=79.0, lower_bound=75.0, gap=0.0506..., proven=False)
    """
    outline = checked_boundary(polygon)
    sum_criterion = criteria.find(criterion, **parameters)
    site_triangles = _require_conforming(outline, triangles)
    require_finite_total(sum_criterion, outline.points, site_triangles)
    cost = make_cost(sum_criterion, boundary_area(outline), outline.expected_triangles)
    if outline.holes == 0 and len(outline.edges) <= MAX_RING_VERTICES:
        units = find_units(outline, site_triangles, cost)
        if not evidence and has_exact_sums(outline, cost):
            return _certify_exact_sums(outline, site_triangles, cost, units)
        certified = _make_ring_evidence(outline, site_triangles, cost, units)
        return make_certificate(outline, site_triangles, cost, certified)
    proof = prove(outline, site_triangles, cost, seconds)
    if proof is None:
        total = compute_exact_total(
            outline, site_triangles, cost, find_units(outline, site_triangles, cost)
        )
        return Certificate(float(total), -math.inf, math.inf, False)
    return make_certificate(outline, site_triangles, cost, proof.make_evidence())


def _make_ring_evidence(
    outline: Boundary, triangles: np.ndarray, cost: Cost, units: Units
) -> Evidence:
    """Return evidence of the optimum of a polygon without holes, from any triangulation (m, 3)."""
    ring = make_cycle(outline, "certify", triangles)
    costs, _ = compute_far_costs(ring.start, ring.target, outline.points, ring.cycle, cost, units)
    a, b = np.repeat(ring.cycle, np.diff(ring.start)), ring.cycle[ring.target]
    edges = np.column_stack((np.minimum(a, b), np.maximum(a, b)))
    return Evidence(*units[:3], edges, np.where(a < b, -costs, costs), 0)


def make_certificate(
    outline: Boundary, triangles: np.ndarray, cost: Cost, evidence: Evidence
) -> Certificate:
    """Check evidence; return the certificate of a triangulation (m, 3) of sites."""
    units = find_units(outline, triangles, cost)
    total = compute_exact_total(outline, triangles, cost, units)
    # Weights contain hashes of edges, which break ties (see `checking.evidence`) and sum to less
    # than units.factor over all triangles: the floor division removes the hashes.
    bound_units = checker.compute_lower_bound(outline, triangles, cost, evidence) // units.factor
    proven = proves_optimality(total, bound_units, len(triangles), units)
    if not (units.exact or units.real):
        # Integer costs too large for doubles are each rounded by less than a unit: lower the bound.
        bound_units -= len(triangles)
    bound = Fraction(bound_units) / Fraction(units.scale)
    return Certificate(
        float(total), _round_down(bound), _compute_gap(total, bound), proven, evidence
    )


def _require_conforming(outline: Boundary, triangles: np.ndarray) -> np.ndarray:
    """Return the triangles (m, 3) of sites; raise `TriangulationError` unless they conform."""
    verification = verify_boundary(outline, triangles)
    if not verification.conforming:
        problem = (
            verification.problems[0]
            if verification.problems
            else "vertex {} is inside the edge {} of a triangle (T-junction)".format(
                *verification.t_junctions[0]
            )
        )
        raise TriangulationError(f"not a conforming triangulation: {problem}")
    return np.ascontiguousarray(outline.site[triangles], dtype=np.int32)


def _certify_exact_sums(
    outline: Boundary, triangles: np.ndarray, cost: Cost, units: Units
) -> Certificate:
    """Return a certificate without evidence, by a dynamic program with exact sums in doubles."""
    ring = outline.edges[:, 0]
    optimal = ring[find_optimum(outline.points[ring], find_ring_triangulation(outline, ring), cost)]
    total = compute_exact_total(outline, triangles, cost, units)
    bound = compute_exact_total(outline, optimal, cost, units)
    return Certificate(float(total), _round_down(bound), _compute_gap(total, bound), total == bound)


def _round_down(value: Fraction) -> float:
    nearest = float(value)
    return nearest if nearest <= value else math.nextafter(nearest, -math.inf)


def _compute_gap(total: Fraction, bound: Fraction) -> float:
    if total == bound:
        return 0.0
    return float((total - bound) / abs(total)) if total else math.inf
