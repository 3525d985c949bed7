"""What pyogrio does not report or convert: failures of GDAL, curves, and facts about GeoJSON.

Two functions of pyogrio's GDAL library are called by ctypes; if the library is not found, failures
are not counted and curves are not converted.
"""

import ctypes
import json
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from scenes.projection import find_system
from scenes.readers.guard import MAX_LINE_CHARACTERS, number_lines, read_both_ends
from scenes.readers.reader import RawChunk
from scenes.scene import Note, SceneError

_HANDLER = ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.c_int, ctypes.c_char_p)
_FAILURE = 3  # GDAL's CE_Failure; lower numbers are warnings
_SRID = 0x20000000  # bit of the geometry type in EWKB, set if an SRID follows the type
_MULTI_POLYGON = 6
_SURFACES = {15: _MULTI_POLYGON, 16: _MULTI_POLYGON, 17: 3}
"""Types of polygons that replace surfaces (polyhedral surface, TIN, triangle)."""


_HANDLE, _NUMBER, _POINTER = ctypes.c_void_p, ctypes.c_int, ctypes.POINTER
_FUNCTIONS: tuple[tuple[Any, ...], ...] = (
    ("CPLPopErrorHandler", None),
    ("CPLPushErrorHandler", None, _HANDLER),
    ("OGR_G_CreateFromWkb", _NUMBER, ctypes.c_char_p, _HANDLE, _POINTER(_HANDLE), _NUMBER),
    ("OGR_G_CreateFromWkt", _NUMBER, _POINTER(ctypes.c_char_p), _HANDLE, _POINTER(_HANDLE)),
    ("OGR_G_GetLinearGeometry", _HANDLE, _HANDLE, ctypes.c_double, _HANDLE),
    ("OGR_G_GetGeometryType", _NUMBER, _HANDLE),
    ("OGR_G_ForceTo", _HANDLE, _HANDLE, _NUMBER, _HANDLE),
    ("OGR_G_WkbSize", _NUMBER, _HANDLE),
    ("OGR_G_ExportToIsoWkb", _NUMBER, _HANDLE, _NUMBER, ctypes.c_char_p),
    ("OGR_G_DestroyGeometry", None, _HANDLE),
)
"""Functions of GDAL that this module calls: name, type of the result, types of the arguments."""


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
        with suppress(OSError, AttributeError):  # not a library, or without one of the functions
            library = ctypes.CDLL(str(file))
            for name, result, *arguments in _FUNCTIONS:
                function = getattr(library, name)
                function.restype, function.argtypes = result, arguments
            return library
    return None


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
            wkb, _ = split_srid(geometry)
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


def split_srid(wkb: bytes) -> tuple[bytes, int]:
    """Return EWKB without its SRID, which GDAL does not expect, and the SRID, 0 if it has none."""
    order = "<" if wkb[:1] == b"\1" else ">"
    if len(wkb) < 9 or not (kind := struct.unpack_from(f"{order}I", wkb, 1)[0]) & _SRID:
        return wkb, 0
    (srid,) = struct.unpack_from(f"{order}I", wkb, 5)
    return wkb[:1] + struct.pack(f"{order}I", kind & ~_SRID) + wkb[9:], srid


_GEOMETRIES = ("Point", "LineString", "Polygon", "GeometryCollection")
_KINDS = ("Feature", *_GEOMETRIES, *(f"Multi{kind}" for kind in _GEOMETRIES[:3]))
_SEQUENCES = (".geojsonl", ".geojsons", ".ndgeojson", ".ndjson", ".jsonl", ".nljson")
_DEGREES_CRS = "EPSG:4326"


def find_crs(path: Path, crs: str | None) -> str | None:
    """Return the reference system of a file, given the system `crs` that GDAL reports.

    GDAL reports longitude and latitude for GeoJSON whose member `crs` is null or a name that GDAL
    does not know, and nothing for TopoJSON, which is in longitude and latitude.
    """
    is_json = path.suffix.lower() in (".geojson", ".json", ".topojson") and path.is_file()
    if not is_json or crs not in (None, _DEGREES_CRS):
        return crs
    head, tail = read_both_ends(path)
    if crs is None:
        return _DEGREES_CRS if re.search(rb'"type"\s*:\s*"Topology"', head + tail) else None
    around = head.partition(b'"features"')[0] + tail.rpartition(b"]")[2]
    member = r'"crs"\s*:\s*(?:\{.*?"(?:name|href)"\s*:\s*)?(null|"[^"]*")'
    match = re.search(member, around.decode("utf-8", "replace"), re.DOTALL)
    if match is None:
        return crs
    name: str | None = json.loads(match[1])
    return name if find_system(name) is None else crs


def is_geojson_sequence(path: Path) -> bool:
    """Whether a file is a GeoJSON sequence, one object per line, by suffix or first line."""
    if path.suffix.lower() not in (".json", ".geojson") or not path.is_file():
        return path.suffix.lower() in _SEQUENCES
    with path.open("rb") as stream:
        first, more = stream.readline(MAX_LINE_CHARACTERS).strip(), stream.read(4096).strip()
    if first.startswith((b"\x1e", b"\xef\xbb\xbf\x1e")):
        return True
    if re.search(rb'"type"\s*:\s*"(FeatureCollection|Topology|CityJSON)"', first[:4096]):
        return False
    try:
        return bool(more) and isinstance(json.loads(first), dict)
    except (ValueError, RecursionError):
        return False


def find_skipped_lines(
    path: Path, count: int, failures: int, *, is_complete: bool, size: int
) -> Iterator[RawChunk]:
    """Yield chunks without geometries, with up to `size` notes on lines that GDAL skipped.

    count : number of features that were read
    failures : number of failures that GDAL reported; GDAL may have skipped more lines
    is_complete : True if all features were requested; then each line should be a feature
    """
    lines = sum(1 for _, line in number_lines(path) if not line.isspace()) if is_complete else 0
    if not failures and count >= lines:
        return
    skipped = _find_invalid_lines(path)
    while notes := list(islice(skipped, size)):
        count += len(notes)
        yield RawChunk([], [], dropped=notes)
    if count < lines:
        raise SceneError(
            f"{path} has {lines} features, but GDAL reads only some of them: write the file "
            "again, without a byte order mark"
        )


def _find_invalid_lines(path: Path) -> Iterator[Note]:
    for number, line in number_lines(path):
        text = line.strip("\x1e\ufeff \t\r\n")
        try:
            if text and json.loads(text)["type"] not in _KINDS:
                raise KeyError
        except (ValueError, RecursionError):
            yield f"line {number}", "is not JSON"
        except (KeyError, TypeError):
            yield f"line {number}", "is JSON, but not a feature"
