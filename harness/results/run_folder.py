"""A run on disk: a plain folder that any tool can read and no crash can spoil.

`run.json` holds environment and plan, `cases.jsonl` one record a line. A record is written in one
append and forced to the disk before the next case starts, so a kill loses at most the case in
flight; a last line that was torn by one is ignored on reading and cut off before more is added.

While cases are timed, which takes long, `counted.jsonl` holds the records of those that are counted
but not finished: what a resumed run need not count again. It goes when the run is complete.
"""

import contextlib
import errno
import hashlib
import io
import json
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import atomic
from harness.errors import InputError, StorageError, UsageError
from harness.machine import system
from harness.results.facts import RunFacts
from harness.results.parsing import (
    FieldError,
    check_facts,
    parse_json,
    parse_record,
    record_to_json,
)
from harness.results.record import Record

SCHEMA_VERSION = 1

FACTS = "run.json"
CASES = "cases.jsonl"
COUNTED = "counted.jsonl"
"""Records of finished cases, and of those that are counted but not finished."""

WRITTEN = "written"
"""In the facts of a run that is done: length and digest of its records, and `ARRAYS`."""

ARRAYS = "arrays"
"""Digests of the files of arrays that were written."""

POLYGONS = "polygons"
"""Folder of each case's per-polygon columns."""

UNREADABLE = (
    *(OSError, EOFError, ValueError, KeyError, RuntimeError, TypeError, AttributeError),
    *(MemoryError, zipfile.BadZipFile, zlib.error),
)
"""Errors of numpy and zipfile for damaged files: empty, truncated, or with bytes changed."""


@dataclass(frozen=True)
class Run:
    """A run as read back.

    path : its folder, or its `cases.jsonl` where only that file was given
    facts : the content of `run.json`, {} where there is none
    records : in the order written
    problems : one line for each thing that could not be read
    changed : names of files of arrays that something else than the run has written
    cut_off : what says that records of a run that was done are lost; "" where none are
    """

    path: Path
    facts: RunFacts
    records: Sequence[Record]
    problems: list[str] = field(default_factory=list)
    changed: frozenset[str] = frozenset()
    cut_off: str = ""

    @property
    def base(self) -> str:
        """The triangulator that --base chose, "" if none."""
        return str(self.facts.get("base") or "")

    @property
    def folder(self) -> Path:
        """The run's folder."""
        return self.path if self.path.is_dir() else self.path.parent


class _Lines:
    """A file of records that only grows: one a line, each whole or not at all."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor = -1
        self._digest = hashlib.sha256()
        self._bytes = 0

    def open(self) -> None:
        """Open it for more records, cutting off a torn last line; no other process may.

        Raises
        ------
        StorageError
            if another process has it open
        """
        folder, name = self.path.parent, self.path.name
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
        self._descriptor = atomic.open_inside(folder, name, flags)
        if not system.lock(self._descriptor, wait=False):
            self.close()
            raise StorageError(f"{self.path.parent} is in use: another process measures into it")
        content = atomic.read_inside(folder, name)
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            os.ftruncate(self._descriptor, whole)
        self._digest, self._bytes = hashlib.sha256(content[:whole]), whole

    @property
    def written(self) -> dict[str, Any]:
        """Length and digest of what is in the file if nobody else has written to it."""
        return {"bytes": self._bytes, "sha256": self._digest.hexdigest()}

    def append(self, record: Record, *, forced: bool) -> None:
        """Add a record; `forced`: to the disk, so that it outlives a power cut, too."""
        if self._descriptor < 0:
            self.open()
        values = record_to_json(record)
        line = (json.dumps(values, ensure_ascii=False, allow_nan=False) + "\n").encode()
        size = os.fstat(self._descriptor).st_size
        left = line
        try:
            while left:
                left = left[os.write(self._descriptor, left) :]
            if forced:
                os.fsync(self._descriptor)
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, size)
            raise
        self._digest.update(line)
        self._bytes += len(line)

    def close(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class Store:
    """The folder of a run that is being written.

    again : if the folder cannot be resumed, what to do once a full disk has space again
    """

    def __init__(self, path: Path, again: str = "") -> None:
        self.path = path
        self._again = again
        self._cases = _Lines(path / CASES)
        self._counted = _Lines(path / COUNTED)
        self._arrays: dict[str, str] = {}

    @classmethod
    def create(cls, path: Path, again: str = "") -> "Store":
        """Make a new folder at `path`.

        Raises
        ------
        UsageError
            if it cannot be written or already holds a run
        """
        store = cls(path, again)
        with clear_errors(path, again):
            path.mkdir(parents=True, exist_ok=True)
            # A process that was killed at once leaves an empty file.
            cases = store._cases.path
            if (cases.exists() and cases.stat().st_size) or (path / FACTS).exists():
                raise UsageError(f"{path} already holds a run; give another --out, or --resume it")
            store._cases.open()
        return store

    @classmethod
    def resume(cls, path: Path) -> "Store":
        """Open the run at `path` for more records, cutting off a torn last line.

        Raises
        ------
        InputError
            if there is no run, or it cannot be written
        """
        if not (path / FACTS).is_file():
            raise InputError(f"{path} holds no run to resume (no {FACTS} in it)")
        store = cls(path)
        with clear_errors(path):
            store._cases.open()
        store._arrays |= _digests(read_facts(path, []))
        return store

    def write_facts(self, facts: Mapping[str, Any]) -> None:
        """Replace `run.json`, whole or not at all; of a run that is done, what its records are."""
        content = {"schema_version": SCHEMA_VERSION, **facts}
        content.pop(WRITTEN, None)
        if facts.get("interrupted") is False:
            content[WRITTEN] = {**self._cases.written, ARRAYS: self._arrays}
        text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
        with clear_errors(self.path, self._again):
            atomic.write(self.path / FACTS, (text + "\n").encode(), forced=True)

    def write_arrays(
        self, key: str, arrays: Mapping[str, NDArray[Any]], folder: str = POLYGONS
    ) -> None:
        """Store arrays as `<folder>/<key>.npz`; by default a case's columns, each (p,)."""
        content = io.BytesIO()
        np.savez_compressed(content, allow_pickle=False, **arrays)
        name = f"{folder}/{key}.npz"
        with clear_errors(self.path, self._again):
            if (self.path / folder).is_symlink():
                raise OSError(errno.ELOOP, "a link, which is not followed", str(self.path / folder))
            (self.path / folder).mkdir(exist_ok=True)
            atomic.write(self.path / name, content.getvalue())
        self._arrays[name] = hashlib.sha256(content.getvalue()).hexdigest()

    def append(self, record: Record) -> None:
        """Add one record and force it to the disk.

        Raises
        ------
        UsageError
            if the disk is full or gone; what was written before stays readable
        """
        with clear_errors(self.path, self._again):
            self._cases.append(record, forced=True)

    def append_counted(self, record: Record) -> None:
        """Add the record of a case that is counted but not finished; raises as `append` does."""
        with clear_errors(self.path, self._again):
            self._counted.append(record, forced=False)

    def drop_counted(self) -> None:
        """Remove what `append_counted` kept: every case is finished."""
        self._counted.close()
        with clear_errors(self.path, self._again):
            self._counted.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the files of records."""
        self._cases.close()
        self._counted.close()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_run(path: Path) -> Run:
    """Read the run folder at `path`, or a single `cases.jsonl` file.

    Damaged records and parts of `run.json` are left out, with a problem each.

    Raises
    ------
    InputError
        if nothing is there, or it was written by a newer schema
    """
    cases = path / CASES if path.is_dir() else path
    if not cases.exists() and not cases.with_name(FACTS).exists():
        raise InputError(f"{path} holds no run (neither {FACTS} nor {CASES})")
    problems: list[str] = []
    facts = read_facts(cases.parent, problems)
    with clear_errors(path):
        content = b""
        if path.is_dir() and os.path.lexists(cases):
            content = atomic.read_inside(path, CASES)
        elif cases.exists():  # which may be a link if the user names it
            content = atomic.read(cases)
    version = facts.get("schema_version", SCHEMA_VERSION)
    if not isinstance(version, int) or version > SCHEMA_VERSION:
        raise InputError(
            f"{path} has schema version {version}, newer than this raster-harness reads "
            f"({SCHEMA_VERSION}); update raster-harness"
        )
    records = _parse_lines(content, cases, problems)
    written, cut_off = facts.get("written") or {}, ""
    size = written.get("bytes")
    if isinstance(size, int) and len(content) < size:
        cut_off = f"{cases} was cut off: it has {len(content):,} of {size:,} bytes"
        problems.append(cut_off)
    elif written and hashlib.sha256(content).hexdigest() != written.get("sha256"):
        problems.append(
            f"{cases} is not as the run left it: something else, such as a plugin's process, has "
            "written there; trust none of its records that you did not measure again"
        )
    changed = frozenset(_changed(cases.parent, _digests(facts)))
    for name in sorted(changed):
        problems.append(f"{cases.parent / name} is not as the run left it, and is not used")
    if not path.is_dir() and not records:
        raise InputError(
            f"{path} holds no record of a run{': ' if problems else ''}"
            f"{problems[0] if problems else ''}"
        )
    return Run(path, facts, records, problems, changed, cut_off)


def _digests(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the digests of the run's files of arrays by name, {} where it tells none."""
    digests = (facts.get(WRITTEN) or {}).get(ARRAYS)
    items = digests.items() if isinstance(digests, dict) else ()
    return {name: value for name, value in items if isinstance(value, str) and len(value) == 64}


def _changed(folder: Path, digests: Mapping[str, str]) -> Iterator[str]:
    """Yield the names of files of arrays that something else than the run has written."""
    for name, digest in digests.items():
        try:
            with os.fdopen(atomic.open_inside(folder, name), "rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() == digest:
                    continue
        except FileNotFoundError:
            continue
        except OSError:  # a link, or a name outside of the folder
            pass
        yield name


def read_facts(folder: Path, problems: list[str]) -> RunFacts:
    """Return the content of a run's `run.json`, {} where there is none.

    problems : gets a line for each thing that could not be used
    """
    file = folder / FACTS
    if not os.path.lexists(file):
        return {}
    with clear_errors(folder):
        content = atomic.read_inside(folder, FACTS)
    try:
        found = parse_json(content)
    except ValueError as error:
        problems.append(f"{file} is not JSON: {error}")
        return {}
    if not isinstance(found, dict):
        problems.append(f"{file} does not hold an object")
        return {}
    return check_facts(found, problems)


def read_counted(path: Path) -> dict[str, Record]:
    """Return by key what the unfinished run at `path` had counted; see `Store.append_counted`."""
    file = path / COUNTED
    with clear_errors(path):
        content = atomic.read_inside(path, COUNTED) if os.path.lexists(file) else b""
    return {record.key: record for record in _parse_lines(content, file, [])}


def _parse_lines(content: bytes, file: Path, problems: list[str]) -> list[Record]:
    """Return the usable records of a file's complete lines; of one case the later counts.

    A case that failed and was run again on resume stands twice.
    """
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
    """Return the per-polygon columns of the case `key`, or None if they were not kept whole.

    What something else than the run has written there is not used (`Run.changed`).
    """
    name = f"{folder}/{key}.npz"
    if name in run.changed:
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


def file_stem(text: str) -> str:
    """Return a name with whatever a file's name had better not have as hyphens.

    Letters and digits of any alphabet stay, and so do hyphens, underscores and dots.
    """
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in text)


@contextlib.contextmanager
def clear_errors(path: Path, advice: str = "") -> Iterator[None]:
    """Turn an OSError about the folder into one clear line.

    advice : how to go on once there is space on a disk that is full; by default by --resume
    """
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            safe = "" if advice else " what was measured so far is safe:"
            raise StorageError(
                f"the disk of {path} is full;{safe} "
                f"free some space, then {advice or f'--resume {path}'}"
            ) from error
        inside = error.filename and Path(str(error.filename)).is_relative_to(path)
        file = error.filename if inside else path
        raise StorageError(f"cannot use {file}: {error.strerror}") from error
