"""Weights of triangles as `checker` works them out: by the definition in `units`, in code apart."""

import numpy as np

from triangulators.checking.units import Units, most_units
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost, cost_at

TOO_LARGE = 2**60
"""For a weight, a potential and a lift: what is less adds up in 64 bits."""


@njit
def weight_of(points: np.ndarray, i: int, j: int, k: int, cost: Cost, units: Units) -> np.int64:
    """Return the weight of a triangle; `TOO_LARGE` where its cost is no number, or far below 0."""
    while i > j or i > k:
        i, j, k = j, k, i
    scaled, most = cost_at(points, i, j, k, cost) * units.scale, most_units(units.factor)
    if not scaled >= -most:  # a NaN, too
        return np.int64(TOO_LARGE)
    noise = _mixed(i, j, units.bits) + _mixed(j, k, units.bits) + _mixed(k, i, units.bits)
    return np.int64(np.floor(min(scaled, most))) * units.factor + noise


@njit
def weights_in_order(
    points: np.ndarray, triangles: np.ndarray, cost: Cost, units: Units
) -> np.ndarray:
    """Return the weight (t,) of each triangle."""
    found = np.empty(len(triangles), dtype=np.int64)
    for t in range(len(triangles)):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        found[t] = weight_of(points, i, j, k, cost, units)
    return found


@njit
def _mixed(a: int, b: int, bits: int) -> np.int64:
    """The noise of an edge, as `Evidence` defines it."""
    x = np.uint64(min(a, b)) * np.uint64(0x9E3779B97F4A7C15)
    x += np.uint64(max(a, b)) * np.uint64(0xD1B54A32D192ED03)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.int64(x >> np.uint64(64 - bits)) if bits > 0 else np.int64(0)
