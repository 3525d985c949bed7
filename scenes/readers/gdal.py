"""Two functions of the GDAL library that pyogrio contains but does not expose, by ctypes.

The error handler counts failures that GDAL reports; another function converts curves to straight
edges. If the library is not found, failures are not counted and curves are not converted.
"""

import ctypes
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

_HANDLER = ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.c_int, ctypes.c_char_p)
_FAILURE = 3
"""GDAL's CE_Failure; lower numbers are warnings."""

_SRID = 0x20000000
"""Bit of the geometry type in EWKB, set if an SRID follows the type."""

_MULTI_POLYGON = 6
_SURFACES = {15: _MULTI_POLYGON, 16: _MULTI_POLYGON, 17: 3}
"""Geometry types of surfaces (polyhedral surface, TIN, triangle), and the equivalent
types of polygons."""


@cache
def load_library() -> Any | None:
    """Return pyogrio's GDAL library, or None if the library or pyogrio is missing.

    GDAL's functions can be reached through an extension module of pyogrio; on Windows through the
    library in pyogrio.libs.
    """
    try:
        import pyogrio
    except ModuleNotFoundError:
        return None
    package = Path(pyogrio.__file__).parent
    modules = sorted(package.glob("_err.*.so")) + sorted(package.glob("_err.*.pyd"))
    for file in [*modules, *sorted(package.with_name("pyogrio.libs").glob("*gdal*"))]:
        try:
            library = ctypes.CDLL(str(file))
            _declare_functions(library)
        except (OSError, AttributeError):
            continue
        return library
    return None


def _declare_functions(library: Any) -> None:
    """Declare the types of the functions that this module calls, for ctypes.

    Raises AttributeError if the library lacks a function.
    """
    handle, number, pointer = ctypes.c_void_p, ctypes.c_int, ctypes.POINTER
    for name, result, *arguments in (
        ("CPLPopErrorHandler", None),
        ("CPLPushErrorHandler", None, _HANDLER),
        ("OGR_G_CreateFromWkb", number, ctypes.c_char_p, handle, pointer(handle), number),
        ("OGR_G_CreateFromWkt", number, pointer(ctypes.c_char_p), handle, pointer(handle)),
        ("OGR_G_GetLinearGeometry", handle, handle, ctypes.c_double, handle),
        ("OGR_G_GetGeometryType", number, handle),
        ("OGR_G_ForceTo", handle, handle, number, handle),
        ("OGR_G_WkbSize", number, handle),
        ("OGR_G_ExportToIsoWkb", number, handle, number, ctypes.c_char_p),
        ("OGR_G_DestroyGeometry", None, handle),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments


class FailureLog:
    """The number of failures that GDAL reports while `listen` is active, and the first message."""

    def __init__(self) -> None:
        self.count = 0
        self.first = ""

        def handle(kind: int, _: int, text: bytes | None) -> None:
            if kind >= _FAILURE:
                self.count += 1
                self.first = self.first or (text or b"").decode("utf-8", "replace")

        # Stored in an attribute: GDAL has only a pointer, and Python would delete the handler.
        self._handler = _HANDLER(handle)

    @contextmanager
    def listen(self) -> Iterator[None]:
        """Count failures that GDAL reports in the block.

        The block must not `yield`, because GDAL has a stack of handlers for each thread.
        """
        library = load_library()
        if library is None:
            yield
            return
        library.CPLPushErrorHandler(self._handler)
        try:
            yield
        finally:
            library.CPLPopErrorHandler()


def linearize(geometry: bytes | str) -> bytes | None:
    """Return a curve or surface, given as WKT or WKB, with straight edges, as WKB, or None.

    Arcs become chords of 4 degrees; patches of a surface become the parts of a multi-polygon.
    Returns None if GDAL cannot parse the geometry, or is not found.

    >>> linearize("TRIANGLE ((0 0,1 0,1 1,0 0))")[:5].hex()
    '0103000000'
    """
    library = load_library()
    if library is None:
        return None
    parsed = ctypes.c_void_p()
    with FailureLog().listen():
        if isinstance(geometry, str):
            text = ctypes.c_char_p(geometry.encode())
            failure = library.OGR_G_CreateFromWkt(ctypes.byref(text), None, ctypes.byref(parsed))
            if parsed and (text.value or b"").strip():  # refuse a geometry followed by more text
                library.OGR_G_DestroyGeometry(parsed)
                return None
        else:
            wkb = _remove_srid(geometry)
            failure = library.OGR_G_CreateFromWkb(wkb, None, ctypes.byref(parsed), len(wkb))
        if failure or not parsed:
            return None
        straight = library.OGR_G_GetLinearGeometry(parsed, 0.0, None)
        library.OGR_G_DestroyGeometry(parsed)
        kind = library.OGR_G_GetGeometryType(straight) & 0x7FFFFFFF
        if kind % 1000 in _SURFACES:
            straight = library.OGR_G_ForceTo(straight, _SURFACES[kind % 1000], None)
        buffer = ctypes.create_string_buffer(library.OGR_G_WkbSize(straight))
        failure = library.OGR_G_ExportToIsoWkb(straight, 1, buffer)  # 1: little-endian
        library.OGR_G_DestroyGeometry(straight)
    return None if failure else buffer.raw


def _remove_srid(wkb: bytes) -> bytes:
    """Return EWKB without its SRID, which GDAL does not expect."""
    order = "<" if wkb[:1] == b"\1" else ">"
    if len(wkb) < 9 or not (kind := struct.unpack_from(f"{order}I", wkb, 1)[0]) & _SRID:
        return wkb
    return wkb[:1] + struct.pack(f"{order}I", kind & ~_SRID) + wkb[9:]
