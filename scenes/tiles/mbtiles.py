"""MBTiles: map tiles in an SQLite database."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from scenes.readers import cut_off
from scenes.scene import SceneError
from scenes.tiles.archive import Archive, Place, Run, first_of, zoom_of


class MBTiles(Archive):
    """An SQLite database of tiles; its rows count from the south."""

    def __init__(self, path: Path) -> None:
        cut_off.check(path)
        self._uri = f"{path.resolve().as_uri()}?mode=ro"
        log = Path(f"{path.resolve()}-wal")
        if not (log.is_file() and log.stat().st_size):  # what was written last is in it
            self._uri += "&immutable=1"
        facts = dict(self._ask("SELECT name, value FROM metadata"))
        kind = facts.get("format", "pbf")
        if kind != "pbf":
            raise SceneError(f"{path} holds tiles of format {kind}: give one of vector tiles")
        self.attribution = str(facts.get("attribution") or "")
        rows = self._ask(
            "SELECT DISTINCT zoom_level FROM tiles WHERE zoom_level BETWEEN 0 AND 30 ORDER BY 1"
        )
        self.zooms = tuple(int(zoom) for (zoom,) in rows)

    def _ask(self, query: str, values: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        with closing(sqlite3.connect(self._uri, uri=True)) as database:
            return database.execute(query, values).fetchall()

    def names(self, zoom: int | None) -> Sequence[Any]:
        """Column by column."""
        rows = self._ask(
            "SELECT tile_column, tile_row FROM tiles WHERE zoom_level = ? ORDER BY 1, 2 DESC",
            (zoom,),
        )
        return [Place(zoom, x, 2**zoom - 1 - y) for x, y in rows] if zoom is not None else []

    def runs(self, zoom: int | None) -> Iterator[Run]:
        """Numbered column by column; what lies beyond the map is no tile."""
        assert zoom is not None
        side = 2**zoom
        query = (
            "SELECT tile_column, tile_row, length(tile_data) FROM tiles WHERE zoom_level = ? "
            "AND tile_column BETWEEN 0 AND ? AND tile_row BETWEEN 0 AND ? ORDER BY 1, 2 DESC"
        )
        with closing(sqlite3.connect(self._uri, uri=True)) as database:
            for x, y, size in database.execute(query, (zoom, side - 1, side - 1)):
                yield Run(first_of(zoom) + x * side + side - 1 - y, 1, size or 0)

    def between(self, first: int, last: int) -> Iterator[tuple[Any, int]]:
        """One by one."""
        zoom = zoom_of(first)
        side, begin = 2**zoom, first_of(zoom)
        query = (
            "SELECT tile_column, tile_row FROM tiles WHERE zoom_level = ? "
            "AND tile_column BETWEEN ? AND ? AND tile_row BETWEEN 0 AND ? ORDER BY 1, 2 DESC"
        )
        columns = (first - begin) // side, (last - 1 - begin) // side
        for x, y in self._ask(query, (zoom, *columns, side - 1)):
            place = Place(zoom, x, side - 1 - y)
            if first <= begin + x * side + place.y < last:
                yield place, 1

    def packed(self, name: Any) -> bytes | None:
        """What the database has for a place; ValueError if that is NULL."""
        place = (name.zoom, name.x, 2**name.zoom - 1 - name.y)
        query = "SELECT tile_data FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?"
        found = self._ask(query, place)
        if found == [(None,)]:
            raise ValueError("its tile_data is NULL")
        return found[0][0] if found else None
