"""A tile as the harness draws it, beside the same tile drawn by MapLibre GL JS in Chromium.

    PYTHONPATH=. python scripts/studies/map_client.py --tile 15/18654/9484 --out tile.png

Both draw every polygon of a tile of helsinki-tiles in black, at 512 px, without smooth edges.
Prints how many pixels differ; in the picture these are red. MapLibre and esbuild are those of
examples/.
"""

from __future__ import annotations

import argparse
import base64
import io
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from harness.frame import frame_of, view_of
from harness.rasterisers import Options
from harness.rasterisers.reference import Reference
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse
from scenes import Scene, load
from scenes.real.helsinki_tiles import FILE
from scenes.tiles.archive import Place
from scenes.tiles.pmtiles import PMTiles
from tests.chromium import WEBGPU_FLAGS, Chromium
from tests.paths import ROOT
from tests.ports.languages import node

BUILD = Path(__file__).parent / "map_client" / "build.mjs"
MODULES = ROOT / "examples" / "node_modules"
GAP = 16


def main() -> None:
    """Draw both, compare, and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tile", required=True)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    ours, theirs = by_the_harness(alone(given.tile)), by_maplibre(given.tile)
    different = ours != theirs
    sys.stdout.write(f"{given.tile}: {different.sum()} of {ours.size} pixels differ\n")
    if given.out:
        side = len(ours)
        both = np.full((side, 2 * side + GAP, 3), 255, np.uint8)
        both[:, :side][ours] = both[:, side + GAP :][theirs] = 0
        both[:, side + GAP :][different] = [255, 0, 0]
        Image.fromarray(both).save(given.out, optimize=True)


def alone(name: str) -> Scene:
    """One tile of helsinki-tiles."""
    scene = load(f"helsinki-tiles:zoom={name.partition('/')[0]},tiles=999")
    assert scene.tiling is not None
    number = scene.tiling.names.index(name)
    first, last = scene.tiling.first[number : number + 2]
    tiling = replace(scene.tiling, names=(name,), first=np.array([0, last - first]))
    return replace(scene, polygons=scene.polygons[first:last], tiling=tiling)


def by_the_harness(scene: Scene) -> NDArray[np.bool_]:
    """Which pixels of the tile are drawn, top row first."""
    frame = frame_of(scene, view_of(scene))
    triangles = frame.join(triangulate_polygons(parse("delaunay"), frame.polygons).parts)
    picture = Reference().image(frame, triangles, Options())
    assert frame.scissor is not None
    left, bottom, width, height = frame.scissor
    top = frame.height - bottom - height
    drawn: NDArray[np.bool_] = picture[top : top + height, left : left + width, 3] > 0
    return drawn


def by_maplibre(name: str) -> NDArray[np.bool_]:
    """The same, drawn by MapLibre in Chromium on SwiftShader."""
    place = Place(*map(int, name.split("/")))
    archive = PMTiles(FILE)
    archive.names(place.zoom)
    program = node()
    if program is None or not MODULES.exists():
        raise SystemExit("there is no Node.js, or no examples/node_modules: make setup-test")
    with tempfile.TemporaryDirectory() as folder:
        tile, page = Path(folder, "tile.pbf"), Path(folder, "page.html")
        tile.write_bytes(archive.read(place) or b"")
        subprocess.run([program, BUILD, name, "area,building", tile, page], check=True)
        browser = Chromium(WEBGPU_FLAGS)
        try:
            browser.open(page)
            picture = browser.evaluate("document.documentElement.dataset.picture")
        finally:
            browser.close()
    content = base64.b64decode(picture.partition(",")[2])
    pixels = np.asarray(Image.open(io.BytesIO(content)).convert("RGBA"))
    drawn: NDArray[np.bool_] = pixels[..., 3] > 127
    return drawn


if __name__ == "__main__":
    main()
