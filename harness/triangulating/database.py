"""The model database: triangulations cached by content, so that a second run reads them.

One SQLite file serves several processes at once (write-ahead log). Each entry carries a checksum,
and each triangulation is verified when it is read. A damaged database is deleted and made again; a
file that is not a database of this program is refused. Optimality is not verified again, so a file
that other users may write is refused, too. `--no-cache` reads nothing.
"""

import hashlib
import importlib.metadata
import json
import logging
import os
import sqlite3
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import cache as once
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

import triangulators
from harness.errors import StorageError
from harness.machine import system
from harness.machine.environment import processor, source_hash
from triangulators.compute.compiled_files import is_trusted, make_folder
from triangulators.polygon_arrays import PolygonArray

SCHEMA = 1

APPLICATION_ID = 0x52485443
"""SQLite's application_id of the files that are ours: "RHTC"."""

LOCK_MARK = b"raster-harness\n"
"""Content of the lock beside a database of ours."""

TABLE = (
    "CREATE TABLE model "
    "(key BLOB PRIMARY KEY, triangulator TEXT NOT NULL, value BLOB NOT NULL) WITHOUT ROWID"
)

_BATCH = 500  # SQLite takes at least 999 parameters
_WAIT_S = 30.0
_LOG = logging.getLogger(__name__)
_Result = TypeVar("_Result")


class Timed(NamedTuple):
    """The (m, 3) triangles of a polygon, and the seconds that computing them took."""

    triangles: NDArray[np.int32]
    seconds: float


class ModelDatabase:
    """Triangulations by key; see `key`. Use as a context manager, or call `close`.

    Raises StorageError if the file's folder cannot be written. Damage is never an error: `say` is
    called with a line that tells what was lost (by default it is logged as a warning).
    """

    def __init__(self, path: Path | None = None, say: Callable[[str], None] = _LOG.warning) -> None:
        self.path = path or system.database_path()
        self._say = say
        try:
            make_folder(self.path.parent)
            self._refuse_foreign()
            self._database = self._opened()
        except (OSError, sqlite3.OperationalError) as error:
            raise StorageError(
                f"the model database {self.path} cannot be opened: {error}; "
                "set RASTER_HARNESS_CACHE"
            ) from error

    def __enter__(self) -> "ModelDatabase":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; it must not be used afterwards."""
        self._database.close()

    def find(self, keys: Sequence[bytes]) -> dict[bytes, Timed]:
        """Return the intact entries of the keys."""
        nothing: dict[bytes, Timed] = {}
        return self._safely(lambda: self._read(keys), nothing)

    def keep(self, triangulator: str, key: bytes, model: Timed) -> None:
        """Store a triangulation; an entry with the same key is replaced."""

        def write() -> None:
            with self._database:
                row = (key, triangulator, _sealed(key, model))
                self._database.execute("INSERT OR REPLACE INTO model VALUES (?, ?, ?)", row)

        self._safely(write, None)

    def clear(self) -> int:
        """Delete all entries; return their number."""
        return self._safely(self._emptied, 0)

    def info(self) -> dict[str, tuple[int, int]]:
        """Return the number of cached triangulations and bytes of each triangulator."""
        query = "SELECT triangulator, COUNT(*), SUM(LENGTH(value)) FROM model GROUP BY triangulator"
        nothing: list[tuple[str, int, int]] = []
        rows = self._safely(lambda: self._database.execute(query).fetchall(), nothing)
        return {name: (count, size) for name, count, size in sorted(rows)}

    def _read(self, keys: Sequence[bytes]) -> dict[bytes, Timed]:
        entries: dict[bytes, Timed] = {}
        for batch in (keys[start : start + _BATCH] for start in range(0, len(keys), _BATCH)):
            marks = ",".join("?" * len(batch))
            query = f"SELECT key, value FROM model WHERE key IN ({marks})"
            for key, value in self._database.execute(query, batch):
                model = _unsealed(key, value)
                if model is None:
                    self._say(
                        f"model database {self.path}: an entry is damaged and is computed again"
                    )
                else:
                    entries[key] = model
        return entries

    def _emptied(self) -> int:
        with self._database:
            count = self._database.execute("DELETE FROM model").rowcount
        self._database.execute("VACUUM")
        return count

    def _safely(self, act: Callable[[], _Result], otherwise: _Result) -> _Result:
        """Do it; if the file turns out to be damaged, begin a new one."""
        try:
            return act()
        except sqlite3.OperationalError as error:
            # locked for too long, or the disk is full: the file is sound, go on without it
            self._say(f"model database {self.path} was not used: {error}")
        except sqlite3.DatabaseError as error:
            self._database.close()
            self._database = self._opened(error)
        return otherwise

    def _opened(self, damage: sqlite3.DatabaseError | None = None) -> sqlite3.Connection:
        """Open the file; a damaged one is deleted first, and what it held is computed again."""
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)
        descriptor = os.open(self._beside(".lock"), flags | system.BINARY, 0o644)
        with os.fdopen(descriptor, "r+b") as stream:
            # one process at a time: SQLite does not wait while another turns the log on
            system.lock(stream.fileno())
            if not os.fstat(descriptor).st_size:
                os.write(descriptor, LOCK_MARK)
            if damage is None or not self._is_the_same():  # else another has begun it anew already
                try:
                    return self._connected()
                except sqlite3.OperationalError:
                    raise
                except sqlite3.DatabaseError as error:
                    damage = error
            for suffix in ("", "-wal", "-shm"):
                self._beside(suffix).unlink(missing_ok=True)
            self._say(f"model database {self.path} was damaged ({damage}) and is begun anew")
            return self._connected()

    def _beside(self, suffix: str) -> Path:
        return self.path.with_name(self.path.name + suffix)

    def _refuse_foreign(self) -> None:
        """Raise StorageError for foreign files, or files that other users own or may write."""
        for suffix in ("", "-wal", "-shm", "-journal", ".lock"):
            file = self._beside(suffix)
            if file.is_symlink() or (file.exists() and not file.is_file()):
                self._refuse(file, "not a regular file")
            if file.exists() and not is_trusted(file.stat()):
                self._refuse(file, "another user owns or may write it")
        if not is_trusted(self.path.parent.stat()):
            self._refuse(self.path.parent, "another user owns or may write the folder")
        lock = self._beside(".lock")
        mark = lock.read_bytes()[: len(LOCK_MARK) + 1] if lock.exists() else b""
        if mark not in (b"", LOCK_MARK):
            self._refuse(lock, "not a lock of raster-harness")
        header = b""
        if self.path.exists():
            with self.path.open("rb") as stream:
                header = stream.read(100)
        if header.startswith(b"SQLite format 3\0"):
            (application,) = struct.unpack(">I", header[68:72].ljust(4, b"\0"))
            ours = application == APPLICATION_ID or (application == 0 and self._is_unmarked())
        else:  # where the lock is ours, the database was, too, and is damaged
            ours = not header or mark == LOCK_MARK
        if not ours:
            self._refuse(self.path, "not a model database of raster-harness")

    def _is_unmarked(self) -> bool:
        """Whether the file is a database of a version that set no application_id, or empty."""
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

    def _is_the_same(self) -> bool:
        """Whether the file at the path is the one that was opened."""
        return self.path.exists() and self.path.stat().st_ino == self._number

    def _connected(self) -> sqlite3.Connection:
        """Connect; raises sqlite3.DatabaseError for a file that is damaged at its beginning."""
        database = sqlite3.connect(self.path, timeout=_WAIT_S)
        try:
            # first, so that it is in the file itself and not only in the log
            database.execute(f"PRAGMA application_id={APPLICATION_ID}")
            database.execute("PRAGMA journal_mode=WAL")
            # a crash may lose the last entries, which are computed again, but not the file
            database.execute("PRAGMA synchronous=NORMAL")
            (version,) = database.execute("PRAGMA user_version").fetchone()
            if version not in (0, SCHEMA):
                raise sqlite3.DatabaseError(f"its schema is {version}, not {SCHEMA}")
            with database:
                database.execute(TABLE.replace("TABLE", "TABLE IF NOT EXISTS"))
                database.execute(f"PRAGMA user_version={SCHEMA}")
        except BaseException:
            database.close()
            raise
        self._number = self.path.stat().st_ino
        return database


def key(
    triangulator: str,
    parameters: dict[str, Any],
    coords: NDArray[np.float64],
    ring_offsets: ArrayLike,
) -> bytes:
    """The key of a triangulation: a hash of the polygon, the triangulator and all its versions.

    coords (n, 2), ring_offsets (h + 2,): its rings, as `PolygonArray.rings_of` returns them
    """
    about = [SCHEMA, triangulator, sorted(parameters.items()), triangulators_version()]
    digest = hashlib.blake2b(json.dumps(about).encode(), digest_size=20)
    digest.update(np.asarray(ring_offsets, dtype="<i8")[1:].tobytes())
    digest.update(np.ascontiguousarray(coords, dtype="<f8").tobytes())
    return digest.digest()


@once
def triangulators_version() -> str:
    """A hash of the triangulators' source and the versions of the libraries they call."""
    code_hash = source_hash(Path(triangulators.__file__).parent)
    digest = hashlib.blake2b(code_hash.encode(), digest_size=12)
    for name in ("numpy", "shapely", "mapbox-earcut", "manifold3d", "PyOpenGL"):
        try:
            digest.update(f"{name} {importlib.metadata.version(name)}".encode())
        except importlib.metadata.PackageNotFoundError:
            digest.update(f"no {name}".encode())
    return digest.hexdigest()


def _checksum(key: bytes, data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=8, key=key).digest()


def _sealed(key: bytes, model: Timed) -> bytes:
    """Checksum, triangles of 12 bytes each and 8 bytes of seconds."""
    data = np.ascontiguousarray(model.triangles, dtype="<i4").tobytes()
    data += struct.pack("<d", model.seconds)
    return _checksum(key, data) + data


def _unsealed(key: bytes, value: Any) -> Timed | None:
    if not isinstance(value, bytes) or len(value) < 16 or len(value) % 12 != 4:
        return None
    data = value[8:]
    if _checksum(key, data) != value[:8]:
        return None
    triangles = np.frombuffer(data[:-8], "<i4").reshape(-1, 3).astype(np.int32)
    return Timed(triangles, *struct.unpack("<d", data[-8:]))


KEEP_S = 0.5e-3
"""Minimum computing time in seconds of cached triangulations.

Measured on city, Helsinki, counties and stress, microseconds a polygon: finding one 26..70 (and
4..35 once for writing); computing one of a footprint 120..280, of a footprint with holes 1,200
(optimum), of a county 190 (ear clipping), 630 (Delaunay), 740 (optimum), 3,700 (random).
"""


class Lookup:
    """The model database for one triangulator; use as a context manager.

    If the database cannot be used, nothing is read or stored, and `notes` has the reason.

    path : the database, or None for none
    name, parameters : what triangulations depend on besides the polygon
    notes : lines for the user: what was damaged, or why it goes without
    """

    def __init__(self, path: Path | None, name: str, parameters: Mapping[str, Any]) -> None:
        self.notes: list[str] = []
        self._name = name
        # A time of another machine would be a lie about this one.
        self._parameters = {**parameters, "cpu": processor()["name"]}
        self._database: ModelDatabase | None = None
        self._keys: list[bytes] = []
        if path is not None:
            try:
                self._database = ModelDatabase(path, self.notes.append)
            except StorageError as error:
                self.notes.append(f"{error}; this run does without")

    def __enter__(self) -> "Lookup":
        return self

    def __exit__(self, *_: object) -> None:
        if self._database is not None:
            self._database.close()

    def find(self, polygons: PolygonArray) -> list[Timed | None]:
        """Return the cached triangles of each polygon, or None."""
        if self._database is None:
            return [None] * len(polygons)
        self._keys = [
            key(self._name, self._parameters, *polygons.rings_of(index))
            for index in range(len(polygons))
        ]
        entries = self._database.find(self._keys)
        return [entries.get(key) for key in self._keys]

    def keep(self, number: int, triangles: NDArray[np.int32], seconds: float) -> None:
        """Keep the triangles of a polygon of `find`, if computing them took long enough."""
        if self._database is not None and seconds >= KEEP_S:
            self._database.keep(self._name, self._keys[number], Timed(triangles, seconds))
