"""How costs are counted in whole numbers, so that adding and comparing them is exact.

It follows from the polygon, the criterion and the triangulation that a claim is about, by the rules
below and never from the claim's evidence: units that are too coarse would prove anything.

A cost is counted in units of 1 / scale, rounded down. To it a tiny noise is added, drawn once and
for all for each edge (see `Evidence`): ties are common in the L1 metric, where both diagonals of a
rectangle are equally long, and with ties neither edge could be excluded. A weight is

    factor * units + noise(ab) + noise(bc) + noise(ca)

and `factor` exceeds the noise of a whole triangulation, three edges times 2^bits - 1 for each
triangle. So a triangulation of least weight is one of least cost in units, and weight // factor of
a triangulation is its cost in units. A weight of more than 2^59 counts as that: weights then fit
64 bits, and as less is counted than is there, a bound remains one. The other way round it would
not: a cost far below 0, or one that is no number, makes a weight of `TOO_LARGE`, and the checker
refuses all evidence.

Whole costs. Half-perimeter, overdraw and their like are made of sums and products of coordinates.
Where these are multiples of 2^-k, half-perimeters are whole in units of 2^-k, areas of half a box
of 4^-k. If doubles compute each exactly, the units are these. If coordinates are whole numbers
too large for that, nothing is said to be proven. All other costs are real numbers as the
criterion's function computes them in doubles; units are between 2^-36 and 2^-32 of the
triangulation's cost. Where that is so small that units would be below 2^-896, nothing is said to be
proven, either.
"""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.criteria.cost import (
    AREA,
    BBOX_AREA,
    HALF_PERIMETER,
    TRIANGLES,
    Cost,
    cost_at,
)
from triangulators.polygon import Boundary

NOISE_BITS = 10
TOO_LARGE = 2**60
"""For a weight, a potential and a lift: what is less adds up in 64 bits."""

_ROOM = 2**61  # four times the weight of the triangulation stays below
_MOST_WEIGHT = 2**59  # of a triangle, without its noise
_DIGITS = 36  # a real total has up to 2^36 units
_LARGEST_COEFFICIENT = 1024
_LARGEST_EXPONENT = 900  # so that what a scale multiplies stays a double
_LARGEST_SCALE = 2.0**_LARGEST_EXPONENT
EXACT = 2.0**52  # steps up to which sums and halves of doubles are exact
_EXACT_FACTOR = 2.0**25  # the same of factors, whose product is then exact


class Units(NamedTuple):
    """How costs become weights; compiled code takes it as it is.

    scale: units in 1, a power of two; factor: weight of a unit; bits: noise is below 2^bits; exact:
    no triangle's cost is rounded; real: costs are real numbers, so that a claim holds up to a
    relative error, unless scale is the largest, which may be too coarse.
    """

    scale: float
    factor: int
    bits: int
    exact: bool
    real: bool


def units_for(outline: Boundary, triangles: np.ndarray, cost: Cost) -> Units:
    """Return the units of claims about a triangulation (m, 3), between sites, of a polygon."""
    total = math.fsum(np.abs(costs_of(outline.points, triangles, cost)).tolist())
    count = outline.expected_triangles
    scale, whole, _ = whole_scale(outline.points, cost)
    if scale > 0.0:
        for bits in (*range(NOISE_BITS, 1, -1), 0):
            factor = factor_for(count, bits)
            if 4.0 * total * scale * factor < _ROOM:
                return Units(scale, factor, bits, True, False)
    exponent = _DIGITS - math.frexp(total)[1] if total > 0.0 else 0
    # In steps of 2^4, so that most triangulations of one polygon have the same units.
    exponent = max(-_LARGEST_EXPONENT, min(_LARGEST_EXPONENT, 4 * (exponent // 4)))
    for bits in (*range(NOISE_BITS, 1, -1), 0):
        factor = factor_for(count, bits)
        if factor << (_DIGITS + 2) < _ROOM:
            break
    return Units(2.0**exponent, factor, bits, False, not whole)


def factor_for(count: int, bits: int) -> int:
    """Return a power of two above the noise of `count` triangles; 1 without noise."""
    return 1 << (3 * count * 2**bits).bit_length() if bits > 0 else 1


def doubles_add_up(outline: Boundary, cost: Cost) -> bool:
    """Whether doubles compute every cost, and every sum of as many as there are, exactly."""
    scale, _, most = whole_scale(outline.points, cost)
    return scale > 0.0 and most * outline.expected_triangles < EXACT


def exact_total(outline: Boundary, triangles: np.ndarray, cost: Cost, units: Units) -> Fraction:
    """Return what a triangulation (m, 3) costs: exactly, or else as the exact sum of doubles."""
    costs = costs_of(outline.points, triangles, cost)
    if units.exact:
        total: int = sum((costs * units.scale).astype(np.int64).tolist())
        return total / Fraction(units.scale)
    return sum(map(Fraction, costs.tolist()), Fraction(0))


def is_proof(total: Fraction, least: int, count: int, units: Units) -> bool:
    """Whether a bound of `least` units proves that nothing is better than `count` triangles' total.

    The bound is not above the total: see `checker`. Real costs are rounded down by less than a unit
    for each triangle, the optimum's, too; units that may be too coarse would prove anything.
    """
    bound = Fraction(least) / Fraction(units.scale)
    if units.real and total != 0 and units.scale < _LARGEST_SCALE:
        return total - bound < count / Fraction(units.scale)
    return total == bound and (units.exact or units.real)


def whole_scale(points: np.ndarray, cost: Cost) -> tuple[float, bool, float]:
    """Return units in 1 in which doubles compute every cost exactly, 0 if there are none.

    With it, whether costs are whole because all coordinates are, however large; and the units that
    a cost, or twice that, does not exceed.
    """
    if cost["custom"]:
        return 0.0, False, math.inf
    used = set(np.flatnonzero(cost["weights"]).tolist())
    coefficients = cost["weights"][sorted(used)]
    if not used <= {TRIANGLES, AREA, HALF_PERIMETER, BBOX_AREA} or (
        (coefficients != np.rint(coefficients)).any()
        or np.abs(coefficients).sum() > _LARGEST_COEFFICIENT
    ):
        return 0.0, False, math.inf
    box = bool(used & {AREA, BBOX_AREA})
    k = _binary_places(points)
    known = (2 * k + 1 if box else k) < _LARGEST_EXPONENT
    steps = float(np.ptp(points, axis=0).max()) * 2.0**k if known else math.inf
    most = float(np.abs(coefficients).sum()) * (2.0 * steps * steps if box else 2.0 * steps)
    if most < EXACT and (not box or steps < _EXACT_FACTOR):
        return (2.0 ** (2 * k + 1) if box else 2.0 ** max(k, 0)), k <= 0, most
    return 0.0, k <= 0, most


def _binary_places(points: np.ndarray) -> int:
    """Return the least k for which 2^k times each coordinate is whole; at least -16."""
    mantissa, exponent = np.frexp(points[points != 0.0])
    digits = np.ldexp(mantissa, 53).astype(np.int64)
    # The lowest bit that is set, as a power of two, has an exponent one more than its place.
    ending = np.frexp((digits & -digits).astype(float))[1] - 1
    return max(-16, int((53 - exponent - ending).max(initial=-16)))


@njit(nogil=True)
def costs_of(points: np.ndarray, triangles: np.ndarray, cost: Cost) -> np.ndarray:
    """Return the cost (t,) of each triangle; the lowest corner goes first, whatever its turn.

    A cost in doubles may depend on which corner comes first in its last digit.
    """
    result = np.empty(len(triangles))
    for t in range(len(triangles)):
        a, b, c = lowest_first(triangles[t, 0], triangles[t, 1], triangles[t, 2])
        result[t] = cost_at(points, a, b, c, cost)
    return result


@njit
def lowest_first(a: int, b: int, c: int) -> tuple[int, int, int]:
    """Turn a triangle so that its lowest corner is the first."""
    if b < a and b < c:
        return b, c, a
    if c < a and c < b:
        return c, a, b
    return a, b, c


@njit
def noise(a: int, b: int, bits: int) -> np.int64:
    """Return the edge's noise, in 0..2^bits - 1, by mixing its ends (splitmix64).

    The last step of that is left out: it changes lower bits alone.
    """
    x = np.uint64(min(a, b)) * np.uint64(0x9E3779B97F4A7C15)
    x += np.uint64(max(a, b)) * np.uint64(0xD1B54A32D192ED03)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.int64(x >> np.uint64(64 - bits)) if bits > 0 else np.int64(0)


@njit
def units_of(points: np.ndarray, a: int, b: int, c: int, cost: Cost, units: Units) -> np.int64:
    """Return the cost of one triangle in units."""
    a, b, c = lowest_first(a, b, c)
    scaled, most = cost_at(points, a, b, c, cost) * units.scale, float(_MOST_WEIGHT // units.factor)
    if not scaled >= -most:  # a NaN, too
        return np.int64(TOO_LARGE // units.factor)
    return np.int64(np.floor(min(scaled, most)))


@njit
def weight(points: np.ndarray, a: int, b: int, c: int, cost: Cost, units: Units) -> np.int64:
    """Return the weight of one triangle."""
    whole, bits = units_of(points, a, b, c, cost, units), units.bits
    return whole * units.factor + noise(a, b, bits) + noise(b, c, bits) + noise(c, a, bits)


@njit(nogil=True)
def weights_of(points: np.ndarray, triangles: np.ndarray, cost: Cost, units: Units) -> np.ndarray:
    """Return the weight (t,) of each triangle."""
    result = np.empty(len(triangles), dtype=np.int64)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        result[t] = weight(points, a, b, c, cost, units)
    return result
