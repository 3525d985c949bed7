"""A criterion as a record; kernels get a pointer, so one compiled version serves all criteria."""

import math
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any, TypeAlias

import numpy as np

from triangulators.compute.kernels import intrinsic, njit
from triangulators.criteria import count_exact_quads
from triangulators.criteria.criterion import FEATURES, Criterion
from triangulators.criteria.features import (
    FEATURE_COUNT,
    SIGNATURE,
    exact_quads,
    weigh_triangle,
    weigh_triangles,
)
from triangulators.errors import TriangulationError

TRIANGLES, AREA, HALF_PERIMETER, BBOX_AREA, EDGE_LENGTH = range(5)
assert len(FEATURES) == FEATURE_COUNT
assert FEATURES[:5] == ("triangles", "area", "half_perimeter", "bbox_area", "edge_length")
_BOX = [HALF_PERIMETER, BBOX_AREA, EDGE_LENGTH]  # indices of the weights in `Cost.box`
MAX_COST = 1e200  # upper clamp of a triangle's cost; the sum of 10^6 such costs stays finite

Cost: TypeAlias = np.record
"""The cost to minimise, read only; in Python `cost["box"]` is 8 times as fast as `cost.box`."""

_FIELDS = np.dtype(
    [
        ("weights", np.float64, (len(FEATURES),)),
        ("function", np.int64),  # address of a user's C function
        ("sign", np.float64),  # -1 to maximise; `weights` contain this factor
        ("box", np.float64, (3,)),  # weights of half-perimeter, bounding-box area and edge length
        ("custom", np.bool_),
        # No weights except `box`, and those of the number and the area of triangles, whose sums are
        # the same for every triangulation of a polygon.
        ("is_box", np.bool_),
    ],
    align=True,
)
_RECORD = np.dtype((np.record, _FIELDS))


@cache
def _compile_c_function(function: Callable[..., float]) -> Any:
    import numba

    if function is count_exact_quads:
        from triangulators.compute.storing import compile_cfunc

        return compile_cfunc(SIGNATURE, _call_exact_quads)
    inner = numba.njit(getattr(function, "py_func", function))

    def cost(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
        value = float(inner(ax, ay, bx, by, cx, cy))
        # With NaN, a dynamic program finds no triangulation, and reads outside its arrays.
        return value if abs(value) < MAX_COST else MAX_COST

    return numba.cfunc(SIGNATURE)(cost)


def _call_exact_quads(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    return exact_quads(ax, ay, bx, by, cx, cy)


def require_finite_total(criterion: Criterion, points: np.ndarray, triangles: np.ndarray) -> None:
    """Raise `TriangulationError` if a user's criterion, summed over triangles, is not finite."""
    if criterion.function is None:
        return
    try:
        total = criterion.total(points, triangles)
    except OverflowError:
        total = math.inf
    if not math.isfinite(total):
        raise TriangulationError(
            f"criterion {criterion.name}: the sum over triangles is {total}, not a finite number"
        )


@lru_cache(maxsize=256)
def find_plain_cost(criterion: Criterion, sign: float = 1.0) -> Cost | None:
    """Return the `Cost`, cached, of a built-in criterion without normalisation, otherwise None."""
    if criterion.normalise is not None or criterion.function is not None:
        return None
    return make_cost(criterion, 1.0, 1, sign)


def make_cost(criterion: Criterion, polygon_area: float, triangles: int, sign: float = 1.0) -> Cost:
    """Return the `Cost` of a criterion on a polygon; sign: 1 to minimise it, -1 to maximise it."""
    if criterion.function is not None:
        return _make_record(
            custom=True, function=_compile_c_function(criterion.function).address, sign=sign
        )
    weights = sign * criterion.weights_for(polygon_area, triangles)
    is_box = not weights[EDGE_LENGTH + 1 :].any()
    return _make_record(weights=weights, box=weights[_BOX], is_box=is_box, sign=sign)


def replace_fields(cost: Cost, **fields: Any) -> Cost:
    """Return a cost with some fields replaced; `box` and `is_box` do not follow `weights`."""
    return _make_record(**{name: cost[name] for name in _FIELDS.names or ()} | fields)


def _make_record(**fields: Any) -> Cost:
    records = np.zeros(1, _RECORD)
    for name, value in fields.items():
        records[name] = value
    records.flags.writeable = False
    cost: Cost = records[0]
    return cost


@intrinsic
def call_address(
    _typing: Any, _at: Any, _ax: Any, _ay: Any, _bx: Any, _by: Any, _cx: Any, _cy: Any
) -> Any:
    """Call the C function at an address with six float64; return its float64."""
    from llvmlite import ir  # type: ignore[import-untyped]
    from numba import types

    def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        double = ir.DoubleType()
        form = ir.FunctionType(double, [double] * 6)
        return builder.call(builder.inttoptr(arguments[0], form.as_pointer()), arguments[1:])

    return types.float64(types.int64, *[types.float64] * 6), emit


@njit
def triangle_cost(
    cost: Cost, ax: float, ay: float, bx: float, by: float, cx: float, cy: float
) -> float:
    """Return the cost of the triangle a, b, c, given by coordinates."""
    if cost.custom:
        return float(cost.sign * call_address(cost.function, ax, ay, bx, by, cx, cy))
    return weigh_triangle(cost.weights, ax, ay, bx, by, cx, cy)


@njit
def cost_at(points: np.ndarray, a: int, b: int, c: int, cost: Cost) -> float:
    """Return the cost of the triangle whose vertices are the rows a, b and c of points (n, 2)."""
    ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
    return triangle_cost(cost, ax, ay, bx, by, points[c, 0], points[c, 1])


@njit(nogil=True)
def weigh_block(
    cost: Cost, corners: tuple[np.ndarray, ...], count: int, totals: np.ndarray
) -> None:
    """Write the costs of `count` triangles to `totals`; see `weigh_triangles` for the arrays."""
    if not cost.custom:
        weigh_triangles(cost.weights, corners, count, totals)
        return
    ax, ay, bx, by, cx, cy = corners
    for k in range(count):
        totals[k] = triangle_cost(cost, ax[k], ay[k], bx[k], by[k], cx[k], cy[k])


@njit(nogil=True)
def allocate_block(size: int) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Return the arrays (corners, totals) that `weigh_block` needs for up to `size` triangles."""
    lanes = size + 8
    rows = np.zeros((6, lanes))
    return (rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]), np.empty(lanes)


@njit
def compute_total_cost(points: np.ndarray, triangles: np.ndarray, cost: Cost) -> float:
    """Return the sum of the costs of triangles (m, 3) of points (n, 2)."""
    total = 0.0
    for row in range(len(triangles)):
        total += cost_at(points, triangles[row, 0], triangles[row, 1], triangles[row, 2], cost)
    return total


@njit
def find_cheapest(points: np.ndarray, triangulations: np.ndarray, cost: Cost) -> int:
    """Return the index of the triangulation (k, m, 3) of lowest cost; of equal costs the first."""
    best, min_total = 0, np.inf
    for index in range(len(triangulations)):
        total = compute_total_cost(points, triangulations[index], cost)
        if total < min_total:
            best, min_total = index, total
    return best
