import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import shapely
from pyarrow import parquet

from harness.scaling.executors import DaskExecutor
from scenes import load

PER_FILE = 120
ROW_GROUP = 40
FILES = 2
EVERY = PER_FILE * FILES
GEO = {
    "version": "1.1.0",
    "primary_column": "geometry",
    "columns": {"geometry": {"encoding": "WKB", "geometry_types": ["Polygon"], "crs": None}},
}


def write_parquet(
    path: Path, polygons: np.ndarray, first: int, geo: object = GEO, rows: int = ROW_GROUP
) -> Path:
    """Write polygons with `id`, a nullable `storeys`, and their bounding boxes."""
    box = dict(zip(("xmin", "ymin", "xmax", "ymax"), shapely.bounds(polygons).T, strict=True))
    numbers = np.arange(first, first + len(polygons))
    table = pa.table(
        {
            "id": numbers,
            "storeys": pa.array([None if n % 7 == 3 else int(n % 5) for n in numbers], pa.int16()),
            "bbox": pa.StructArray.from_arrays([pa.array(v) for v in box.values()], list(box)),
            "geometry": pa.array(shapely.to_wkb(polygons), pa.binary()),
        }
    )
    schema = table.schema.with_metadata({"geo": json.dumps(geo)} if geo else {})
    parquet.write_table(table.cast(schema), path, row_group_size=rows)
    return path


@pytest.fixture(scope="session")
def footprints() -> np.ndarray:
    """Return 240 footprints of a generated city, from west to east."""
    polygons = np.array(load(f"city:buildings={EVERY}", seed=3).polygons, dtype=object)
    return polygons[np.argsort(shapely.bounds(polygons)[:, 0], kind="stable")]


@pytest.fixture
def finely(monkeypatch: pytest.MonkeyPatch) -> None:
    """Divide data sets into parts of one row group of 40 rows."""
    monkeypatch.setattr("scenes.slices.MIN_ROWS", ROW_GROUP // 2)
    monkeypatch.setattr("scenes.slices.MAX_ROWS", ROW_GROUP)


@pytest.fixture
def parts(tmp_path: Path, footprints: np.ndarray, finely: None) -> Path:
    """Return a folder of two files of three row groups each."""
    folder = tmp_path / "parts"
    folder.mkdir()
    for number in range(FILES):
        first = number * PER_FILE
        write_parquet(folder / f"{number}.parquet", footprints[first : first + PER_FILE], first)
    return folder


@pytest.fixture(scope="module")
def two_workers() -> Iterator[DaskExecutor]:
    executor = DaskExecutor("local:2")
    yield executor
    executor.close()


def read_all(folder: Path, *columns: str) -> list[pa.Table]:
    """Return the tables of all parts in a folder, by id."""
    read = [parquet.read_table(file, columns=list(columns) or None) for file in find_parts(folder)]
    return sorted(read, key=lambda table: table["id"].to_pylist() or [-1])


def find_parts(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.parquet"))


def read_parts(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in find_parts(folder)}


def read_ids(folder: Path) -> list[int]:
    return sorted(number for table in read_all(folder, "id") for number in table["id"].to_pylist())
