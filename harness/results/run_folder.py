"""Reading a run on disk: a plain folder that any tool can read and that survives a crash.

`run.json` holds environment and plan, `cases.jsonl` one record per line. A record is written in one
append and forced to the disk before the next case starts, so a kill loses at most the case in
progress; an incomplete last line is ignored on reading and removed before records are added.

While cases are timed, which takes long, `counted.jsonl` holds the records of cases that are counted
but not timed, so that a resumed run need not count them again. A complete run deletes it.
"""

import contextlib
import errno
import hashlib
import os
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import atomic
from harness.errors import InputError, StorageError
from harness.frame import View
from harness.results.parsing import FieldError, parse_json, parse_record, select_valid_facts
from harness.results.record import CaseId, Record, RunFacts
from triangulators.polygon_arrays import PolygonArray

SCHEMA_VERSION = 1

FACTS = "run.json"
CASES = "cases.jsonl"  # finished records
COUNTED = "counted.jsonl"  # counted but not timed records
STORED_PROFILE = "profile.json"  # of `run --profile`
WRITTEN = "written"  # key of `run.json` in a complete run: size and digest of records, `ARRAYS`
ARRAYS = "arrays"  # key in `WRITTEN` of the array files' digests
POLYGONS = "polygons"  # folder of each case's per-polygon columns
FRAMES = "frames"  # folder of each view's polygons and triangulations
TRIANGLES = "triangles "  # before a triangulator's name: key of the triangles in a file of `FRAMES`
FRAME_COLUMNS = ("points", "offsets", "source", "ring_ends")  # docs/reference/files.md

UNREADABLE = (  # errors of numpy and zipfile for damaged files: empty, truncated, or changed
    *(OSError, EOFError, ValueError, KeyError, RuntimeError, TypeError, AttributeError),
    *(MemoryError, zipfile.BadZipFile, zlib.error),
)


@dataclass(frozen=True)
class Run:
    """A stored run."""

    path: Path  # folder, or `cases.jsonl` if only that file was given
    facts: RunFacts  # the content of `run.json`, or {} if missing
    records: Sequence[Record]  # in the order written
    problems: list[str] = field(default_factory=list)  # a line for each unreadable part
    modified: frozenset[str] = frozenset()  # names of array files whose checksum differs
    truncation: str = ""  # message if the file of records is shorter than when it was written

    @property
    def base(self) -> str:
        """The triangulator selected by --base, or ""."""
        return str(self.facts.get("base") or "")

    @property
    def folder(self) -> Path:
        """The run's folder."""
        return find_folder(self.path)


def find_folder(path: Path) -> Path:
    """Return a run's folder, given the folder or its cases.jsonl."""
    return path if path.is_dir() else path.parent


@dataclass(frozen=True)
class Geometry:
    """A frame's polygons and their triangulations, as stored for heatmaps and measuring pages."""

    grid: PolygonArray  # int32 coordinates in 1/256 px, y up
    source: NDArray[np.int64]  # (p,) numbers of the polygons in the scene
    triangles: dict[str, NDArray[np.int32]]  # triangulator -> (m, 3) rows of `points`, by polygon

    @property
    def points(self) -> NDArray[np.int32]:
        """Vertices of all polygons, (n, 2) int32."""
        return self.grid.coords


def read_run(path: Path) -> Run:
    """Read a run.

    Parameters
    ----------
    path : Path
        A run folder, or a single `cases.jsonl` file.

    Returns
    -------
    Run
        The valid records and facts; `problems` has a line for each invalid record or part of
        `run.json`.

    Raises
    ------
    InputError
        If the path has no run, or the schema is newer.
    """
    cases = path / CASES if path.is_dir() else path
    if not cases.exists() and not cases.with_name(FACTS).exists():
        raise InputError(f"{path} has no run ({FACTS} and {CASES} are missing)")
    problems: list[str] = []
    facts = read_facts(cases.parent, problems)
    with translate_errors(path):
        content = b""
        if path.is_dir() and os.path.lexists(cases):
            content = atomic.read_inside(path, CASES)
        elif cases.exists():  # a file that the user names may be a link
            content = atomic.read(cases)
    version = facts.get("schema_version", SCHEMA_VERSION)
    if not isinstance(version, int) or version > SCHEMA_VERSION:
        raise InputError(
            f"{path} has schema version {version}, newer than this raster-harness reads "
            f"({SCHEMA_VERSION}); update raster-harness"
        )
    records = _parse_lines(content, cases, problems)
    written, truncation = facts.get("written") or {}, ""
    size = written.get("bytes")
    if isinstance(size, int) and len(content) < size:
        truncation = (
            f"{cases}: incomplete, {len(content):,} of {size:,} bytes (truncated, or modified "
            "after the run)"
        )
        problems.append(truncation)
    elif written and hashlib.sha256(content).hexdigest() != written.get("sha256"):
        problems.append(
            f"{cases}: modified after the run (checksum mismatch), for example by a plugin's "
            "process; measure again before relying on its records"
        )
    modified = frozenset(_find_modified(cases.parent, read_digests(facts)))
    for name in sorted(modified):
        problems.append(
            f"{cases.parent / name}: modified after the run (checksum mismatch); ignored"
        )
    if not path.is_dir() and not records:
        raise InputError(": ".join([f"{path} holds no record of a run", *problems[:1]]))
    return Run(path, facts, records, problems, modified, truncation)


def select_latest(run: Run) -> Run:
    """Return the run with the last record of each case, and a problem for each skipped record.

    A run that was resumed by force may have two records of a case, from two contents of the scene.
    """
    problems = list(run.problems)
    records: dict[CaseId, Record] = {}
    for record in run.records:
        if records.pop(record.id, None) is not None:
            problems.append(f"{record.id}: measured twice; the later record is used")
        records[record.id] = record
    return replace(run, records=list(records.values()), problems=problems)


def read_latest(path: Path, warn: Callable[[str], None]) -> Run:
    """Return the run at `path` with the last record of each case; pass each problem to `warn`."""
    run = select_latest(read_run(path))
    for problem in run.problems:
        warn(problem)
    return run


def read_digests(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the digests of the run's array files by name, {} if not stored."""
    digests = (facts.get(WRITTEN) or {}).get(ARRAYS)
    items = digests.items() if isinstance(digests, dict) else ()
    return {name: value for name, value in items if isinstance(value, str) and len(value) == 64}


def _find_modified(folder: Path, digests: Mapping[str, str]) -> Iterator[str]:
    for name, digest in digests.items():
        try:
            with os.fdopen(atomic.open_inside(folder, name), "rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() == digest:
                    continue
        except FileNotFoundError:
            continue
        except OSError:  # a link, or a name outside the folder
            pass
        yield name


def read_facts(folder: Path, problems: list[str]) -> RunFacts:
    """Return a run's `run.json`, {} if missing; each invalid part adds a line to `problems`."""
    file = folder / FACTS
    if not os.path.lexists(file):
        return {}
    with translate_errors(folder):
        content = atomic.read_inside(folder, FACTS)
    try:
        facts = parse_json(content)
    except ValueError as error:
        problems.append(f"{file} is not JSON: {error}")
        return {}
    if not isinstance(facts, dict):
        problems.append(f"{file}: invalid (not a JSON object); ignored")
        return {}
    return select_valid_facts(facts, problems)


def read_counted(path: Path) -> dict[str, Record]:
    """Return the records, by key, of cases that an unfinished run has counted but not timed."""
    file = path / COUNTED
    with translate_errors(path):
        content = atomic.read_inside(path, COUNTED) if os.path.lexists(file) else b""
    return {record.key: record for record in _parse_lines(content, file, [])}


def _parse_lines(content: bytes, file: Path, problems: list[str]) -> list[Record]:
    """Return the records of complete lines; of a case measured again on resume, the last."""
    end = content.rfind(b"\n") + 1
    records: dict[str, Record] = {}
    for number, line in enumerate(content[:end].split(b"\n")[:-1], start=1):
        try:
            values = parse_json(line)
        except ValueError:
            values = None
        if not isinstance(values, dict):
            problems.append(f"{file}, line {number}: not a record; ignored")
            continue
        try:
            record = parse_record(values)
        except FieldError as error:
            problems.append(f"{file}, line {number}: {error}; record ignored")
        else:
            records.pop(record.key, None)
            records[record.key] = record
    return list(records.values())


def read_arrays(run: Run, key: str, folder: str = POLYGONS) -> dict[str, NDArray[Any]] | None:
    """Return the arrays stored for a case.

    Parameters
    ----------
    run : Run
        A run read from a folder.
    key : str
        Key of the case (`Record.key`), or the file's stem in another folder.
    folder : str
        Subfolder of the run.

    Returns
    -------
    dict of str to array, or None
        By default counters and predictions per polygon, (p,); None if the file is missing, damaged
        or was modified after the run.
    """
    name = f"{folder}/{key}.npz"
    if name in run.modified:
        return None
    try:
        with (
            os.fdopen(atomic.open_inside(run.folder, name), "rb") as file,
            np.load(file, allow_pickle=False) as arrays,
        ):
            if sum(part.file_size for part in arrays.zip.infolist()) > atomic.MAX_READ_BYTES:
                return None
            return {name: arrays[name] for name in arrays.files}
    except UNREADABLE:
        return None


def read_geometry(run: Run, view: View) -> Geometry | None:
    """Return the polygons of a view and their triangulations.

    Parameters
    ----------
    run : Run
        A run read from a folder.
    view : View
        A view of the run's plan.

    Returns
    -------
    Geometry or None
        None if the geometry is not stored, or damaged.
    """
    arrays = read_arrays(run, get_view_file_stem(view), FRAMES)
    if arrays is None or not {*FRAME_COLUMNS} <= set(arrays):
        return None
    triangles = {
        name.removeprefix(TRIANGLES): rows
        for name, rows in arrays.items()
        if name.startswith(TRIANGLES)
    }
    points, offsets, source, ring_ends = (arrays[name] for name in FRAME_COLUMNS)
    ring_offsets = np.append(0, ring_ends).astype(np.int64)
    grid = PolygonArray(points, ring_offsets, np.searchsorted(ring_offsets, offsets))
    return Geometry(grid, source, triangles)


def get_view_file_stem(view: View) -> str:
    """Return the file name of a view, without suffix: 1024px-30deg-box."""
    return f"{view.resolution}px-{view.rotation:g}deg-{view.fit}"


def make_file_stem(text: str) -> str:
    """Return a file name: letters and digits of any alphabet, `-`, `_`, `.`; others become `-`."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in text)


@contextlib.contextmanager
def translate_errors(path: Path, remedy: str = "") -> Iterator[None]:
    """Turn an OSError about the folder into a `StorageError`; `remedy` is by default --resume."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            safe = "" if remedy else " finished cases are stored;"
            raise StorageError(
                f"the disk of {path} is full;{safe} "
                f"free some space, then {remedy or f'--resume {path}'}"
            ) from error
        inside = error.filename and Path(str(error.filename)).is_relative_to(path)
        file = error.filename if inside else path
        raise StorageError(f"cannot use {file}: {error.strerror}") from error
