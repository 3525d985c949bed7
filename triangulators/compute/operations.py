"""Operations for kernels: copies, groups of equal numbers, what hangs together, and SIMD.

Numba compiles the text of an error message with every slice that is assigned to, for some two
seconds of compiling; the copies here, element by element of arrays of equal shape, have none.

What Numba does not turn into SIMD instructions by itself: `fmin`, for it writes `min` as compare
and branch, which the loop vectoriser does not recognise as a reduction; llvm.minnum it does, once
NaN and signed zeros are declared away. And `push`: a loop of one or two rounds, entered some thirty
times a polygon, spends its time on what the vectoriser puts before and behind it (do the arrays
overlap? are lanes left over?). Written down as one vector operation there is nothing to ask.
"""

from typing import Any

import numpy as np

from triangulators.compute.kernels import intrinsic, njit


@njit(nogil=True)
def copy_row(source: np.ndarray, into: np.ndarray) -> None:
    """Copy (n,)."""
    for k in range(len(source)):
        into[k] = source[k]


@njit(nogil=True)
def copy_rows(source: np.ndarray, into: np.ndarray) -> None:
    """Copy (n, k)."""
    for row in range(len(source)):
        for k in range(source.shape[1]):
            into[row, k] = source[row, k]


@njit(nogil=True)
def grouped(keys: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (start, places): `keys[places[start[k]:start[k + 1]]]` are all k, places ascending.

    keys (n,) in 0..count - 1; start (count + 1,) int64; places (n,) int32. A counting sort, in two
    passes.
    """
    start = np.zeros(count + 2, dtype=np.int64)
    for key in keys:
        start[key + 2] += 1
    for k in range(count):
        start[k + 2] += start[k + 1]
    places = np.empty(len(keys), dtype=np.int32)
    # start[k + 1] is where the next one of k goes: in the end it is where those of k + 1 begin.
    for place in range(len(keys)):
        places[start[keys[place] + 1]] = place
        start[keys[place] + 1] += 1
    return start[:-1], places


@njit
def root_of(parent: np.ndarray, v: int) -> int:
    """Return the root of the tree that `v` is in; parent (n,): 0..n - 1 where all are apart.

    Paths are halved as they are walked (union-find).
    """
    while parent[v] != v:
        parent[v] = parent[parent[v]]
        v = parent[v]
    return v


@njit
def join(parent: np.ndarray, a: int, b: int) -> bool:
    """Make one tree of those of `a` and `b`; return whether they were two."""
    a, b = root_of(parent, a), root_of(parent, b)
    parent[a] = b
    return a != b


@intrinsic
def fmin(_typing: Any, _a: Any, _b: Any) -> Any:
    """Smaller of two float64 that are not NaN."""
    from llvmlite import ir  # type: ignore[import-untyped]
    from numba import types

    def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        double = ir.DoubleType()
        function = builder.module.declare_intrinsic(
            "llvm.minnum", [double], ir.FunctionType(double, [double, double])
        )
        return builder.call(function, arguments, fastmath=("nnan", "nsz"))

    return types.float64(types.float64, types.float64), emit


FAST = {"nnan", "nsz", "reassoc", "contract", "arcp"}
"""What may be assumed of floats: all but that there are no infinities."""

LANES = 8
"""How many int32 `push` does at once; LLVM makes two of them where registers are shorter."""


@intrinsic
def push(_typing: Any, rows: Any, _numbers: Any, _lane: Any, _values: Any) -> Any:
    """Lower rows[to, j] to cost + rows[beyond, j] + rows[weight, j] where a * y > b * x.

    push(rows, (to, x, y, weight, beyond), lane, (a, b, cost, none)): LANES columns of `rows`
    (C-ordered int32) from `lane` on. The first tuple is of numbers of rows, the second of int32.
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

        def load(place: Any) -> Any:
            return builder.load(place, align=4)

        def spread(value: Any) -> Any:
            nothing = ir.Constant(vector, ir.Undefined)
            one = builder.insert_element(nothing, value, ir.Constant(word, 0))
            everywhere = ir.Constant(ir.VectorType(word, LANES), [0] * LANES)
            return builder.shuffle_vector(one, nothing, everywhere)

        place = pointer(to)
        before = load(place)
        x, y = load(pointer(x_row)), load(pointer(y_row))
        weight, beyond = load(pointer(weight_row)), load(pointer(beyond_row))
        a, b, cost, none = (spread(builder.extract_value(values, k)) for k in range(4))
        left = builder.icmp_signed(">", builder.mul(a, y), builder.mul(b, x))
        total = builder.select(left, builder.add(builder.add(beyond, weight), cost), none)
        lower = builder.select(builder.icmp_signed("<", total, before), total, before)
        builder.store(lower, place, align=4)
        return context.get_dummy_value()

    numbers, values = types.UniTuple(types.intp, 5), types.UniTuple(types.int32, 4)
    return types.void(rows, numbers, types.intp, values), emit
