"""Weights of triangles, whole numbers, as `checking.units` defines them.

The checker works them out by code of its own.
"""

import numpy as np

from triangulators.checking.units import Units, lowest_first, most_units
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost, cost_at


@njit
def noise(a: int, b: int, bits: int) -> np.int64:
    """Return the edge's noise, in 0..2^bits - 1, by mixing its ends (splitmix64).

    The last step of that is left out: it changes lower bits alone.
    """
    if bits == 0:
        return np.int64(0)
    low, high = np.uint64(min(a, b)), np.uint64(max(a, b))
    x = low * np.uint64(0x9E3779B97F4A7C15) + high * np.uint64(0xD1B54A32D192ED03)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.int64(x >> np.uint64(64 - bits))


@njit
def weight(points: np.ndarray, a: int, b: int, c: int, cost: Cost, units: Units) -> np.int64:
    """Return the weight of one triangle."""
    whole = units_of(points, a, b, c, cost, units)
    bits = units.bits
    return whole * units.factor + noise(a, b, bits) + noise(b, c, bits) + noise(c, a, bits)


@njit
def units_of(points: np.ndarray, a: int, b: int, c: int, cost: Cost, units: Units) -> np.int64:
    """Return the cost of one triangle in units."""
    a, b, c = lowest_first(a, b, c)
    scaled, most = cost_at(points, a, b, c, cost) * units.scale, most_units(units.factor)
    return np.int64(np.floor(min(max(scaled, -most), most)))


@njit(nogil=True)
def weights_of(points: np.ndarray, triangles: np.ndarray, cost: Cost, units: Units) -> np.ndarray:
    """Return the weight (t,) of each triangle."""
    result = np.empty(len(triangles), dtype=np.int64)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        result[t] = weight(points, a, b, c, cost, units)
    return result
