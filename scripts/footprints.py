"""Writes a data set of generated footprints as GeoParquet files, for tests of scale.

    PYTHONPATH=. .venv/bin/python scripts/footprints.py FOLDER --footprints 1000000

Each file is a generated city of 100,000 footprints, in metres, in row groups of 25,000; `id`
numbers them through. After ten cities they come again, further east.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import shapely
from pyarrow import parquet

from harness.stored import atomic
from scenes import load
from scenes.cleaning.projection import system

CITY = 100_000
ROW_GROUP = 25_000
CITIES = 10
APART_M = 40_000.0
CRS = "EPSG:3857"


def main() -> None:
    """Read the command line and write the files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--footprints", type=int, default=1_000_000)
    chosen = parser.parse_args()
    write(chosen.folder, chosen.footprints)


def write(folder: Path, footprints: int) -> None:
    """Write the files that are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    known: dict[int, np.ndarray] = {}
    for number, first in enumerate(range(0, footprints, CITY)):
        count = min(CITY, footprints - first)
        file = folder / f"city-{number:04}.parquet"
        if file.exists():
            continue
        seed = number % CITIES
        if seed not in known:
            scene = load(f"city:buildings={CITY}", seed=seed)
            known[seed] = np.array(scene.polygons, dtype=object)
        shift = np.array([number * APART_M, seed * APART_M])
        polygons = shapely.transform(known[seed][:count], lambda xy, by=shift: xy + by)
        _write_file(file, polygons, first, seed)


def _write_file(file: Path, polygons: np.ndarray, first: int, seed: int) -> None:
    heights = np.random.default_rng(seed).gamma(4.0, 3.0, len(polygons)).round(1)
    west, south, east, north = shapely.bounds(polygons).T
    box = {"xmin": west, "ymin": south, "xmax": east, "ymax": north}
    table = pa.table(
        {
            "id": np.arange(first, first + len(polygons), dtype=np.int64),
            "height": heights,
            "bbox": pa.StructArray.from_arrays([pa.array(v) for v in box.values()], list(box)),
            "geometry": pa.array(shapely.to_wkb(polygons), pa.binary()),
        }
    )
    known = system(CRS)
    assert known is not None
    column = {
        "encoding": "WKB",
        "geometry_types": ["Polygon"],
        "crs": known.to_json_dict(),
        "covering": {"bbox": {name: ["bbox", name] for name in box}},
    }
    geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
    made = file.with_suffix(".writing")
    schema = table.schema.with_metadata({"geo": json.dumps(geo)})
    parquet.write_table(table.cast(schema), made, row_group_size=ROW_GROUP)
    atomic.move(made, file)


if __name__ == "__main__":
    main()
