"""Memory and speed of an export of a million footprints to GeoParquet."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import shapely
from pyarrow import parquet

from scenes import load
from tests.paths import run_python

MEMORY_MIB = 2048
TILES = 10

EXPORT = """
import json, resource, sys
from harness.export.export import export_file
report = export_file(sys.argv[1], sys.argv[2])
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps([report.polygons, report.seconds, report.triangulate_s, peak]))
"""


@pytest.fixture(scope="module")
def million(tmp_path_factory) -> Path:
    """Return a file of ten adjacent cities of 100,000 footprints with two attributes."""
    path = tmp_path_factory.mktemp("million") / "in.parquet"
    hundred_thousand = np.asarray(load("city", buildings=100_000).polygons)
    column = {"encoding": "WKB", "geometry_types": ["Polygon"], "crs": None}
    geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
    count = len(hundred_thousand)
    schema = pa.schema([("id", pa.int64()), ("height", pa.float64()), ("geometry", pa.binary())])
    with parquet.ParquetWriter(path, schema.with_metadata({"geo": json.dumps(geo)})) as writer:
        for tile in range(TILES):
            moved = shapely.transform(
                hundred_thousand, lambda xy, k=tile: xy + np.array([2e4 * k, 0])
            )
            columns = [np.arange(count) + tile * count, np.linspace(3, 40, count)]
            arrays = [*map(pa.array, columns), pa.array(shapely.to_wkb(moved).tolist())]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
    return path


def test_a_million_footprints_in_two_gibibytes(million):
    out = million.with_name("out.parquet")
    process = run_python("-c", EXPORT, million, out, check=True)
    polygons, seconds, triangulate_s, peak = json.loads(process.stdout)
    print(
        f"\n{polygons} footprints: total {seconds:.1f} s ({polygons / seconds:.0f}/s), "
        f"H-optimal triangulation {triangulate_s:.1f} s "
        f"({polygons / triangulate_s:.0f}/s); peak {peak:.0f} MiB"
    )
    assert polygons == 1_000_000
    assert parquet.read_metadata(out).num_rows == polygons
    assert peak < MEMORY_MIB
