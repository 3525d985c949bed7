"""Kernels: functions compiled by Numba on the first call.

Importing Numba takes half a second, so it is imported on the first call as well: commands that list
names or read a file call no kernel.
"""

from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any, TypeVar, overload

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
