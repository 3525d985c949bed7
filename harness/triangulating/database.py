"""The model database: triangulations kept by content, so that a second run reads them.

One SQLite file serves several processes at once (write-ahead log). Each entry carries a checksum,
what is read is verified to be a triangulation of its polygon, and a file that SQLite cannot read is
deleted and begun anew. That what is read is the optimum is believed, for only optima are kept
as such: whoever may write the file can make others believe otherwise. `--no-cache` reads nothing.
"""

import hashlib
import importlib.metadata
import json
import logging
import sqlite3
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import cache as once
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

import triangulators
from harness.errors import UsageError
from harness.machine import system
from harness.machine.environment import processor, source_hash
from triangulators.polygon_arrays import PolygonArray

SCHEMA = 1

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

    Raises UsageError if the file's folder cannot be written. Damage is never an error: `say` is
    called with a line that tells what was lost (by default it is logged as a warning).
    """

    def __init__(self, path: Path | None = None, say: Callable[[str], None] = _LOG.warning) -> None:
        self.path = path or system.database_path()
        self._say = say
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._database = self._opened()
        except (OSError, sqlite3.OperationalError) as error:
            raise UsageError(
                f"the model database {self.path} cannot be opened: {error}; "
                "set RASTER_HARNESS_CACHE"
            ) from error
        if system.others_may_write(self.path):
            say(
                f"others may write the model database {self.path}, whose optima are believed: "
                f"chmod o-w {self.path}, or give --no-cache"
            )

    def __enter__(self) -> "ModelDatabase":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; it must not be used afterwards."""
        self._database.close()

    def find(self, keys: Sequence[bytes]) -> dict[bytes, Timed]:
        """Return what is kept under those keys that are there and whole."""
        nothing: dict[bytes, Timed] = {}
        return self._safely(lambda: self._read(keys), nothing)

    def keep(self, triangulator: str, key: bytes, model: Timed) -> None:
        """Keep a triangulation; what is there already under the same key is replaced."""

        def write() -> None:
            with self._database:
                row = (key, triangulator, _sealed(key, model))
                self._database.execute("INSERT OR REPLACE INTO model VALUES (?, ?, ?)", row)

        self._safely(write, None)

    def clear(self) -> int:
        """Forget everything; returns how many triangulations there were."""
        return self._safely(self._emptied, 0)

    def info(self) -> dict[str, tuple[int, int]]:
        """Return for each triangulator how many of its triangulations are kept, and their bytes."""
        query = "SELECT triangulator, COUNT(*), SUM(LENGTH(value)) FROM model GROUP BY triangulator"
        nothing: list[tuple[str, int, int]] = []
        rows = self._safely(lambda: self._database.execute(query).fetchall(), nothing)
        return {name: (count, size) for name, count, size in sorted(rows)}

    def _read(self, keys: Sequence[bytes]) -> dict[bytes, Timed]:
        found: dict[bytes, Timed] = {}
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
                    found[key] = model
        return found

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
        with self.path.with_name(self.path.name + ".lock").open("wb") as stream:
            # one process at a time: SQLite does not wait while another turns the log on
            system.lock(stream.fileno())
            if damage is None or not self._is_the_same():  # else another has begun it anew already
                try:
                    return self._connected()
                except sqlite3.OperationalError:
                    raise
                except sqlite3.DatabaseError as error:
                    damage = error
            for suffix in ("", "-wal", "-shm"):
                self.path.with_name(self.path.name + suffix).unlink(missing_ok=True)
            self._say(f"model database {self.path} was damaged ({damage}) and is begun anew")
            return self._connected()

    def _is_the_same(self) -> bool:
        """Whether the file at the path is the one that was opened."""
        return self.path.exists() and self.path.stat().st_ino == self._number

    def _connected(self) -> sqlite3.Connection:
        """Connect; raises sqlite3.DatabaseError for a file that is damaged at its beginning."""
        database = sqlite3.connect(self.path, timeout=_WAIT_S)
        try:
            database.execute("PRAGMA journal_mode=WAL")
            # a crash may lose the last entries, which are computed again, but not the file
            database.execute("PRAGMA synchronous=NORMAL")
            (version,) = database.execute("PRAGMA user_version").fetchone()
            if version not in (0, SCHEMA):
                raise sqlite3.DatabaseError(f"its schema is {version}, not {SCHEMA}")
            with database:
                database.execute(
                    "CREATE TABLE IF NOT EXISTS model "
                    "(key BLOB PRIMARY KEY, triangulator TEXT NOT NULL, value BLOB NOT NULL) "
                    "WITHOUT ROWID"
                )
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
    own = source_hash(Path(triangulators.__file__).parent)
    digest = hashlib.blake2b(own.encode(), digest_size=12)
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
"""Seconds of computing from which a triangulation is kept.

Measured on city, Helsinki, counties and stress, microseconds a polygon: finding one 26..70 (and
4..35 once for writing); computing one of a footprint 120..280, of a footprint with holes 1,200
(optimum), of a county 190 (ear clipping), 630 (Delaunay), 740 (optimum), 3,700 (random).
"""


class Lookup:
    """The model database for one triangulator; use as a context manager.

    Where the database cannot be used, nothing is found and nothing kept, and `notes` says why.

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
            except UsageError as error:
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
        found = self._database.find(self._keys)
        return [found.get(key) for key in self._keys]

    def keep(self, number: int, triangles: NDArray[np.int32], seconds: float) -> None:
        """Keep the triangles of a polygon of `find`, if computing them took long enough."""
        if self._database is not None and seconds >= KEEP_S:
            self._database.keep(self._name, self._keys[number], Timed(triangles, seconds))
