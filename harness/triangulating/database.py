"""The model database: a cache of triangulations by content.

Several processes may use the SQLite file at once (write-ahead log). An entry has a checksum, and
its triangulation is verified after reading; optimality is not, so a file that other users may write
is refused, as is one of another program. A damaged database is deleted and created again.
"""

import hashlib
import json
import logging
import math
import os
import sqlite3
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

import triangulators
from harness.errors import StorageError
from harness.machine import system
from harness.machine.environment import describe_processor, get_version, hash_sources
from triangulators.compute.compiled_files import is_trusted, make_folder
from triangulators.polygon_arrays import PolygonArray

SCHEMA = 1

ENTRY_FORMAT = 2  # version of entries, part of their keys: older entries are not read
APPLICATION_ID = 0x52485443  # SQLite's application_id of model databases: "RHTC"
LOCK_MARK = b"raster-harness\n"  # content of the lock file

TABLE = (
    "CREATE TABLE model "
    "(key BLOB PRIMARY KEY, triangulator TEXT NOT NULL, value BLOB NOT NULL) WITHOUT ROWID"
)

_BATCH = 500  # SQLite accepts at least 999 parameters
_WAIT_S = 30.0
_LOG = logging.getLogger(__name__)
_Result = TypeVar("_Result")


class TimedTriangles(NamedTuple):
    """Triangles (m, 3) of a polygon, and the seconds of their computation.

    gap : relative gap to the optimum, infinite if unknown, or None for triangulators without gaps
    processor : hash of the name of the processor that computed them
    """

    triangles: NDArray[np.int32]
    seconds: float
    gap: float | None = None
    processor: bytes = bytes(8)


class ModelDatabase:
    """Triangulations by key, as a context manager; `warn` gets lines about damage."""

    def __init__(
        self, path: Path | None = None, warn: Callable[[str], None] = _LOG.warning
    ) -> None:
        self.path = path or system.get_database_path()
        self._warn = warn
        try:
            make_folder(self.path.parent)
            self._refuse_foreign()
            self._database = self._open()
        except (OSError, sqlite3.OperationalError) as error:
            raise StorageError(
                f"model database {self.path}: cannot be opened ({error}); set RASTER_HARNESS_CACHE"
            ) from error

    def __enter__(self) -> "ModelDatabase":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the database; this object must not be used afterwards."""
        self._database.close()

    def find(self, keys: Sequence[bytes]) -> dict[bytes, TimedTriangles]:
        """Return the intact entries by key; keys without an entry are absent."""
        return self._run_or_default(lambda: self._read(keys), {})

    def store(self, triangulator: str, key: bytes, model: TimedTriangles) -> None:
        """Store a triangulation; replace an entry with the same key."""

        def write() -> None:
            with self._database:
                row = (key, triangulator, _pack_entry(key, model))
                self._database.execute("INSERT OR REPLACE INTO model VALUES (?, ?, ?)", row)

        self._run_or_default(write, None)

    def clear(self) -> int:
        """Delete all entries; return their number."""
        return self._run_or_default(self._delete_all, 0)

    def count_entries(self) -> dict[str, tuple[int, int]]:
        """Return (number of cached triangulations, bytes) by triangulator."""
        query = "SELECT triangulator, COUNT(*), SUM(LENGTH(value)) FROM model GROUP BY triangulator"
        rows: list[tuple[str, int, int]] = self._run_or_default(
            lambda: self._database.execute(query).fetchall(), []
        )
        return {name: (count, size) for name, count, size in sorted(rows)}

    def _read(self, keys: Sequence[bytes]) -> dict[bytes, TimedTriangles]:
        entries: dict[bytes, TimedTriangles] = {}
        for batch in (keys[start : start + _BATCH] for start in range(0, len(keys), _BATCH)):
            marks = ",".join("?" * len(batch))
            query = f"SELECT key, value FROM model WHERE key IN ({marks})"
            for key, value in self._database.execute(query, batch):
                model = _unpack_entry(key, value)
                if model is None:
                    self._warn(f"model database {self.path}: damaged entry; computing it again")
                else:
                    entries[key] = model
        return entries

    def _delete_all(self) -> int:
        with self._database:
            count = self._database.execute("DELETE FROM model").rowcount
        self._database.execute("VACUUM")
        return count

    def _run_or_default(self, action: Callable[[], _Result], default: _Result) -> _Result:
        try:
            return action()
        except sqlite3.OperationalError as error:
            # locked for too long, or the disk is full: continue without the database
            self._warn(f"model database {self.path}: not used ({error})")
        except sqlite3.DatabaseError as error:
            self._database.close()
            self._database = self._open(error)
        return default

    def _open(self, damage: sqlite3.DatabaseError | None = None) -> sqlite3.Connection:
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)
        descriptor = os.open(self._get_sibling(".lock"), flags | system.BINARY, 0o644)
        with os.fdopen(descriptor, "r+b") as stream:
            # one process at a time, as SQLite does not wait while another enables the log
            system.lock_file(stream.fileno())
            if not os.fstat(descriptor).st_size:
                os.write(descriptor, LOCK_MARK)
            # After damage, another process may have created a new file already.
            if damage is None or not self.path.exists() or self.path.stat().st_ino != self._inode:
                try:
                    return self._connect()
                except sqlite3.OperationalError:
                    raise
                except sqlite3.DatabaseError as error:
                    damage = error
            for suffix in ("", "-wal", "-shm"):
                self._get_sibling(suffix).unlink(missing_ok=True)
            self._warn(f"model database {self.path}: damaged ({damage}); replaced by a new one")
            return self._connect()

    def _get_sibling(self, suffix: str) -> Path:
        return self.path.with_name(self.path.name + suffix)

    def _refuse_foreign(self) -> None:
        """Raise StorageError for files of other programs, and files that other users may change."""
        for suffix in ("", "-wal", "-shm", "-journal", ".lock"):
            file = self._get_sibling(suffix)
            if file.is_symlink() or (file.exists() and not file.is_file()):
                self._refuse(file, "not a regular file")
            if file.exists() and not is_trusted(file.stat()):
                self._refuse(file, "another user owns or may write to the file")
        if not is_trusted(self.path.parent.stat()):
            self._refuse(self.path.parent, "another user owns or may write to the folder")
        lock = self._get_sibling(".lock")
        mark = lock.read_bytes()[: len(LOCK_MARK) + 1] if lock.exists() else b""
        if mark not in (b"", LOCK_MARK):
            self._refuse(lock, "not a lock of raster-harness")
        header = b""
        if self.path.exists():
            with self.path.open("rb") as stream:
                header = stream.read(100)
        if header.startswith(b"SQLite format 3\0"):
            (application,) = struct.unpack(">I", header[68:72].ljust(4, b"\0"))
            is_own = application == APPLICATION_ID or (application == 0 and self._is_unmarked())
        else:  # with the program's lock file, it is a damaged model database
            is_own = not header or mark == LOCK_MARK
        if not is_own:
            self._refuse(self.path, "not a model database of raster-harness")

    def _is_unmarked(self) -> bool:
        """Return whether the database is empty, or of a version without application_id."""
        database = sqlite3.connect(f"{self.path.absolute().as_uri()}?mode=ro", uri=True)
        try:
            tables = database.execute("SELECT name, sql FROM sqlite_master").fetchall()
        except sqlite3.DatabaseError:
            return False
        finally:
            database.close()
        return all(name == "model" and sql == TABLE for name, sql in tables)

    def _refuse(self, file: Path, problem: str) -> NoReturn:
        raise StorageError(
            f"{file}: {problem}; set RASTER_HARNESS_CACHE to a new file, or give --no-cache"
        )

    def _connect(self) -> sqlite3.Connection:
        """Connect; raise sqlite3.DatabaseError if the start of the file is damaged."""
        database = sqlite3.connect(self.path, timeout=_WAIT_S)
        try:
            # before journal_mode=WAL, so that the file itself has the number, not only its log
            database.execute(f"PRAGMA application_id={APPLICATION_ID}")
            database.execute("PRAGMA journal_mode=WAL")
            # a crash may lose the last entries, but not the file
            database.execute("PRAGMA synchronous=NORMAL")
            (version,) = database.execute("PRAGMA user_version").fetchone()
            if version not in (0, SCHEMA):
                raise sqlite3.DatabaseError(f"schema {version} instead of {SCHEMA}")
            with database:
                database.execute(TABLE.replace("TABLE", "TABLE IF NOT EXISTS"))
                database.execute(f"PRAGMA user_version={SCHEMA}")
        except BaseException:
            database.close()
            raise
        self._inode = self.path.stat().st_ino
        return database


def make_key(
    triangulator: str,
    parameters: dict[str, Any],
    coords: NDArray[np.float64],
    ring_offsets: ArrayLike,
) -> bytes:
    """Return a hash of polygon (rings as of `PolygonArray.rings_of`), triangulator and version.

    Triangles are a function of these on any processor: the compiled code does not reorder sums, and
    limits of proofs are numbers of constraints instead of times.
    """
    facts = [ENTRY_FORMAT, triangulator, sorted(parameters.items()), get_triangulators_version()]
    digest = hashlib.blake2b(json.dumps(facts).encode(), digest_size=20)
    digest.update(np.asarray(ring_offsets, dtype="<i8")[1:].tobytes())
    digest.update(np.ascontiguousarray(coords, dtype="<f8").tobytes())
    return digest.digest()


@cache
def get_triangulators_version() -> str:
    """Return a hash of the triangulators' source and of the versions of their libraries."""
    # Not of NumPy: its arithmetic and random numbers are the same in all supported versions.
    code_hash = hash_sources(Path(triangulators.__file__).parent)
    digest = hashlib.blake2b(code_hash.encode(), digest_size=12)
    for name in ("shapely", "mapbox-earcut", "manifold3d", "highspy", "PyOpenGL"):
        version = get_version(name)
        digest.update((f"{name} {version}" if version else f"no {name}").encode())
    return digest.hexdigest()


_FACTS = struct.Struct("<dd8s")  # seconds, gap and processor of an entry


def _compute_checksum(key: bytes, data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=8, key=key).digest()


def _pack_entry(key: bytes, model: TimedTriangles) -> bytes:
    """Return the bytes of an entry: checksum, triangles of 12 bytes, and `_FACTS`."""
    data = np.ascontiguousarray(model.triangles, dtype="<i4").tobytes()
    data += _FACTS.pack(
        model.seconds, math.nan if model.gap is None else model.gap, model.processor
    )
    return _compute_checksum(key, data) + data


def _unpack_entry(key: bytes, value: Any) -> TimedTriangles | None:
    if not isinstance(value, bytes) or len(value) < 32 or len(value) % 12 != 8:
        return None
    data = value[8:]
    if _compute_checksum(key, data) != value[:8]:
        return None
    triangles = np.frombuffer(data[: -_FACTS.size], "<i4").reshape(-1, 3).astype(np.int32)
    seconds, gap, processor_hash = _FACTS.unpack(data[-_FACTS.size :])
    return TimedTriangles(triangles, seconds, None if math.isnan(gap) else gap, processor_hash)


# Minimum computing time of cached triangulations. Measured on city, Helsinki, counties and
# stress, in microseconds per polygon: reading 26 to 70 (and 4 to 35 once for writing); computing
# the optimum of a footprint 120 to 280, with holes 1,200; computing a county 190 (ear clipping),
# 630 (Delaunay), 740 (optimum), 3,700 (random).
MIN_CACHED_S = 0.5e-3


class CacheLookup:
    """The model database for one triangulator; a context manager.

    If the database is unusable, no entry is read or stored; `notes` has the reason and warnings.
    """

    def __init__(self, path: Path | None, name: str, parameters: Mapping[str, Any]) -> None:
        self.notes: list[str] = []
        self._name = name
        self._parameters = dict(parameters)
        model = str(describe_processor()["name"]).encode()
        self._processor = hashlib.blake2b(model, digest_size=8).digest()
        self._database: ModelDatabase | None = None
        self._keys: list[bytes] = []
        if path is not None:
            try:
                self._database = ModelDatabase(path, self.notes.append)
            except StorageError as error:
                self.notes.append(f"{error}; continuing without the cache")

    def __enter__(self) -> "CacheLookup":
        return self

    def __exit__(self, *_: object) -> None:
        if self._database is not None:
            self._database.close()

    def find(self, polygons: PolygonArray) -> list[TimedTriangles | None]:
        """Return the cached triangles of each polygon, or None."""
        if self._database is None:
            return [None] * len(polygons)
        self._keys = [
            make_key(self._name, self._parameters, *polygons.rings_of(index))
            for index in range(len(polygons))
        ]
        entries = self._database.find(self._keys)
        foreign = sum(entry.processor != self._processor for entry in entries.values())
        if foreign:
            self.notes.append(
                f"model database: {foreign} triangulations by {self._name} were timed on another "
                "processor; for times of this processor: --no-cache"
            )
        return [entries.get(key) for key in self._keys]

    def store(
        self, number: int, triangles: NDArray[np.int32], seconds: float, gap: float | None = None
    ) -> None:
        """Store triangles of polygon `number` of `find`, if they took `MIN_CACHED_S` or more."""
        if self._database is not None and seconds >= MIN_CACHED_S:
            entry = TimedTriangles(triangles, seconds, gap, self._processor)
            self._database.store(self._name, self._keys[number], entry)
