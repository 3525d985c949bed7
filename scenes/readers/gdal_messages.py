"""The failures that GDAL reports while it reads, which pyogrio passes on only in part.

GDAL goes on after a feature that it cannot read, and says so to its error handler alone. Ours
is set, for the calling thread, in the library that pyogrio has loaded. Where that is not found,
nothing is heard, and what a file holds is known from counting alone.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pyogrio

_HANDLER = ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.c_int, ctypes.c_char_p)
_FAILURE = 3
"""GDAL's CE_Failure; what is less is a remark on something that was read."""

_KEPT = 100


class Failures:
    """How many failures were heard, and the first of them."""

    def __init__(self) -> None:
        self.count = 0
        self.texts: list[str] = []

        def heard(kind: int, _: int, text: bytes | None) -> None:
            if kind >= _FAILURE:
                self.count += 1
                if len(self.texts) < _KEPT:
                    self.texts.append(" ".join((text or b"").decode("utf-8", "replace").split()))

        # kept here: GDAL holds a bare pointer to it
        self._handler = _HANDLER(heard)

    @contextmanager
    def heard(self) -> Iterator[None]:
        """Listen while GDAL is called. Never over a `yield`: handlers are a stack of the thread."""
        library = _library()
        if library is None:
            yield
            return
        library.CPLPushErrorHandler(self._handler)
        try:
            yield
        finally:
            library.CPLPopErrorHandler()


@cache
def _library() -> Any | None:
    """GDAL as pyogrio has loaded it: found through its extension module, on Windows beside it."""
    package = Path(pyogrio.__file__).parent
    modules = sorted(package.glob("_err.*.so")) + sorted(package.glob("_err.*.pyd"))
    for file in [*modules, *sorted(package.with_name("pyogrio.libs").glob("*gdal*"))]:
        try:
            library = ctypes.CDLL(str(file))
            library.CPLPopErrorHandler.argtypes = []
            library.CPLPopErrorHandler.restype = None
            library.CPLPushErrorHandler.argtypes = [_HANDLER]
            library.CPLPushErrorHandler.restype = None
        except (OSError, AttributeError):
            continue
        return library
    return None
