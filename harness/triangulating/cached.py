"""What earlier runs computed: triangulations from the model database, and the time each took."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from harness.errors import UsageError
from harness.machine.environment import processor
from harness.triangulating import database
from triangulators.polygon import rings_of

KEEP_S = 0.5e-3
"""Seconds of computing from which a triangulation is kept.

Measured on city, Helsinki, counties and stress, microseconds a polygon: finding one 26..70 (and
4..35 once for writing); computing one of a footprint 120..280, of a footprint with holes 1,200
(optimum), of a county 190 (ear clipping), 630 (Delaunay), 740 (optimum), 3,700 (random).
"""

WRITE_S = 2.0
"""Seconds of computing after which what was computed is written, so that a kill loses no more."""


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
        self._database: database.ModelDatabase | None = None
        self._keys: list[bytes] = []
        self._fresh: list[tuple[bytes, database.Timed]] = []
        if path is not None:
            try:
                self._database = database.ModelDatabase(path, self.notes.append)
            except UsageError as error:
                self.notes.append(f"{error}; this run does without")

    def __enter__(self) -> Lookup:
        return self

    def __exit__(self, *_: object) -> None:
        if self._database is not None:
            self._write()
            self._database.close()

    def find(self, polygons: Sequence[Polygon]) -> list[database.Timed | None]:
        """Return for each polygon what is known of it."""
        if self._database is None:
            return [None] * len(polygons)
        self._keys = []
        for polygon in polygons:
            points, ends = rings_of(polygon)
            self._keys.append(database.key(self._name, self._parameters, points, ends.tolist()))
        found = self._database.get_timed(self._keys)
        return [found.get(key) for key in self._keys]

    def keep(self, number: int, triangles: NDArray[np.int32], seconds: float) -> None:
        """Keep the triangles of a polygon of `find`, if computing them took long enough."""
        if self._database is None or seconds < KEEP_S:
            return
        self._fresh.append((self._keys[number], database.Timed(triangles, seconds)))
        if sum(timed.seconds for _, timed in self._fresh) > WRITE_S:
            self._write()

    def _write(self) -> None:
        if self._database is not None and self._fresh:
            self._database.put_timed(self._name, self._fresh)
            self._fresh = []
