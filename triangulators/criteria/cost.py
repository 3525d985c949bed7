"""A criterion in the form that compiled code takes."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numba
import numpy as np

from triangulators.compute.kernels import cfunc, njit
from triangulators.criteria.catalogue import Criterion, exact_quads_of
from triangulators.criteria.features import FEATURES, SIGNATURE, weighted
from triangulators.criteria.quads import exact_quads

TRIANGLES, AREA, HALF_PERIMETER, BBOX_AREA, EDGE_LENGTH = range(5)
assert FEATURES[:5] == ("triangles", "area", "half_perimeter", "bbox_area", "edge_length")
_BOX = [HALF_PERIMETER, BBOX_AREA, EDGE_LENGTH]


class Cost(NamedTuple):
    """What is minimised: a weighted sum of features, or `sign` times a user's function.

    `box` holds the three weights (half-perimeter, bounding-box area, edge length) of a cost made
    of nothing else, up to what is the same for every triangulation of a polygon; `is_box` says
    whether it is. `maximum` compares by the worst triangle instead of the sum.
    """

    weights: np.ndarray
    function: Any
    custom: bool
    sign: float
    maximum: bool
    box: np.ndarray
    is_box: bool


@cfunc(SIGNATURE)
def _no_function(_ax: float, _ay: float, _bx: float, _by: float, _cx: float, _cy: float) -> float:
    """Stand in where a built-in criterion is used."""
    return 0.0


@lru_cache(maxsize=256)
def _compiled(function: Callable[..., float]) -> Any:
    """Return a function of three points behind the one signature kernels are built for."""
    if function is exact_quads_of:
        return cfunc(SIGNATURE)(_quads)
    return numba.cfunc(SIGNATURE)(getattr(function, "py_func", function))


def _quads(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    return exact_quads(ax, ay, bx, by, cx, cy)


@lru_cache(maxsize=256)
def plain_cost(criterion: Criterion, sign: float = 1.0) -> Cost | None:
    """Return `cost_of` where it is the same for all polygons, otherwise None; kept."""
    if criterion.normalise is not None or criterion.function is not None or criterion.maximum:
        return None
    return cost_of(criterion, 1.0, 1, sign)


def cost_of(criterion: Criterion, polygon_area: float, triangles: int, sign: float = 1.0) -> Cost:
    """Return the `Cost` of a criterion on a polygon; `sign` -1 maximises it."""
    if criterion.maximum and sign < 0.0:
        raise ValueError(f"{criterion.name}: the worst of a maximum is not defined; drop minmax-")
    if criterion.function is not None:
        function = _compiled(criterion.function)
        nothing = np.zeros(len(FEATURES))
        return Cost(nothing, function, True, sign, criterion.maximum, nothing[:3], False)
    weights = sign * criterion.weights_for(polygon_area, triangles)
    others = weights[EDGE_LENGTH + 1 :]
    is_box = not others.any() and not criterion.maximum
    return Cost(weights, _no_function, False, sign, criterion.maximum, weights[_BOX].copy(), is_box)


@njit
def triangle_cost(
    weights: np.ndarray,
    function: Any,
    custom: bool,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    cx: float,
    cy: float,
) -> float:
    """Cost of one triangle; a user's function gets it as given, without its sign."""
    if custom:
        return function(ax, ay, bx, by, cx, cy)
    return weighted(weights, ax, ay, bx, by, cx, cy)


@njit
def total_cost(
    points: np.ndarray,
    triangles: np.ndarray,
    weights: np.ndarray,
    function: Any,
    custom: bool,
    sign: float,
    maximum: bool,
) -> float:
    """Sum (or maximum) of the cost over triangles (m, 3) of points (n, 2)."""
    total = -1e300 if maximum else 0.0
    for row in range(len(triangles)):
        a, b, c = triangles[row, 0], triangles[row, 1], triangles[row, 2]
        cost = triangle_cost(
            weights,
            function,
            custom,
            points[a, 0],
            points[a, 1],
            points[b, 0],
            points[b, 1],
            points[c, 0],
            points[c, 1],
        )
        cost = sign * cost if custom else cost
        total = max(total, cost) if maximum else total + cost
    return total


def evaluate(points: np.ndarray, triangles: np.ndarray, cost: Cost) -> float:
    """Return what `cost` makes of a triangulation."""
    return float(total_cost(points, triangles, *cost[:5]))


@njit
def _cheapest(
    points: np.ndarray,
    many: np.ndarray,
    weights: np.ndarray,
    function: Any,
    custom: bool,
    sign: float,
    maximum: bool,
) -> int:
    best, least = 0, np.inf
    for number in range(len(many)):
        total = total_cost(points, many[number], weights, function, custom, sign, maximum)
        if total < least:
            best, least = number, total
    return best


def cheapest(points: np.ndarray, many: np.ndarray, cost: Cost) -> int:
    """Return which of many triangulations (k, m, 3) is least; the first of those that are equal."""
    return int(_cheapest(points, many, *cost[:5]))
