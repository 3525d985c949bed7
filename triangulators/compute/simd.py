"""What Numba does not turn into SIMD instructions by itself.

`fmin`: Numba writes `min` as compare and branch, which the loop vectoriser does not recognise as a
reduction; llvm.minnum it does, once NaN and signed zeros are declared away.

`push`: a loop of one or two rounds, entered some thirty times a polygon, spends its time on what
the vectoriser puts before and behind it (do the arrays overlap? are lanes left over?). Written down
as one vector operation there is nothing to ask.
"""

from typing import Any

from triangulators.compute.kernels import intrinsic


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
