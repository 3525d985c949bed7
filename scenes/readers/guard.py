"""What may be opened, and what a failure says: one clear line, whatever a library raises.

A library may raise any exception on bytes that it did not expect, so a list of exceptions is never
complete. Everything that a reader raises ends at one of the two boundaries here. With
`RASTER_HARNESS_DEBUG=1` there is no boundary: the error is raised with its traceback.
"""

import json
import os
import re
import stat
import struct
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from scenes.scene import Note, SceneError

DEBUG = "RASTER_HARNESS_DEBUG"
"""Environment variable that switches the boundaries off."""


@contextmanager
def clear_errors(
    name: str, kind: str, explain: Callable[[Exception], str | None] | None = None
) -> Iterator[None]:
    """Turn whatever is raised within into a SceneError of one line.

    name : the file, as the user gave it
    kind : what it was read as, e.g. "GeoParquet"
    explain : may give a better message than the general one

    >>> with clear_errors("a.svg", "SVG"):
    ...     raise LookupError("unknown encoding:\\n no-such-code")
    Traceback (most recent call last):
    scenes.scene.SceneError: a.svg cannot be read as SVG: unknown encoding: no-such-code (it is \
damaged or has another format: write it again)
    """
    try:
        yield
    except SceneError:
        raise
    except MemoryError as error:
        raise SceneError(
            f"{name} needs more memory than there is: it is damaged, or give only a part of it"
        ) from error
    except Exception as error:
        if debugging():
            raise
        general = (
            f"{name} cannot be read as {kind}: {reason(error)} "
            "(it is damaged or has another format: write it again)"
        )
        raise SceneError((explain and explain(error)) or general) from error


@contextmanager
def noted(notes: list[Note], which: str, what: str) -> Iterator[None]:
    """Add a note to `notes` for whatever is raised within: one bad item costs that item only.

    >>> notes = []
    >>> with noted(notes, "line 7", "is not sound"):
    ...     raise KeyError("vertices")
    >>> notes
    [('line 7', "is not sound: no 'vertices'")]
    """
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        if debugging():
            raise
        notes.append((which, f"{what}: {reason(error)}"))


def reason(error: Exception) -> str:
    """What an error says, in one line.

    >>> reason(ValueError("no\\n  number")), reason(KeyError("type")), reason(EOFError())
    ('no number', "no 'type'", 'EOFError')
    """
    text = " ".join(str(error).split())
    if isinstance(error, KeyError):
        return f"no {text}"
    return text or type(error).__name__


def debugging() -> bool:
    """Whether the boundaries are switched off.

    >>> debugging()
    False
    """
    return os.environ.get(DEBUG, "") not in ("", "0")


LONGEST = 64 * 2**20
"""Characters of the longest line that is read; a coastline of a million vertices has 40 million."""


def existing(path: str) -> Path:
    """The file; raises SceneError, in one line, where there is none, or it is empty or no file."""
    if "\0" in path:
        raise SceneError("a path cannot hold a NUL character: give another")
    file = Path(path)
    try:
        mode = file.stat().st_mode
        if not stat.S_ISDIR(mode):
            _refuse_special(path, mode)
            with file.open("rb") as stream:
                if not stream.read(1):
                    raise SceneError(f"{path} is empty (0 bytes): give a file with polygons")
    except (FileNotFoundError, NotADirectoryError):
        raise SceneError(f"there is no file {path}: check the path") from None
    except OSError as error:
        raise SceneError(f"{path} cannot be opened: {error.strerror or error}") from error
    return file


def refuse_special(paths: Iterable[Path]) -> None:
    """Raise SceneError for a pipe, socket or device among the paths; others need not exist."""
    for path in paths:
        try:
            mode = path.stat().st_mode
        except (OSError, ValueError):  # whoever opens it says so
            continue
        if not stat.S_ISDIR(mode):
            _refuse_special(str(path), mode)


def _refuse_special(path: str, mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise SceneError(f"{path} is a pipe, socket or device, not a file: save it as a file first")


def numbered_lines(path: Path) -> Iterator[tuple[int, str]]:
    """(number from 1, text) of each line. Raises SceneError for a line longer than `LONGEST`."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        number = 0
        while line := stream.readline(LONGEST):
            number += 1
            if len(line) == LONGEST:
                raise SceneError(
                    f"{path} line {number} has more than {LONGEST} characters: it is damaged, "
                    "or not a text file"
                )
            yield number, line


LARGEST = 2**30
"""Bytes of the largest file that is read whole; `RASTER_HARNESS_LARGEST_FILE` sets another limit.

Formats that are read in chunks have no limit: those of GDAL, GeoParquet, WKT, CityJSON sequences.
"""

VARIABLE = "RASTER_HARNESS_LARGEST_FILE"

_RATIO = 100
"""A usual archive is at most this many times smaller than its content, a ZIP bomb 1000 times."""


def largest() -> int:
    """The limit in bytes. Raises SceneError if the environment variable is not a number."""
    text = os.environ.get(VARIABLE, "")
    if not text:
        return LARGEST
    if not text.isdecimal():
        raise SceneError(f"{VARIABLE}={text!r} is not a number of bytes: give one like {LARGEST}")
    return int(text)


def check_size(path: Path) -> None:
    """Raise SceneError for a file too large to be read whole."""
    size, limit = path.stat().st_size, largest()
    if size > limit:
        raise SceneError(
            f"{path} has {_shown(size)}, but files of its format are held in memory and the limit "
            f"is {_shown(limit)}: give a part of it, or set {VARIABLE}={size}"
        )


def check_archive(path: Path) -> None:
    """Raise SceneError for a ZIP archive whose content is over the limit and far over its own size.

    Some formats are ZIP archives with another suffix; this holds for them too.
    """
    with path.open("rb") as stream:
        if stream.read(4) != b"PK\x03\x04" or not zipfile.is_zipfile(path):
            return
    with zipfile.ZipFile(path) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > max(largest(), _RATIO * path.stat().st_size):
        raise SceneError(
            f"{path} unpacks to {_shown(size)}, more than {_RATIO} times its size: "
            "unpack it yourself and give the file that you want from it"
        )


def _shown(size: int) -> str:
    return f"{size / 2**30:.3g} GiB" if size >= 2**30 else f"{size / 2**20:.3g} MiB"


_EDGE = 4096
SEQUENCES = (".geojsonl", ".geojsons", ".ndgeojson", ".ndjson", ".jsonl", ".nljson")
"""Suffixes of files with a GeoJSON object a line; other suffixes of JSON are looked into."""


def cut_off(path: Path, where: str) -> SceneError:
    """The error for a file that ends too early; `where` says how that is seen."""
    return SceneError(f"{path} was cut off: {where}; polygons are missing: write or copy it again")


def check_cut_off(path: Path) -> None:
    """Raise SceneError for a file that was cut off, as far as its first and last bytes show that.

    What is missing at the end of a file cannot be named, so such a file is refused. It shows that
    where its format has an end mark, says how long it is, or ends in the middle of a record. The
    formats that are not looked at here show it to their reader, or not at all.
    """
    seen = _CHECKS.get(path.suffix.lower())
    where = seen(path) if seen is not None and path.is_file() else None
    if where:
        raise cut_off(path, where)


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
    """A Shapefile says at byte 24 how many 16-bit words it has."""
    head, _ = _edges(path)
    return _shorter(path, 2 * struct.unpack_from(">I", head, 24)[0]) if len(head) >= 100 else None


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
    ".shp": _shape,
    **dict.fromkeys((".gpkg", ".sqlite", ".db", ".mbtiles"), _database),
    ".stl": _stl,
    ".off": _off,
    **dict.fromkeys((*SEQUENCES, ".json", ".geojson"), _last_line),
}


DEEPEST = 100
"""Levels of the deepest geometry that is parsed: far more than any has, and safe on any stack."""

_HEADER = 9
"""Bytes of a nested geometry at least: byte order, type, number of parts."""
_POINT, _LINE, _POLYGON, _ARC = 1, 2, 3, 8
_HOLDERS = (4, 5, 6, 7, 9, 10, 11, 12)
"""Types made of geometries: multi-points to collections, and those of curves."""


def text_too_deep(text: str) -> bool:
    """Whether WKT is nested deeper than `DEEPEST`.

    >>> text_too_deep("POLYGON ((0 0, 1 0, 1 1, 0 0))"), text_too_deep("(" * 101)
    (False, True)
    """
    if text.count("(") <= DEEPEST:
        return False
    letters = np.frombuffer(text.encode(), dtype=np.uint8)
    levels = (letters == ord("(")).astype(np.int64) - (letters == ord(")"))
    return int(np.cumsum(levels).max()) > DEEPEST


def too_deep(wkb: bytes) -> bool:
    """Whether (E)WKB is nested deeper than `DEEPEST`. What is not WKB is not; its parser says so.

    >>> level = bytes.fromhex("010700000001000000")
    >>> too_deep(99 * level), too_deep(101 * level + bytes.fromhex("0101000000") + bytes(16))
    (False, True)
    """
    if len(wkb) <= DEEPEST * _HEADER:
        return False
    left: list[int] = []  # parts still to come, of each geometry that is open
    at, order = 0, "<"
    try:
        while len(left) <= DEEPEST:
            order = {0: ">", 1: "<"}.get(wkb[at], order)
            code = struct.unpack_from(order + "I", wkb, at + 1)[0]
            at += 9 if code & 0x20000000 else 5  # with an SRID
            kind, flat = (code & 0xFFFF) % 1000, (code & 0xFFFF) // 1000
            heights = bool(code & 0x80000000) or flat in (1, 3)
            measures = bool(code & 0x40000000) or flat in (2, 3)
            point = 8 * (2 + heights + measures)
            if kind in _HOLDERS:
                left.append(struct.unpack_from(order + "I", wkb, at)[0])
                at += 4
            else:
                at = _after(wkb, at, order, kind, point)
                if left:
                    left[-1] -= 1
            while left and left[-1] == 0:
                left.pop()
                if left:
                    left[-1] -= 1
            if not left:
                return False
    except (struct.error, IndexError):  # cut short, before it is too deep
        return False
    return True


def _after(wkb: bytes, at: int, order: str, kind: int, point: int) -> int:
    """Where a geometry without parts ends, whose coordinates begin at `at`."""
    if kind == _POINT:
        return at + point
    lines = 1
    if kind == _POLYGON:
        lines = struct.unpack_from(order + "I", wkb, at)[0]
        at += 4
    elif kind not in (_LINE, _ARC):
        raise IndexError
    for _ in range(lines):
        at += 4 + point * struct.unpack_from(order + "I", wkb, at)[0]
    return at
