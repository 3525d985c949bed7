"""A run on disk: a plain folder that any tool can read and no crash can spoil.

`run.json` holds environment and plan, `cases.jsonl` one record a line. A record is written in one
append and forced to the disk before the next case starts, so a kill loses at most the case in
flight; a last line that was torn by one is ignored on reading and cut off before more is added.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError

SCHEMA_VERSION = 1

POLYGONS = "polygons"
"""Folder of each case's per-polygon columns."""

Record = dict[str, Any]


@dataclass(frozen=True)
class Run:
    """A run as read back.

    path : its folder, or its `cases.jsonl` where only that file was given
    facts : the content of `run.json`, {} where there is none
    records : in the order written
    problems : one line for each thing that could not be read
    """

    path: Path
    facts: dict[str, Any]
    records: list[Record]
    problems: list[str] = field(default_factory=list)


class Store:
    """The folder of a run that is being written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._cases = path / "cases.jsonl"
        self._descriptor = -1

    @classmethod
    def create(cls, path: Path) -> Store:
        """Make a new folder at `path`.

        Raises
        ------
        UsageError
            if it cannot be written or already holds a run
        """
        store = cls(path)
        with _clear_errors(path):
            path.mkdir(parents=True, exist_ok=True)
            if store._cases.exists() or (path / "run.json").exists():
                raise UsageError(f"{path} already holds a run; give another --out, or --resume it")
            store._open()
        return store

    @classmethod
    def resume(cls, path: Path) -> Store:
        """Open the run at `path` for more records, cutting off a torn last line.

        Raises
        ------
        UsageError
            if there is no run, or it cannot be written
        """
        if not (path / "run.json").is_file():
            raise UsageError(f"{path} holds no run to resume (no run.json in it)")
        store = cls(path)
        with _clear_errors(path):
            if store._cases.exists():
                content = store._cases.read_bytes()
                whole = content.rfind(b"\n") + 1
                if whole < len(content):
                    os.truncate(store._cases, whole)
            store._open()
        return store

    def _open(self) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
        self._descriptor = os.open(self._cases, flags, 0o644)

    def write_facts(self, facts: Mapping[str, Any]) -> None:
        """Replace `run.json`, whole or not at all."""
        content = {"schema_version": SCHEMA_VERSION, **facts}
        text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
        self._replace("run.json", (text + "\n").encode())

    def write_arrays(
        self, key: str, arrays: Mapping[str, NDArray[Any]], folder: str = POLYGONS
    ) -> None:
        """Store arrays as `<folder>/<key>.npz`; by default a case's columns, each (p,)."""
        with _clear_errors(self.path):
            place = self.path / folder
            place.mkdir(exist_ok=True)
            with (place / f"{key}.npz").open("wb") as file:
                np.savez_compressed(file, allow_pickle=False, **arrays)

    def append(self, record: Record) -> None:
        """Add one record and force it to the disk.

        Raises
        ------
        UsageError
            if the disk is full or gone; what was written before stays readable
        """
        line = (json.dumps(record, ensure_ascii=False, allow_nan=False) + "\n").encode()
        size = os.fstat(self._descriptor).st_size
        with _clear_errors(self.path):
            try:
                while line:
                    line = line[os.write(self._descriptor, line) :]
                os.fsync(self._descriptor)
            except OSError:
                with contextlib.suppress(OSError):
                    os.ftruncate(self._descriptor, size)
                raise

    def close(self) -> None:
        """Close the file of records."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _replace(self, name: str, content: bytes) -> None:
        with _clear_errors(self.path):
            descriptor, temporary = tempfile.mkstemp(dir=self.path, prefix=f".{name}.")
            try:
                with os.fdopen(descriptor, "wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
                Path(temporary).chmod(0o644)
                Path(temporary).replace(self.path / name)
            except OSError:
                Path(temporary).unlink(missing_ok=True)
                raise


def read_run(path: Path) -> Run:
    """Read the run folder at `path`, or a single `cases.jsonl` file.

    Raises
    ------
    UsageError
        if nothing is there, or it was written by a newer schema
    """
    if path.is_dir():
        cases, facts_file = path / "cases.jsonl", path / "run.json"
    else:
        cases, facts_file = path, path.with_name("run.json")
    if not cases.exists() and not facts_file.exists():
        raise UsageError(f"{path} holds no run (neither run.json nor cases.jsonl)")
    problems: list[str] = []
    facts: dict[str, Any] = {}
    with _clear_errors(path):
        if facts_file.exists():
            try:
                found = json.loads(facts_file.read_bytes())
                facts = found if isinstance(found, dict) else {}
                if found is not facts:
                    problems.append(f"{facts_file} does not hold an object")
            except ValueError as error:
                problems.append(f"{facts_file} is not JSON: {error}")
        content = cases.read_bytes() if cases.exists() else b""
    version = facts.get("schema_version", SCHEMA_VERSION)
    if not isinstance(version, int) or version > SCHEMA_VERSION:
        raise UsageError(
            f"{path} has schema version {version}, newer than this harness reads "
            f"({SCHEMA_VERSION}); update raster-harness"
        )
    records = _parse_lines(content, cases, problems)
    return Run(path, facts, records, problems)


def _parse_lines(content: bytes, file: Path, problems: list[str]) -> list[Record]:
    whole = content.rfind(b"\n") + 1
    records: dict[str, Record] = {}
    for number, line in enumerate(content[:whole].splitlines(), start=1):
        try:
            record = json.loads(line)
            key = record["key"]
        except (ValueError, TypeError, KeyError):
            problems.append(f"{file}, line {number}: not a record; ignored")
            continue
        # A case that failed and was run again on resume stands twice: the later one counts.
        records.pop(key, None)
        records[key] = record
    return list(records.values())


def read_arrays(run: Run, key: str, folder: str = POLYGONS) -> dict[str, NDArray[Any]] | None:
    """Return the per-polygon columns of the case `key`, or None if they were not kept or are
    damaged.
    """
    place = run.path if run.path.is_dir() else run.path.parent
    file = place / folder / f"{key}.npz"
    try:
        with np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except Exception:  # damaged bytes make zipfile, zlib and numpy raise errors of every kind
        return None


def file_stem(text: str) -> str:
    """Return a name with whatever a file's name had better not have as hyphens.

    Letters and digits of any alphabet stay, and so do hyphens, underscores and dots.
    """
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in text)


class _clear_errors(contextlib.AbstractContextManager[None]):  # noqa: N801 - used as a function
    """Turn an OSError about the folder into one clear line."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if not isinstance(error, OSError):
            return
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise UsageError(
                f"the disk of {self._path} is full; what was measured so far is safe: "
                f"free some space, then --resume {self._path}"
            ) from error
        raise UsageError(f"cannot use {self._path}: {error.strerror}") from error
