"""A minimum that LLVM turns into a SIMD reduction.

Numba writes `min` as compare and branch, which the loop vectoriser does not recognise as a
reduction; llvm.minnum it does, once NaN and signed zeros are declared away.
"""

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic


@intrinsic
def _fmin(_typing: Any, _a: Any, _b: Any) -> Any:
    """Smaller of two float64 that are not NaN."""

    def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        double = ir.DoubleType()
        function = builder.module.declare_intrinsic(
            "llvm.minnum", [double], ir.FunctionType(double, [double, double])
        )
        return builder.call(function, arguments, fastmath=("nnan", "nsz"))

    return types.float64(types.float64, types.float64), emit


fmin: Any = _fmin

FAST = {"nnan", "nsz", "reassoc", "contract", "arcp"}
"""What may be assumed of floats: all but that there are no infinities."""
