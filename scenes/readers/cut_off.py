"""Files that were cut off, as a full disk or a broken download leaves them.

What is missing at the end of a file cannot be named, so a file that shows that it was cut off is
refused. It shows that where its format has an end mark, says how long it is, or ends in the middle
of a record. A cut between two records of a format without any of these cannot be seen.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from pathlib import Path

from scenes.readers.opening import LONGEST
from scenes.scene import SceneError

_EDGE = 4096
SEQUENCES = (".geojsonl", ".geojsons", ".ndgeojson", ".ndjson", ".jsonl", ".nljson")
"""Suffixes of files with a GeoJSON object a line; other suffixes of JSON are looked into."""


def error(path: Path, where: str) -> SceneError:
    """The error for a file that ends too early; `where` says how that is seen."""
    return SceneError(f"{path} was cut off: {where}; polygons are missing: write or copy it again")


def check(path: Path) -> None:
    """Raise SceneError for a file that was cut off, as far as its first and last bytes show that.

    Files that belong to it are looked at, too: a Shapefile's index and table.
    """
    if path.is_dir():
        return
    suffix = path.suffix.lower()
    for each in [path, *(path.with_suffix(s) for s in _BESIDE.get(suffix, ()))]:
        seen = _CHECKS.get(each.suffix.lower())
        if seen is not None and each.is_file():
            where = seen(each)
            if where:
                raise error(each, where)


def _edges(path: Path, size: int = _EDGE) -> tuple[bytes, bytes]:
    """The first and the last bytes of a file."""
    with path.open("rb") as stream:
        head = stream.read(size)
        stream.seek(max(0, path.stat().st_size - size))
        return head, stream.read(size)


def _drawing(path: Path) -> str | None:
    _, tail = _edges(path)
    return None if tail.rstrip(b"\0\x1a \t\r\n").endswith(b"EOF") else "a DXF ends with EOF"


def _shorter(path: Path, stated: int) -> str | None:
    size = path.stat().st_size
    return f"it has {size} bytes of {stated}" if size < stated else None


def _shape(path: Path) -> str | None:
    """A Shapefile and its index say at byte 24 how many 16-bit words they have."""
    head, _ = _edges(path)
    return _shorter(path, 2 * struct.unpack_from(">I", head, 24)[0]) if len(head) >= 100 else None


def _table(path: Path) -> str | None:
    """A dBASE table says how many records it has, how long its header is and a record."""
    head, _ = _edges(path)
    if len(head) < 32:
        return "its header is not whole"
    records, header, length = struct.unpack_from("<IHH", head, 4)
    return _shorter(path, header + records * length)


def _database(path: Path) -> str | None:
    """SQLite counts its pages; the count holds if it was made by the version that wrote last."""
    head, _ = _edges(path)
    if len(head) < 100 or not head.startswith(b"SQLite format 3\0"):
        return None
    page = struct.unpack_from(">H", head, 16)[0]
    changes, pages = struct.unpack_from(">II", head, 24)
    holds = changes == struct.unpack_from(">I", head, 92)[0]
    return _shorter(path, pages * (65536 if page == 1 else page)) if holds else None


def _stl(path: Path) -> str | None:
    """Binary STL counts its triangles; text ends with endsolid."""
    head, tail = _edges(path)
    stated = 84 + 50 * struct.unpack_from("<I", head, 80)[0] if len(head) >= 84 else 0
    if path.stat().st_size == stated:
        return None
    if head.lstrip().lower().startswith(b"solid") and b"facet" in head:
        return None if b"endsolid" in tail.lower() else "an STL in text ends with endsolid"
    return _shorter(path, stated)


def _off(path: Path) -> str | None:
    """OFF counts its vertices and faces, a line each."""
    text = re.sub(r"#.*", "", path.read_text(encoding="utf-8", errors="replace"))
    found = re.match(r"\s*\w*OFF\s+(\d+)\s+(\d+)", text)
    if found is None:
        return None
    vertices, faces = int(found[1]), int(found[2])
    rest = [line for line in text[found.end() :].splitlines()[1:] if line.strip()]
    there = max(len(rest) - vertices, 0)
    if there < faces:
        return f"it has {there} of {faces} faces"
    words = rest[vertices + faces - 1].split() if faces else []
    whole = not words or not words[0].isdecimal() or len(words) > int(words[0])
    return None if whole else f"face {faces - 1} is not whole"


def _binary_gltf(path: Path) -> str | None:
    head, _ = _edges(path)
    ours = len(head) >= 12 and head[:8] in (b"glTF\1\0\0\0", b"glTF\2\0\0\0")
    return _shorter(path, struct.unpack_from("<I", head, 8)[0]) if ours else None


def _last_line(path: Path) -> str | None:
    if not is_sequence(path):
        return None
    return unended(path, lambda line: bool(json.loads(line)))


def is_sequence(path: Path) -> bool:
    """Whether a file has a GeoJSON object a line, by its suffix or by its first line."""
    suffix = path.suffix.lower()
    if suffix in SEQUENCES:
        return True
    if suffix not in (".json", ".geojson") or not path.is_file():
        return False
    with path.open("rb") as stream:
        start = stream.read(_EDGE).lstrip(b"\xef\xbb\xbf \t\r\n")
        if start.startswith(b"\x1e"):
            return True
        if re.search(rb'"type"\s*:\s*"(FeatureCollection|Topology|CityJSON)"', start):
            return False
        stream.seek(0)
        first = stream.readline(LONGEST)
        if not stream.read(_EDGE).strip():
            return False
    try:
        return isinstance(json.loads(first), dict)
    except (ValueError, RecursionError):
        return False


def unended(path: Path, sound: Callable[[bytes], bool]) -> str | None:
    """How a file of lines shows that it was cut off: its last line has no end and is not sound."""
    size, last = path.stat().st_size, b""
    for reach in (2**16, 2**21, LONGEST):
        if b"\n" not in last and len(last) < size:
            _, last = _edges(path, reach)
    before, _, line = last.rpartition(b"\n")
    if not line.strip() or (not before.strip() and len(last) >= size):
        return None  # ended, or there is no other line
    try:
        whole = sound(line.strip(b"\x1e \t\r"))
    except (ValueError, RecursionError):
        whole = False
    return None if whole else "its last line ends in the middle"


_CHECKS: dict[str, Callable[[Path], str | None]] = {
    ".dxf": _drawing,
    **dict.fromkeys((".shp", ".shx"), _shape),
    ".dbf": _table,
    **dict.fromkeys((".gpkg", ".sqlite", ".db", ".mbtiles"), _database),
    ".stl": _stl,
    ".off": _off,
    ".glb": _binary_gltf,
    **dict.fromkeys((*SEQUENCES, ".json", ".geojson"), _last_line),
}
_BESIDE = {".shp": (".shx", ".dbf")}
