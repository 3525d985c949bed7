"""Kernels, functions compiled by Numba on the first call, and operations for use in kernels.

Importing Numba takes half a second, so it is imported on the first call as well: commands that list
names or read a file call no kernel.

Operations are copies, grouping, union-find, and SIMD:

`copy_row`, `copy_rows`: with every assignment to a slice Numba compiles code for an error message,
which takes about two seconds of compile time. Copying element by element avoids that.

`fmin`: LLVM's loop vectoriser recognises llvm.minnum as a reduction if NaN and signed zeros are
excluded, but not Numba's `min`, which compares and branches.

`update_minimum_costs`: a loop of one or two iterations, entered about thirty times per polygon,
would spend the time in the vectoriser's overlap checks and remaining lanes.
"""

import os
from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any, TypeVar, overload

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])


class Kernel:
    """A function that Numba compiles on the first call."""

    def __init__(self, source: Callable[..., Any], options: dict[str, Any]) -> None:
        update_wrapper(self, source)
        self.py_func, self.options = source, options

    @cached_property
    def compiled(self) -> Any:
        """Numba's dispatcher of the function; two threads may create equivalent dispatchers."""
        from triangulators.compute.storing import make_dispatcher

        return make_dispatcher(self.py_func, self.options)

    @property
    def _numba_type_(self) -> Any:
        """The dispatcher's Numba type, so that a user's compiled code can call the kernel."""
        return self.compiled._numba_type_

    def __call__(self, *arguments: Any) -> Any:
        """Run the compiled function."""
        return self.compiled(*arguments)


class Intrinsic:
    """A Numba intrinsic, an operation written in LLVM IR, created on the first use in a kernel."""

    def __init__(self, source: Callable[..., Any]) -> None:
        self.source = source

    @cached_property
    def compiled(self) -> Any:
        """Numba's intrinsic."""
        from numba.extending import intrinsic

        return intrinsic(self.source)


@overload
def njit(function: F) -> F: ...


@overload
def njit(**options: Any) -> Callable[[F], F]: ...


def njit(function: Any = None, **options: Any) -> Any:
    """Declare a kernel: like `numba.njit`, but compiled on the first call, and cached on disk."""
    if function is not None:
        return Kernel(function, options)
    return lambda source: Kernel(source, options)


def intrinsic(function: Callable[..., Any]) -> Any:
    """Declare an intrinsic like `numba.extending.intrinsic`, for use in kernels only."""
    return Intrinsic(function)


def count_usable_cores() -> int:
    """Return the number of cores that this process may use, one thread for each."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@njit(nogil=True)
def copy_row(source: np.ndarray, into: np.ndarray) -> None:
    """Copy the elements of `source` (n,) to the first n elements of `into`."""
    for k in range(len(source)):
        into[k] = source[k]


@njit(nogil=True)
def copy_rows(source: np.ndarray, into: np.ndarray) -> None:
    """Copy the elements of `source` (n, k) to the first n rows and k columns of `into`."""
    for row in range(len(source)):
        for k in range(source.shape[1]):
            into[row, k] = source[row, k]


@njit(nogil=True)
def group_by_key(keys: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Group keys (n,) in 0..count - 1: return start (count + 1,) and positions (n,) int32.

    `positions[start[k]:start[k + 1]]` are the indices of the keys equal to k, ascending.
    """
    start = np.zeros(count + 2, dtype=np.int64)
    for key in keys:
        start[key + 2] += 1
    for k in range(count):
        start[k + 2] += start[k + 1]
    positions = np.empty(len(keys), dtype=np.int32)
    # In the loop start[k + 1] is the next free position for key k, and in the end the start of
    # key k + 1.
    for index in range(len(keys)):
        positions[start[keys[index] + 1]] = index
        start[keys[index] + 1] += 1
    return start[:-1], positions


@njit
def find_root(parent: np.ndarray, v: int) -> int:
    """Return the root of v's tree in a union-find forest; halve the path to the root."""
    while parent[v] != v:
        parent[v] = parent[parent[v]]
        v = parent[v]
    return v


@njit
def merge_trees(parent: np.ndarray, a: int, b: int) -> bool:
    """Merge the trees of `a` and `b`, see `find_root`; return whether they were different."""
    a, b = find_root(parent, a), find_root(parent, b)
    parent[a] = b
    return a != b


@intrinsic
def fmin(_typing: Any, _a: Any, _b: Any) -> Any:
    """Return the smaller of two float64 that are not NaN."""
    from llvmlite import ir  # type: ignore[import-untyped]
    from numba import types

    def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        double = ir.DoubleType()
        function = builder.module.declare_intrinsic(
            "llvm.minnum", [double], ir.FunctionType(double, [double, double])
        )
        return builder.call(function, arguments, fastmath=("nnan", "nsz"))

    return types.float64(types.float64, types.float64), emit


FAST_MATH_FLAGS = {"nnan", "nsz", "reassoc", "contract", "arcp"}  # not `ninf`: infinities occur
LANES = 8  # int32 lanes of `update_minimum_costs`; LLVM splits the vector if registers are shorter


@intrinsic
def update_minimum_costs(_typing: Any, rows: Any, _numbers: Any, _lane: Any, _values: Any) -> Any:
    """Update minimum costs in columns j = lane to lane + LANES - 1 of `rows`, C-ordered int32.

    update_minimum_costs(rows, (to, x, y, weight, beyond), lane, (a, b, cost, none)): if
    a * rows[y, j] > b * rows[x, j], that is, if the triangle of apex (a, b) is counter-clockwise,
    rows[to, j] = min(rows[to, j], cost + rows[beyond, j] + rows[weight, j]). The rows: minimum
    costs, x and y of vertex j, cost of the diagonal to j and of the sub-polygon from the apex to j;
    cost: of the sub-polygon up to the apex; none: at least every value of rows[to].
    """
    from llvmlite import ir
    from numba import types

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, vector = ir.IntType(32), ir.VectorType(ir.IntType(32), LANES)
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        columns = builder.extract_value(array.shape, 1)
        numbers, lane, values = arguments[1:]
        to, x_row, y_row, weight_row, beyond_row = (
            builder.extract_value(numbers, k) for k in range(5)
        )

        def pointer(row: Any) -> Any:
            at = builder.add(builder.mul(row, columns), lane)
            return builder.bitcast(builder.gep(array.data, [at]), vector.as_pointer())

        def load(target: Any) -> Any:
            return builder.load(target, align=4)

        def spread(value: Any) -> Any:
            nothing = ir.Constant(vector, ir.Undefined)
            vector_of_one = builder.insert_element(nothing, value, ir.Constant(word, 0))
            zero_mask = ir.Constant(ir.VectorType(word, LANES), [0] * LANES)
            return builder.shuffle_vector(vector_of_one, nothing, zero_mask)

        target = pointer(to)
        before = load(target)
        x, y = load(pointer(x_row)), load(pointer(y_row))
        weight, beyond = load(pointer(weight_row)), load(pointer(beyond_row))
        a, b, cost, none = (spread(builder.extract_value(values, k)) for k in range(4))
        is_left = builder.icmp_signed(">", builder.mul(a, y), builder.mul(b, x))
        total = builder.select(is_left, builder.add(builder.add(beyond, weight), cost), none)
        lower = builder.select(builder.icmp_signed("<", total, before), total, before)
        builder.store(lower, target, align=4)
        return context.get_dummy_value()

    numbers, values = types.UniTuple(types.intp, 5), types.UniTuple(types.int32, 4)
    return types.void(rows, numbers, types.intp, values), emit
