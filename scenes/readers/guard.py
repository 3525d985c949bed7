"""Checks before a file is opened, and one-line errors for exceptions of libraries.

Libraries raise any exception for unexpected bytes. So all are caught by `raise_scene_errors`, which
raises a SceneError instead, or by `note_errors`, which adds a note and continues.
"""

import codecs
import csv
import logging
import re
import struct
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from scenes.scene import Note, SceneError
from scenes.spec import format_suggestion, import_optional, path_exists

_LOG = logging.getLogger(__name__)

_READER_EXTRAS = {"pyogrio": "gis", "fontTools": "svg"}
"""Packages that readers import at the top of the module, and the extra that installs each."""


@contextmanager
def raise_scene_errors(name: str, kind: str) -> Iterator[None]:
    """Raise any exception of the block as a SceneError of one line; `kind` is the format's name.

    >>> with raise_scene_errors("a.svg", "SVG"):
    ...     raise LookupError("unknown encoding:\\n no-such-code")
    Traceback (most recent call last):
    scenes.scene.SceneError: a.svg cannot be read as SVG: unknown encoding: no-such-code; check \
    its format, or export it again
    """
    try:
        yield
    except SceneError:
        raise
    except MemoryError as error:
        raise SceneError(f"{name} needs more memory than available: give a part of it") from error
    except Exception as error:
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        if missing and (package := missing.partition(".")[0]) in _READER_EXTRAS:
            import_optional(package, name, _READER_EXTRAS[package])
        # An extension module cannot be loaded: not an error of the file.
        if isinstance(error, ImportError) and error.path:
            raise
        raise SceneError(
            f"{name} cannot be read as {kind}: {format_reason(error)}; "
            "check its format, or export it again"
        ) from error


@contextmanager
def note_errors(notes: list[Note], name: str, problem: str) -> Iterator[None]:
    """Add a note to `notes` for any exception of the block; `problem` begins the note's reason.

    >>> notes = []
    >>> with note_errors(notes, "line 7", "is invalid"):
    ...     raise KeyError("vertices")
    >>> notes
    [('line 7', "is invalid: no 'vertices'")]
    """
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        _LOG.debug("%s: %s", name, problem, exc_info=error)
        notes.append((name, f"{problem}: {format_reason(error)}"))


def format_reason(error: Exception) -> str:
    """Return the message of an error, in one line.

    >>> [format_reason(e) for e in (ValueError("no\\n  number"), KeyError("type"), EOFError())]
    ['no number', "no 'type'", 'EOFError']
    """
    text = " ".join(str(error).split())
    if isinstance(error, KeyError):
        return f"no {text}"
    return text.removesuffix(".") or type(error).__name__


MAX_LINE_CHARACTERS = 64 * 2**20  # a coastline of a million vertices has 40 million
MAX_FILE_BYTES = 2**30  # of a file that is read into memory at once, not in chunks
_MAX_UNPACKED_RATIO = 100  # unpacked size relative to the archive; a ZIP bomb has 1000


def check_path(path: str) -> Path:
    """Return a file's or folder's path; raises SceneError for a missing, empty or special file."""
    file = Path(path)
    try:
        if file.is_dir():
            return file
        refuse_special(file)
        with file.open("rb") as stream:
            if not stream.read(1):
                raise SceneError(f"{path} is empty (0 bytes): give a file with polygons")
    except (FileNotFoundError, NotADirectoryError):
        raise SceneError(f"{path} not found: check the path") from None
    except (OSError, ValueError) as error:
        raise SceneError(f"{path} cannot be opened: {format_reason(error)}") from error
    return file


def refuse_special(path: Path) -> None:
    """Raise SceneError for a pipe, socket or device, whose content may be endless."""
    if path_exists(str(path)) and not (path.is_file() or path.is_dir()):
        raise SceneError(f"{path} is a pipe, socket or device, not a file: save it as a file first")


def check_size(path: Path, in_memory: bool) -> None:
    """Raise SceneError for gzip, UTF-16, a ZIP bomb, and a file too large for memory."""
    size, head = path.stat().st_size, read_both_ends(path, 4)[0]
    if head.startswith(b"\x1f\x8b"):
        raise SceneError(f"{path} is compressed by gzip: unpack it first, e.g. by gunzip -k")
    is_utf16 = head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    if is_utf16 and b"<" not in head:  # XML states its encoding
        raise SceneError(f"{path} is text in UTF-16: save it as UTF-8")
    if in_memory and size > MAX_FILE_BYTES:
        raise SceneError(
            f"{path} has {size:,} bytes, but files of this format are read into memory and the "
            f"limit is {MAX_FILE_BYTES:,}: give a part of it"
        )
    if head == b"PK\x03\x04" and zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > max(MAX_FILE_BYTES, _MAX_UNPACKED_RATIO * size):
            raise SceneError(
                f"{path} unpacks to {unpacked:,} bytes, more than {_MAX_UNPACKED_RATIO} times "
                "the archive: unpack it yourself and give a file from it"
            )


def number_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (number, text) of each line of a text file, numbered from 1."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        number = 0
        while line := stream.readline(MAX_LINE_CHARACTERS):
            number += 1
            if len(line) == MAX_LINE_CHARACTERS:
                raise SceneError(
                    f"{path} line {number} has at least {MAX_LINE_CHARACTERS} characters: give a "
                    "text file with shorter lines"
                )
            yield number, line


def read_both_ends(path: Path, size: int = 65_536) -> tuple[bytes, bytes]:
    """Return the first and the last `size` bytes of a file."""
    with path.open("rb") as stream:
        head = stream.read(size)
        stream.seek(max(0, path.stat().st_size - size))
        return head, stream.read()


def make_truncation_error(path: Path, evidence: str) -> SceneError:
    """Return the error for a truncated file; evidence : text such as "100 of 200 bytes"."""
    return SceneError(
        f"{path} is truncated ({evidence}): polygons are missing; export or copy it again"
    )


def check_truncation(path: Path) -> None:
    """Raise SceneError for a truncated file, unless truncation is a syntax error in its format."""
    inspect = _INSPECTIONS.get(path.suffix.lower())
    if inspect is not None and (evidence := inspect(path)):
        raise make_truncation_error(path, evidence)


def check_quotes(path: Path) -> None:
    """Raise SceneError for CSV with text after a closing quote: GDAL would skip rows silently."""
    # Read as latin-1, which accepts all bytes, because only quotes are checked.
    with path.open(encoding="latin-1", newline="") as stream:
        head = stream.readline(MAX_LINE_CHARACTERS)
        stream.seek(0)
        separator = max(",;\t|", key=head.count)
        rows = csv.reader(stream, delimiter=separator, strict=True)
        limit = csv.field_size_limit(MAX_LINE_CHARACTERS)
        try:
            for _ in rows:
                pass
        except csv.Error as error:
            if "expected after" in str(error):
                raise SceneError(
                    f"{path} line {rows.line_num}: text after a closing quote; write each quote "
                    "inside a quoted value twice"
                ) from error
        finally:
            csv.field_size_limit(limit)


def check_quoted_names(path: str, condition: str, columns: Iterable[str]) -> None:
    """Raise SceneError for a quoted name of no column, which SQLite would take as text."""
    names = [column.lower() for column in columns]
    for name in re.findall(r"'[^']*'|\"((?:[^\"]|\"\")*)\"", condition):
        if name and name.replace('""', '"').lower() not in names:
            hint = format_suggestion(name, names, "it has")
            raise SceneError(f"{path}: invalid condition {condition!r}: no column {name!r}; {hint}")


def check_last_line(path: Path, is_valid: Callable[[bytes], object]) -> None:
    """Raise SceneError if the last line has no end, and `is_valid` is false or raises an error."""
    last = read_both_ends(path)[1]
    if b"\n" not in last:
        last = read_both_ends(path, MAX_LINE_CHARACTERS)[1]
    before, _, line = last.rpartition(b"\n")
    if not (before.strip() and line.strip()):
        return  # the last line has an end, or is the only line
    with suppress(ValueError, RecursionError):
        if is_valid(line.strip(b"\x1e \t\r")):
            return
    raise make_truncation_error(path, "the last line is incomplete")


def _inspect_drawing(path: Path) -> str | None:
    """Return evidence that a DXF drawing is truncated: no EOF at the end; None if complete."""
    ended = read_both_ends(path)[1].rstrip(b"\0\x1a \t\r\n").endswith(b"EOF")
    return None if ended else "no EOF at the end"


def _compare_length(path: Path, stated: int) -> str | None:
    """Return evidence that a file is shorter than the stated number of bytes; None if not."""
    size = path.stat().st_size
    return f"{size} of {stated} bytes" if size < stated else None


def _inspect_shapefile(path: Path) -> str | None:
    """Return evidence of truncation by the length that a Shapefile states, in 16-bit words."""
    head, _ = read_both_ends(path)
    length = struct.unpack_from(">I", head, 24)[0] if len(head) >= 100 else 0
    return _compare_length(path, 2 * length)


def _inspect_database(path: Path) -> str | None:
    """Return evidence of truncation by the number of pages that an SQLite database states."""
    head, _ = read_both_ends(path)
    if len(head) < 100 or not head.startswith(b"SQLite format 3\0"):
        return None
    page = struct.unpack_from(">H", head, 16)[0]
    changes, pages = struct.unpack_from(">II", head, 24)
    is_current = changes == struct.unpack_from(">I", head, 92)[0]
    return _compare_length(path, pages * (65536 if page == 1 else page)) if is_current else None


def _inspect_stl(path: Path) -> str | None:
    """Return evidence of truncation by the number of triangles in binary STL, or the last line."""
    head, tail = read_both_ends(path)
    stated = 84 + 50 * struct.unpack_from("<I", head, 80)[0] if len(head) >= 84 else 0
    if path.stat().st_size == stated:
        return None
    if head.lstrip().lower().startswith(b"solid") and b"facet" in head.lower():
        return None if b"endsolid" in tail.lower() else "no endsolid at the end"
    return _compare_length(path, stated)


def _inspect_off(path: Path) -> str | None:
    """Return evidence of truncation by the number of faces that OFF states, one item per line."""
    text = re.sub(r"#.*", "", path.read_text(encoding="utf-8", errors="replace"))
    header = re.match(r"\s*\w*OFF\s+(\d+)\s+(\d+)", text)
    if header is None:
        return None
    vertices, faces = int(header[1]), int(header[2])
    lines = [line.split() for line in text[header.end() :].splitlines()[1:] if line.strip()]
    complete = [numbers for numbers in lines[vertices:] if len(numbers) > int(numbers[0])]
    return f"{len(complete)} of {faces} faces" if len(complete) < faces else None


_INSPECTIONS: dict[str, Callable[[Path], str | None]] = {
    ".dxf": _inspect_drawing,
    ".shp": _inspect_shapefile,
    **dict.fromkeys((".gpkg", ".sqlite", ".db", ".mbtiles"), _inspect_database),
    ".stl": _inspect_stl,
    ".off": _inspect_off,
}
