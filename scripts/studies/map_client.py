"""A tile as the harness draws it, beside the same tile drawn by MapLibre GL JS in Chromium.

    PYTHONPATH=. python scripts/studies/map_client.py --tile 15/18654/9484 --out tile.png
    PYTHONPATH=. python scripts/studies/map_client.py --table client.csv

Both draw every polygon of a tile of helsinki-tiles in black, at 512 px, without smooth edges.
Prints how many pixels differ, and why; in the picture these are red. The table is of all tiles.
MapLibre and esbuild are those of examples/.
"""

from __future__ import annotations

import argparse
import base64
import csv
import io
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
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
from scenes.tiles.vector_tile import decode
from tests.chromium import WEBGPU_FLAGS, Chromium
from tests.paths import ROOT
from tests.ports.languages import node

BUILD = Path(__file__).parent / "map_client" / "build.mjs"
MODULES = ROOT / "examples" / "node_modules"
GAP = 16

NEAR_PX = 1 / 16
"""A step of SwiftShader's grid."""


def main() -> None:
    """Draw both, compare, and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tile")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    rows = []
    for name in [given.tile] if given.tile else _names():
        scene = alone(name)
        ours, theirs = by_the_harness(scene), by_maplibre(name)
        different = ours != theirs
        causes = reasons(name, scene, different)
        told = ", ".join(f"{count} {cause}" for cause, count in causes.items())
        sys.stdout.write(f"{name}: {different.sum()} of {ours.size} pixels differ: {told}\n")
        sys.stdout.flush()
        rows.append({"tile": name, "pixels": ours.size, "differ": int(different.sum()), **causes})
    if given.table:
        with given.table.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    if given.out:
        side = len(ours)
        both = np.full((side, 2 * side + GAP, 3), 255, np.uint8)
        both[:, :side][ours] = both[:, side + GAP :][theirs] = 0
        both[:, side + GAP :][different] = [255, 0, 0]
        Image.fromarray(both).save(given.out, optimize=True)


def _names() -> list[str]:
    archive = PMTiles(FILE)
    return [str(place) for zoom in archive.zooms for place in archive.names(zoom)]


def reasons(name: str, scene: Scene, different: NDArray[np.bool_]) -> dict[str, int]:
    """Count pixels by why they differ.

    left_out : in the reach of a polygon that is not valid, which the harness leaves out and names,
        and the client draws as it comes
    clipped : not that, and an edge that leaves the canvas passes the pixel's centre closer than
        `NEAR_PX`: the client's viewport ends with the tile, so its rasteriser cuts the edge there,
        and rounds the new end to its own grid; the harness' viewport holds the whole edge
    other : neither
    """
    assert scene.tiling is not None
    side = scene.tiling.pixels
    archive = PMTiles(FILE)
    place = Place(*map(int, name.split("/")))
    archive.names(place.zoom)
    raw = np.concatenate([layer.polygons for layer in decode(archive.read(place) or b"")])
    to_px = shapely.transform(raw, lambda xy: (xy * [1, -1] + [0, 4096]) * side / 4096)
    bad = to_px[~shapely.is_valid(to_px)]
    # of all rings: one that is taken for a hole may lie outside
    reach = np.array([shapely.MultiPoint(shapely.get_coordinates(p)).convex_hull for p in bad])
    lines = _segments(scene)
    inside = shapely.covers(shapely.box(0, 0, side, side), lines)
    leaving = shapely.STRtree(lines[~inside])
    counts = dict.fromkeys(("left_out", "clipped", "other"), 0)
    for row, column in np.argwhere(different):
        centre = shapely.Point(column + 0.5, side - row - 0.5)
        if shapely.dwithin(reach, centre, 1.0).any():
            counts["left_out"] += 1
        elif len(leaving.query(centre, "dwithin", NEAR_PX)):
            counts["clipped"] += 1
        else:
            counts["other"] += 1
    return counts


def _segments(scene: Scene) -> NDArray[np.object_]:
    """All edges of the scene's polygons, one by one."""
    rings = shapely.get_rings(np.array(scene.polygons, dtype=object))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    together = ring[1:] == ring[:-1]
    found: NDArray[np.object_] = shapely.linestrings(
        np.stack([points[:-1][together], points[1:][together]], axis=1)
    )
    return found


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
