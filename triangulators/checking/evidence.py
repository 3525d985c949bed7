"""Evidence of optimality: integer weights of triangles, and the certificate that has the evidence.

Weights are integers, so that adding and comparing costs is exact. The units follow from the
polygon, the criterion and the certified triangulation, never from the claim's evidence: units that
are too coarse would prove anything. A triangle's cost is counted in units of 1 / scale, rounded
down. The weight of the triangle a-b-c is

    factor * (cost in units) + noise(ab) + noise(bc) + noise(ca)

The noise, a fixed hash of each edge (see `Evidence`), breaks ties, which are common in the L1
metric: both diagonals of a rectangle have equal lengths, and neither could be excluded. `factor`
exceeds the noise of a full triangulation, so a triangulation of minimum weight has minimum cost in
units, which is its weight // factor. Weights are clamped to 2^59 to fit 64 bits: a weight that is
too low leaves the bound valid. One that is too high would not: a cost far below 0, or NaN, gets the
weight `TOO_LARGE`, and the checker rejects all evidence.

Integer costs. Half-perimeter, overdraw and similar costs are sums and products of coordinates. If
coordinates are multiples of 2^-k, half-perimeters are integers in units of 2^-k, areas of triangles
in units of 4^-k / 2. If doubles compute each cost exactly, these are the units. If coordinates are
integers too large for that, no claim is proven. All other costs are real numbers, computed by the
criterion's function in doubles; a unit is then between 2^-36 and 2^-32 of the triangulation's cost.
If scale reaches its maximum, 2^900, units may be too coarse, and no claim is proven either.

docs/reference/files.md documents the fields of a file with a certificate. Such files are checked by
harness/export/check_evidence.py, which shares no code with this package.
"""

import math
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import shapely

from triangulators.compute.kernels import njit
from triangulators.criteria.cost import AREA, BBOX_AREA, HALF_PERIMETER, TRIANGLES, Cost, cost_at
from triangulators.errors import TriangulationError
from triangulators.polygon import Boundary, rings_of

FORMAT = "raster-harness evidence 1"
NOISE_BITS = 10
TOO_LARGE = 2**60  # exclusive limit of weights, potentials and lifts, so that sums fit 64 bits
_MAX_TOTAL = 2**61  # limit of four times the weight of the certified triangulation
_MAX_WEIGHT = 2**59  # maximum weight of a triangle, without noise
_ROUNDED_TOTAL_BITS = 36  # the total of costs that are rounded has up to 2^36 units
_MAX_COEFFICIENT = 1024  # sum of a criterion's absolute coefficients, if costs are counted exactly
_MAX_EXPONENT = 900  # largest exponent of `scale`, so that scaled costs do not overflow a double
_MAX_SCALE = 2.0**_MAX_EXPONENT
MAX_EXACT_INTEGER = 2.0**52  # integers up to which sums and halves of doubles are exact
_EXACT_FACTOR = 2.0**25  # integers up to which products are exact


class Units(NamedTuple):
    """The conversion of costs to weights; if `scale` is 2^900, the maximum, nothing is proven."""

    scale: float  # units in a cost of 1, a power of two
    factor: int  # weight of a unit
    bits: int  # an edge's noise is below 2^bits
    exact: bool  # no triangle's cost is rounded
    real: bool  # costs are real numbers: optimality is proven up to a relative error


def find_units(outline: Boundary, triangles: np.ndarray, cost: Cost) -> Units:
    """Return the units for certifying a polygon's triangulation (m, 3) of sites."""
    total = math.fsum(np.abs(compute_costs(outline.points, triangles, cost)).tolist())
    count = outline.expected_triangles
    scale, is_integer, _ = find_exact_scale(outline.points, cost)
    if scale > 0.0:
        for bits in (*range(NOISE_BITS, 1, -1), 0):
            factor = compute_weight_factor(count, bits)
            if 4.0 * total * scale * factor < _MAX_TOTAL:
                return Units(scale, factor, bits, True, False)
    exponent = _ROUNDED_TOTAL_BITS - math.frexp(total)[1] if total > 0.0 else 0
    # A multiple of 4, so that most triangulations of a polygon have the same units.
    exponent = max(-_MAX_EXPONENT, min(_MAX_EXPONENT, 4 * (exponent // 4)))
    for bits in (*range(NOISE_BITS, 1, -1), 0):
        factor = compute_weight_factor(count, bits)
        if factor << (_ROUNDED_TOTAL_BITS + 2) < _MAX_TOTAL:
            break
    return Units(2.0**exponent, factor, bits, False, not is_integer)


def compute_weight_factor(count: int, bits: int) -> int:
    """Return a power of two above the noise of `count` triangles; 1 if bits is 0 (no noise)."""
    return 1 << (3 * count * 2**bits).bit_length() if bits > 0 else 1


def has_exact_sums(outline: Boundary, cost: Cost) -> bool:
    """Whether doubles compute every cost, and every sum over a triangulation, exactly."""
    scale, _, max_units = find_exact_scale(outline.points, cost)
    return scale > 0.0 and max_units * outline.expected_triangles < MAX_EXACT_INTEGER


def compute_exact_total(
    outline: Boundary, triangles: np.ndarray, cost: Cost, units: Units
) -> Fraction:
    """Return the cost of a triangulation (m, 3): the exact sum of triangle costs in doubles."""
    costs = compute_costs(outline.points, triangles, cost)
    if units.exact:
        total: int = sum((costs * units.scale).astype(np.int64).tolist())
        return total / Fraction(units.scale)
    return sum(map(Fraction, costs.tolist()), Fraction(0))


def proves_optimality(total: Fraction, bound_units: int, count: int, units: Units) -> bool:
    """Whether a lower bound in units proves `count` triangles of cost `total` optimal.

    bound_units: the bound in units, not above the total. Costs are rounded down to units, so that a
    difference of less than a unit per triangle proves optimality, unless units may be too coarse.
    """
    bound = Fraction(bound_units) / Fraction(units.scale)
    if units.real and total != 0 and units.scale < _MAX_SCALE:
        return total - bound < count / Fraction(units.scale)
    return total == bound and (units.exact or units.real)


def find_exact_scale(points: np.ndarray, cost: Cost) -> tuple[float, bool, float]:
    """Return (scale, is_integer, max_units) of costs that doubles compute exactly.

    scale: units in a cost of 1, or 0.0 if doubles do not compute each cost exactly; is_integer: all
    coordinates are integers, of any size; max_units: upper bound of twice a triangle's cost.
    """
    if cost["custom"]:
        return 0.0, False, math.inf
    features = set(np.flatnonzero(cost["weights"]).tolist())
    coefficients = cost["weights"][sorted(features)]
    if not features <= {TRIANGLES, AREA, HALF_PERIMETER, BBOX_AREA} or (
        (coefficients != np.rint(coefficients)).any()
        or np.abs(coefficients).sum() > _MAX_COEFFICIENT
    ):
        return 0.0, False, math.inf
    box = bool(features & {AREA, BBOX_AREA})
    k = _count_binary_places(points)
    is_in_range = (2 * k + 1 if box else k) < _MAX_EXPONENT
    steps = float(np.ptp(points, axis=0).max()) * 2.0**k if is_in_range else math.inf
    max_units = float(np.abs(coefficients).sum()) * (2.0 * steps * steps if box else 2.0 * steps)
    if max_units < MAX_EXACT_INTEGER and (not box or steps < _EXACT_FACTOR):
        return (2.0 ** (2 * k + 1) if box else 2.0 ** max(k, 0)), k <= 0, max_units
    return 0.0, k <= 0, max_units


def _count_binary_places(points: np.ndarray) -> int:
    """Return the smallest k >= -16 such that 2^k times each coordinate (n, 2) is an integer."""
    mantissa, exponent = np.frexp(points[points != 0.0])
    digits = np.ldexp(mantissa, 53).astype(np.int64)
    # Number of trailing zero bits: digits & -digits is the lowest bit, and frexp's exponent of a
    # power of two is the bit's index plus 1.
    ending = np.frexp((digits & -digits).astype(float))[1] - 1
    return max(-16, int((53 - exponent - ending).max(initial=-16)))


@njit(nogil=True)
def compute_costs(points: np.ndarray, triangles: np.ndarray, cost: Cost) -> np.ndarray:
    """Return the costs (t,) of triangles (t, 3), computed with the lowest vertex index first."""
    result = np.empty(len(triangles))
    for t in range(len(triangles)):
        a, b, c = rotate_lowest_first(triangles[t, 0], triangles[t, 1], triangles[t, 2])
        result[t] = cost_at(points, a, b, c, cost)
    return result


@njit
def rotate_lowest_first(a: int, b: int, c: int) -> tuple[int, int, int]:
    """Put the lowest vertex index first: the last digit of a cost may depend on the order."""
    if b < a and b < c:
        return b, c, a
    if c < a and c < b:
        return c, a, b
    return a, b, c


@njit
def compute_noise(a: int, b: int, bits: int) -> np.int64:
    """Return the noise of the edge a-b, in 0..2^bits - 1: a hash of both ends by splitmix64."""
    x = np.uint64(min(a, b)) * np.uint64(0x9E3779B97F4A7C15)
    x += np.uint64(max(a, b)) * np.uint64(0xD1B54A32D192ED03)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    # splitmix64's last step is omitted: it changes only bits below the highest 31.
    return np.int64(x >> np.uint64(64 - bits)) if bits > 0 else np.int64(0)


@njit
def compute_units(points: np.ndarray, a: int, b: int, c: int, cost: Cost, units: Units) -> np.int64:
    """Return the cost of the triangle a-b-c in units, rounded down, without noise."""
    a, b, c = rotate_lowest_first(a, b, c)
    scaled = cost_at(points, a, b, c, cost) * units.scale
    max_units = float(_MAX_WEIGHT // units.factor)
    if not scaled >= -max_units:  # also true for NaN
        return np.int64(TOO_LARGE // units.factor)
    return np.int64(np.floor(min(scaled, max_units)))


@njit
def compute_weight(
    points: np.ndarray, a: int, b: int, c: int, cost: Cost, units: Units
) -> np.int64:
    """Return the weight of the triangle a-b-c: factor times units, plus noise (see module)."""
    cost_units, bits = compute_units(points, a, b, c, cost, units), units.bits
    return (
        cost_units * units.factor
        + compute_noise(a, b, bits)
        + compute_noise(b, c, bits)
        + compute_noise(c, a, bits)
    )


@njit(nogil=True)
def compute_weights(
    points: np.ndarray, triangles: np.ndarray, cost: Cost, units: Units
) -> np.ndarray:
    """Return the weight (t,) of each triangle (t, 3) of points (n, 2)."""
    result = np.empty(len(triangles), dtype=np.int64)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        result[t] = compute_weight(points, a, b, c, cost, units)
    return result


class CertificateError(TriangulationError):
    """The evidence of a certificate is invalid; the message is the reason."""


@dataclass(frozen=True)
class Evidence:
    """Evidence that no triangulation weighs less than a bound (see `checker`).

    The weight of a triangle is factor * floor(scale * cost) plus the noise of its three edges. The
    cost is computed with the vertex of the lowest index first. The noise of an edge a < b is the
    upper `bits` bits of splitmix64's mix of a * 0x9E3779B97F4A7C15 + b * 0xD1B54A32D192ED03. The
    polygon, the criterion and the triangulation determine scale, factor and bits, by `find_units`.
    """

    scale: float
    factor: int
    bits: int
    edges: np.ndarray  # (e, 2): pairs of sites a < b
    potentials: np.ndarray  # (e,) int64: of each edge in the direction from a to b
    lift: int  # added to the three potentials of every triangle

    @property
    def weight_parameters(self) -> tuple[float, int, int]:
        """Scale, factor and bits, by which a triangle's weight is computed from the cost."""
        return self.scale, self.factor, self.bits


@dataclass(frozen=True)
class Certificate:
    """The distance of a triangulation from the optimum, with evidence.

    Attributes
    ----------
    cost : float
        The criterion's sum over the triangulation.
    lower_bound : float
        No triangulation of the polygon costs less.
    gap : float
        (cost - lower_bound) / abs(cost).
    proven : bool
        True if the triangulation is proven optimal. If costs are integers on a grid (half-perimeter
        and overdraw, of coordinates that are integers or have few binary places), no triangulation
        costs less. If costs are real numbers, computed in doubles, no triangulation is cheaper by
        more than `gap`.
    evidence : Evidence or None
        The input of a checker; None if there is no bound, or if `certify` was called without
        evidence.
    """

    cost: float
    lower_bound: float
    gap: float
    proven: bool
    evidence: Evidence | None = field(default=None, repr=False, compare=False)


def make_claim(
    polygon: shapely.Polygon, triangles: np.ndarray, criterion: str, certificate: Certificate
) -> dict[str, Any]:
    """Return a certificate of triangles (m, 3) as data for JSON; without evidence, no bounds."""
    points, ring_offsets = rings_of(polygon)
    claim: dict[str, Any] = {
        "format": FORMAT,
        "criterion": criterion,
        "rings": [ring.tolist() for ring in np.split(points, ring_offsets[1:-1])],
        "triangles": np.asarray(triangles).tolist(),
        "cost": certificate.cost,
        "lower_bound": certificate.lower_bound if certificate.evidence else None,
        "gap": certificate.gap if certificate.evidence else None,
        "proven": certificate.proven,
        "potentials": None,
    }
    evidence = certificate.evidence
    if evidence is not None:
        claim |= {
            "scale": evidence.scale,
            "factor": evidence.factor,
            "bits": evidence.bits,
            "edges": evidence.edges.tolist(),
            "potentials": evidence.potentials.tolist(),
            "lift": int(evidence.lift),
        }
    return claim
