"""Coastlines and straight borders: U.S. Census outlines from the package bokeh_sampledata."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

import pandas as pd
import shapely

from scenes.cleaning.clean import clean
from scenes.cleaning.projection import Projection
from scenes.scene import Scene, SceneError
from scenes.spec import install

_DATABASE = Path("_data", "geographic_boundaries.db")
_TABLES = {"county": "us_counties", "state": "us_states"}
_CENTRE = (-96.0, 38.0)  # of the contiguous states
_ELSEWHERE = ("AK", "HI", "AS", "GU", "MP", "PR", "VI")


def build(*, seed: int = 0, level: str = "county", states: str = "contiguous") -> Scene:  # noqa: ARG001
    """Counties (or states, by `level`), in metres on an equal-area map.

    `states` is "contiguous", "all", or postal abbreviations joined by "+" ("TX+NM"). Raises
    SceneError for another level, for states that are not there, and if bokeh_sampledata is not
    installed or has moved its data. The package itself is not imported.
    """
    if level not in _TABLES:
        raise SceneError(f"counties: there is no level {level!r}; give county or state")
    rows = [r for r in _rows(_TABLES[level]) if _wanted(str(r[0]), states)]
    if not rows:
        raise SceneError(f"counties: no outline of states={states!r}: give all, or TX+NM")
    tables = [json.loads(metadata) for _, metadata, _ in rows]
    outlines = shapely.from_wkb([geometry for _, _, geometry in rows])
    # TIGER/Line coordinates are those of NAD 83
    flat = Projection("EPSG:4269", _CENTRE).project(outlines)
    labels = [str(t.get("detailed_name", t.get("name", i))) for i, t in enumerate(tables)]
    cleaned = clean(flat, labels)
    return Scene(
        name="counties",
        polygons=list(cleaned.polygons),
        units="m",
        description=f"outlines of U.S. {level} areas, {states}",
        licence="public domain",
        credit="U.S. Census Bureau, TIGER/Line Shapefiles; from the package bokeh_sampledata",
        parameters={"level": level, "states": states},
        dropped=cleaned.dropped,
        repaired=cleaned.repaired,
        attributes=pd.DataFrame(tables).iloc[cleaned.source].reset_index(drop=True),
    )


def _wanted(state: str, states: str) -> bool:
    if states == "contiguous":
        return state not in _ELSEWHERE
    return states == "all" or state in states.upper().split("+")


def _rows(table: str) -> list[tuple[str, str, bytes]]:
    """State, metadata and geometry of each row, in the table's own order."""
    spec = find_spec("bokeh_sampledata")
    folders = (spec.submodule_search_locations or []) if spec else []
    for folder in folders:
        path = (Path(folder) / _DATABASE).resolve()
        if path.is_file():
            with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)) as database:
                query = f"SELECT state, metadata, geometry FROM {table} ORDER BY ordinal"
                return database.execute(query).fetchall()
    raise SceneError(
        f"scene counties finds no {_DATABASE} in the package bokeh_sampledata: "
        f"{install('counties')} (2026.1 or later)"
    )
