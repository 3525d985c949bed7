"""Writing a run folder: records are appended, and the other files are replaced atomically."""

import contextlib
import errno
import hashlib
import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import atomic
from harness.errors import InputError, StorageError, UsageError
from harness.frame import Frame
from harness.machine import system
from harness.results.parsing import record_to_json
from harness.results.record import Record
from harness.results.run_folder import (
    ARRAYS,
    CASES,
    COUNTED,
    FACTS,
    FRAME_COLUMNS,
    FRAMES,
    POLYGONS,
    SCHEMA_VERSION,
    TRIANGLES,
    WRITTEN,
    Run,
    get_view_file_stem,
    read_digests,
    read_facts,
    read_geometry,
    translate_errors,
)


class _RecordFile:
    """An append-only file of records, one per line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor = -1
        self._digest = hashlib.sha256()
        self._bytes = 0

    def open(self) -> None:
        """Lock the file, open it for appending, and remove an incomplete last line."""
        folder, name = self.path.parent, self.path.name
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
        self._descriptor = atomic.open_inside(folder, name, flags)
        if not system.lock_file(self._descriptor, wait=False):
            self.close()
            raise StorageError(f"{self.path.parent} is in use by another run; choose another --out")
        content = atomic.read_inside(folder, name)
        end = content.rfind(b"\n") + 1
        if end < len(content):
            os.ftruncate(self._descriptor, end)
        self._digest, self._bytes = hashlib.sha256(content[:end]), end

    @property
    def written(self) -> dict[str, Any]:
        return {"bytes": self._bytes, "sha256": self._digest.hexdigest()}

    def append(self, record: Record, *, forced: bool) -> None:
        """Add a record; if `forced`, it also survives a power failure."""
        if self._descriptor < 0:
            self.open()
        values = record_to_json(record)
        line = (json.dumps(values, ensure_ascii=False, allow_nan=False) + "\n").encode()
        size = os.fstat(self._descriptor).st_size
        remaining = line
        try:
            while remaining:
                remaining = remaining[os.write(self._descriptor, remaining) :]
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


class RunFolder:
    """The folder of a run, open for writing; `remedy` is advice about a full disk."""

    def __init__(self, path: Path, remedy: str = "") -> None:
        self.path = path
        self._remedy = remedy
        self._cases = _RecordFile(path / CASES)
        self._counted = _RecordFile(path / COUNTED)
        self._arrays: dict[str, str] = {}

    @classmethod
    def create(cls, path: Path, remedy: str = "") -> "RunFolder":
        """Make a new folder; raise UsageError if it has a run, StorageError if it is unusable."""
        writer = cls(path, remedy)
        with translate_errors(path, remedy):
            path.mkdir(parents=True, exist_ok=True)
            # An empty file is not a run: a process killed right after its start leaves one.
            cases = writer._cases.path
            if (cases.exists() and cases.stat().st_size) or (path / FACTS).exists():
                raise UsageError(
                    f"{path} already has a run; choose another --out, or --resume {path}"
                )
            writer._cases.open()
        return writer

    @classmethod
    def resume(cls, path: Path) -> "RunFolder":
        """Open the run at `path` for more records; raises InputError or StorageError."""
        if not (path / FACTS).is_file():
            raise InputError(f"{path} has no run to resume ({FACTS} is missing)")
        writer = cls(path)
        with translate_errors(path):
            writer._cases.open()
        writer._arrays |= read_digests(read_facts(path, []))
        return writer

    def write_facts(self, facts: Mapping[str, Any]) -> None:
        """Replace `run.json` atomically; in a complete run, add the checksums of its files."""
        content = {"schema_version": SCHEMA_VERSION, **facts}
        content.pop(WRITTEN, None)
        if facts.get("interrupted") is False:
            content[WRITTEN] = {**self._cases.written, ARRAYS: self._arrays}
        text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
        with translate_errors(self.path, self._remedy):
            atomic.write(self.path / FACTS, (text + "\n").encode(), forced=True)

    def write_arrays(
        self, key: str, arrays: Mapping[str, NDArray[Any]], folder: str = POLYGONS
    ) -> None:
        """Write arrays to `<folder>/<key>.npz`; by default a case's columns, each (p,)."""
        content = io.BytesIO()
        np.savez_compressed(content, allow_pickle=False, **arrays)
        name = f"{folder}/{key}.npz"
        with translate_errors(self.path, self._remedy):
            if (self.path / folder).is_symlink():
                raise OSError(errno.ELOOP, "a link, which is not followed", str(self.path / folder))
            (self.path / folder).mkdir(exist_ok=True)
            atomic.write(self.path / name, content.getvalue())
        self._arrays[name] = hashlib.sha256(content.getvalue()).hexdigest()

    def write_geometry(self, frame: Frame, triangles: Mapping[str, NDArray[np.int32]]) -> None:
        """Store a frame and triangulations (m, 3) by name; others of the frame are retained."""
        stored = read_geometry(Run(self.path, {}, []), frame.view)
        if stored is not None and np.array_equal(stored.points, frame.points):
            triangles = {**stored.triangles, **triangles}
        arrays = (
            frame.points,
            frame.grid.vertex_offsets,
            frame.source,
            frame.grid.ring_offsets[1:],
        )
        columns: dict[str, NDArray[Any]] = dict(zip(FRAME_COLUMNS, arrays, strict=True))
        named = {TRIANGLES + name: rows for name, rows in triangles.items()}
        self.write_arrays(get_view_file_stem(frame.view), columns | named, FRAMES)

    def append(self, record: Record) -> None:
        """Add one record and force it to the disk."""
        with translate_errors(self.path, self._remedy):
            self._cases.append(record, forced=True)

    def append_counted(self, record: Record) -> None:
        """Add the record of a case that is counted but not timed."""
        with translate_errors(self.path, self._remedy):
            self._counted.append(record, forced=False)

    def delete_counted(self) -> None:
        """Delete the records of `append_counted`, because every case is finished."""
        self._counted.close()
        with translate_errors(self.path, self._remedy):
            self._counted.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the files of records."""
        self._cases.close()
        self._counted.close()

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
