"""Kernels: functions compiled by Numba when they are first called.

Numba is imported then, too: that takes half a second, and what lists names or reads a file calls no
kernel.
"""

from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any, TypeVar, overload

F = TypeVar("F", bound=Callable[..., Any])


class Kernel:
    """Stands for a compiled function until Python or another kernel calls it.

    py_func : the function as it is written, under Numba's name
    """

    def __init__(self, source: Callable[..., Any], options: dict[str, Any]) -> None:
        update_wrapper(self, source)
        self.py_func, self.options = source, options

    @cached_property
    def compiled(self) -> Any:
        """Numba's dispatcher; two threads that ask at once may make two, which do the same."""
        from triangulators.compute.storing import dispatcher

        return dispatcher(self.py_func, self.options)

    @property
    def _numba_type_(self) -> Any:
        """What Numba asks of a value that is named in a user's compiled code."""
        return self.compiled._numba_type_

    def __call__(self, *arguments: Any) -> Any:
        """Run it."""
        return self.compiled(*arguments)


class Intrinsic:
    """Stands for an operation that is written in LLVM's language, until a kernel names it."""

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
    """Compile as `numba.njit` does, and keep what was compiled; with or without options."""
    if function is not None:
        return Kernel(function, options)
    return lambda source: Kernel(source, options)


def intrinsic(function: Callable[..., Any]) -> Any:
    """Declare an operation as `numba.extending.intrinsic` does, for kernels alone."""
    return Intrinsic(function)
