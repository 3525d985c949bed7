"""Costs of triangles as integers, so that comparing and adding them is exact.

A cost is counted in units of 1 / scale, rounded down: on a grid half-perimeter and overdraw are
whole numbers of units, other criteria are rounded at about the eleventh digit of the total. To it
a tiny noise is added, drawn once and for all for each edge: ties are common in the L1 metric (both
diagonals of a rectangle are equally long), and with ties neither edge can be excluded. A weight is

    factor * units + noise(ab) + noise(bc) + noise(ca)

and `factor` exceeds the noise of a whole triangulation. So a triangulation of least weight is one
of least cost, and weight // factor of a triangulation is its cost in units, exactly.
"""

import math
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

NOISE_BITS = 10
_ROOM = 2.0**61  # no sum of weights may reach it
_DIGITS = 2.0**35  # units in a total that no grid gives


class Units(NamedTuple):
    """How costs become weights.

    scale: units in 1; factor: weight of a unit; bits: noise is below 2^bits; exact: whether no
    triangle's cost had to be rounded.
    """

    scale: float
    factor: int
    bits: int
    exact: bool


@njit
def noise(a: int, b: int, bits: int) -> np.int64:
    """Return the edge's noise, in 0..2^bits - 1, by mixing its ends (splitmix64)."""
    low, high = np.uint64(min(a, b)), np.uint64(max(a, b))
    x = low * np.uint64(0x9E3779B97F4A7C15) + high * np.uint64(0xD1B54A32D192ED03)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.int64((x ^ (x >> np.uint64(31))) >> np.uint64(64 - bits))


@njit
def lowest_first(a: int, b: int, c: int) -> tuple[int, int, int]:
    """Turn a triangle so that its lowest corner is the first."""
    if b < a and b < c:
        return b, c, a
    if c < a and c < b:
        return c, a, b
    return a, b, c


@njit
def weight(points: np.ndarray, a: int, b: int, c: int, cost: Cost, units: Units) -> np.int64:
    """Return the weight of one triangle."""
    whole = units_of(points, a, b, c, cost, units.scale)
    bits = units.bits
    return whole * units.factor + noise(a, b, bits) + noise(b, c, bits) + noise(c, a, bits)


@njit
def units_of(points: np.ndarray, a: int, b: int, c: int, cost: Cost, scale: float) -> np.int64:
    """Return the cost of one triangle in units; the lowest corner goes first, whatever its turn.

    A cost in floats may depend on which corner comes first in its last digit.
    """
    a, b, c = lowest_first(a, b, c)
    return np.int64(np.floor(cost_at(points, a, b, c, cost) * scale))


@njit(nogil=True)
def weights_of(points: np.ndarray, triangles: np.ndarray, cost: Cost, units: Units) -> np.ndarray:
    """Return the weight (t,) of each triangle."""
    result = np.empty(len(triangles), dtype=np.int64)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        result[t] = weight(points, a, b, c, cost, units)
    return result


@njit(nogil=True)
def costs_of(points: np.ndarray, triangles: np.ndarray, cost: Cost) -> np.ndarray:
    """Return the cost (t,) of each triangle."""
    result = np.empty(len(triangles))
    for t in range(len(triangles)):
        a, b, c = lowest_first(triangles[t, 0], triangles[t, 1], triangles[t, 2])
        result[t] = cost_at(points, a, b, c, cost)
    return result


def units_for(points: np.ndarray, cost: Cost, largest: float, total: float, count: int) -> Units:
    """Choose units for triangulations of `count` triangles.

    largest: the largest cost of a candidate; total: the cost of some triangulation, both as
    absolute values. Weights then stay below 2^61, and so does four times their total.
    """
    most = max(4.0 * largest, 4.0 * total, 1e-300)
    scale = grid_scale(points, cost)
    exact = scale > 0.0 and largest * scale < 2.0**52
    if not exact:
        scale = 2.0 ** math.floor(math.log2(_DIGITS / most))
    for bits in range(NOISE_BITS, 1, -1):
        factor = 1 << int(3 * count * 2**bits).bit_length()
        if most * scale * factor < _ROOM:
            return Units(scale, factor, bits, exact)
    if exact:  # a huge grid: round after all
        scale = 2.0 ** math.floor(math.log2(_ROOM / (most * factor)))
    return Units(scale, factor, bits, exact and scale >= grid_scale(points, cost))


def grid_scale(points: np.ndarray, cost: Cost) -> float:
    """Return units in 1 that make every cost whole; 0 if there are none.

    Points on a grid of step 2^-k (see `predicates.on_grid`) have half-perimeters that are
    multiples of 2^-k, boxes of 4^-k and areas of 4^-k / 2; whole coefficients keep it so.
    """
    if cost["custom"] or not len(points):
        return 0.0
    weights = cost["weights"]
    used = np.flatnonzero(weights)
    if not set(used.tolist()) <= {TRIANGLES, AREA, HALF_PERIMETER, BBOX_AREA}:
        return 0.0
    if (weights != np.rint(weights)).any() or np.abs(weights).max() > 1024.0:
        return 0.0
    for k in range(-16, 33):
        scaled = points * 2.0**k
        if np.array_equal(scaled, np.rint(scaled)) and np.abs(scaled).max() < 2.0**52:
            if np.ptp(scaled, axis=0).max() >= 2.0**25:
                return 0.0
            box = bool(weights[AREA] or weights[BBOX_AREA])
            return 2.0 ** (2 * k + 1) if box else 2.0 ** max(k, 0)
    return 0.0
