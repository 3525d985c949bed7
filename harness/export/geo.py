"""GeoJSON and GeoParquet: a feature for each polygon, its triangles as a multi-polygon.

Coordinates are the source's own, so that the triangles lie on the map where the polygons did.
Triangles share edges, which the simple-features standard does not allow the parts of a
multi-polygon to do; programs read and draw them all the same, and no other type is read as widely.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.export.mesh import Mesh
from harness.export.writers import About, plain
from harness.stored.atomic import Output
from scenes.cleaning.projection import system
from scenes.spec import install

_MULTIPOLYGON, _POLYGON, _WITH_Z = 6, 3, 1000
_MOST_BYTES = 2**31 - 1  # that offsets of 32 bits reach


class GeoJsonWriter:
    """One feature per line; other reference systems than longitude and latitude are named in `crs`.

    That member is GeoJSON of 2008, which GDAL and QGIS read; RFC 7946 knows degrees only.
    """

    def __init__(self, output: Output, about: About) -> None:
        self._about = about
        self._stream = output.file(mode="w")
        self._stream.write('{"type":"FeatureCollection",')
        # EPSG:4326 is GeoJSON's own and needs no name
        if about.crs and about.crs.startswith("EPSG:") and about.crs != "EPSG:4326":
            name = f"urn:ogc:def:crs:{about.crs.replace(':', '::')}"
            self._stream.write(
                f'"crs":{json.dumps({"type": "name", "properties": {"name": name}})},'
            )
        self._stream.write('"features":[')
        self._first = True

    def add(self, mesh: Mesh) -> None:
        """Write one more batch."""
        corners = self._about.in_source(mesh.vertices)[mesh.triangles]
        closed = np.concatenate([corners, corners[:, :1]], axis=1)
        starts = mesh.triangle_starts.tolist()
        columns = [str(name) for name in mesh.attributes]
        rows = mesh.attributes.itertuples(index=False, name=None)
        for start, end, row in zip(starts[:-1], starts[1:], rows, strict=True):
            triangles = closed[start:end, None].tolist()
            feature = {
                "type": "Feature",
                "properties": {k: plain(v) for k, v in zip(columns, row, strict=True)},
                "geometry": {"type": "MultiPolygon", "coordinates": triangles},
            }
            self._stream.write("\n" if self._first else ",\n")
            self._stream.write(json.dumps(feature, separators=(",", ":")))
            self._first = False

    def finish(self) -> None:
        """Close the collection."""
        self._stream.write("\n]}\n")


def parquet_module() -> Any:
    """Return pyarrow's module for Parquet; raises `UsageError` where it is not installed."""
    try:
        from pyarrow import parquet
    except ImportError as error:
        raise UsageError(f"GeoParquet needs pyarrow: {install('geoparquet')}") from error
    return parquet


class GeoParquetWriter:
    """GeoParquet 1.1, WKB in column `geometry`, a row group for each batch.

    The reference system is that of the source, as PROJJSON; null where the source has none that
    PROJ knows.
    """

    def __init__(self, output: Output, about: About) -> None:
        self._parquet = parquet_module()
        self._path = output.path()
        self._about = about
        self._writer: Any = None

    def add(self, mesh: Mesh) -> None:
        """Write one more batch."""
        import pyarrow as pa

        table = pa.Table.from_pandas(mesh.attributes, preserve_index=False)
        if "geometry" in table.column_names:
            renamed = [f"{n}_" if n == "geometry" else n for n in table.column_names]
            table = table.rename_columns(renamed)
        for number, kind in enumerate(table.schema.types):
            if pa.types.is_null(kind):  # nothing but missing values in this batch
                text = table.column(number).cast(pa.string())
                table = table.set_column(number, table.column_names[number], text)
        geometry = _binary(*_wkb(mesh, self._about), pa)
        if table.num_columns == 0:
            table = pa.table({"geometry": geometry})
        else:
            table = table.append_column("geometry", geometry)
        if self._writer is None:
            metadata = {"geo": json.dumps(self._metadata(mesh)), "raster_harness": self._say()}
            self._schema = table.schema.with_metadata(metadata)
            # no two geometries are alike: a dictionary of them would only take time
            others = [name for name in self._schema.names if name != "geometry"]
            self._writer = self._parquet.ParquetWriter(
                self._path, self._schema, use_dictionary=others or False
            )
        # a column may look different in each batch: all missing in one, text in the next
        self._writer.write_table(_fitted(table, self._schema, pa))

    def finish(self, told: Mapping[str, str] | None = None) -> None:
        """Write the footer; `told` is what it says beside the rest, by name."""
        if self._writer is None:
            raise UsageError("there is no polygon to write")
        if told:
            self._writer.add_key_value_metadata(dict(told))
        self._writer.close()

    def _say(self) -> str:
        about = self._about
        crs = about.crs if about.crs is not None else about.units
        return json.dumps({"crs": crs, "triangulator": about.triangulator, "credit": about.credit})

    def _metadata(self, mesh: Mesh) -> dict[str, Any]:
        kind = "MultiPolygon Z" if mesh.vertices.shape[1] == 3 else "MultiPolygon"
        column: dict[str, Any] = {"encoding": "WKB", "geometry_types": [kind]}
        if self._about.crs not in ("EPSG:4326", "OGC:CRS84"):  # which are meant where none is named
            known = system(self._about.crs)
            column["crs"] = None if known is None else known.to_json_dict()
        return {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}


def _fitted(table: Any, schema: Any, pa: Any) -> Any:
    try:
        return table.select(schema.names).cast(schema)
    except (pa.ArrowException, KeyError, ValueError) as error:
        raise UsageError(f"the attributes change their type within the source: {error}") from error


def _binary(starts: NDArray[np.int64], data: NDArray[np.uint8], pa: Any) -> Any:
    """Return a chunked array of `data[starts[i]:starts[i + 1]]`; 32 bits count each chunk."""
    chunks: list[Any] = []
    first, rows = 0, len(starts) - 1
    while first < rows or not chunks:
        last = int(np.searchsorted(starts, starts[first] + _MOST_BYTES, side="right")) - 1
        last = min(max(last, first + 1), rows)
        if starts[last] - starts[first] > _MOST_BYTES:
            raise UsageError("a polygon's triangles take more than 2 GiB: write another format")
        offsets = (starts[first : last + 1] - starts[first]).astype(np.int32)
        part = data[starts[first] : starts[last]]
        buffers = [None, pa.py_buffer(offsets), pa.py_buffer(part)]
        chunks.append(pa.Array.from_buffers(pa.binary(), last - first, buffers))
        first = last
    return pa.chunked_array(chunks, pa.binary())


def _wkb(mesh: Mesh, about: About) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Each polygon's triangles as a little-endian WKB multi-polygon.

    Returns (starts, data): polygon i is `data[starts[i]:starts[i + 1]]`.
    """
    vertices: NDArray[np.float64] = about.in_source(mesh.vertices)
    dimensions = vertices.shape[1]
    extra = _WITH_Z if dimensions == 3 else 0
    record = np.dtype(
        [
            ("order", "u1"),
            ("type", "<u4"),
            ("rings", "<u4"),
            ("points", "<u4"),
            ("xyz", "<f8", (4, dimensions)),
        ]
    )
    corners = vertices[mesh.triangles]
    triangles = np.empty(len(corners), record)
    triangles["order"], triangles["type"], triangles["rings"] = 1, _POLYGON + extra, 1
    triangles["points"] = 4
    triangles["xyz"][:, :3] = corners
    triangles["xyz"][:, 3] = corners[:, 0]
    head = np.empty(mesh.polygons, np.dtype([("order", "u1"), ("type", "<u4"), ("parts", "<u4")]))
    head["order"], head["type"] = 1, _MULTIPOLYGON + extra
    head["parts"] = np.diff(mesh.triangle_starts)
    rows = np.arange(mesh.polygons + 1)
    starts = mesh.triangle_starts * np.int64(record.itemsize) + rows * head.itemsize
    data = np.empty(starts[-1], np.uint8)
    data[starts[:-1, np.newaxis] + np.arange(head.itemsize)] = _bytes(head)
    # A triangle's bytes are a window of the data, after one head more than polygons before it.
    heads = np.repeat(rows[1:], np.diff(mesh.triangle_starts))
    first = np.arange(len(triangles)) * record.itemsize + heads * head.itemsize
    if len(first):
        sliding_window_view(data, record.itemsize, writeable=True)[first] = _bytes(triangles)
    return starts, data


def _bytes(records: NDArray[Any]) -> NDArray[np.uint8]:
    return records.view(np.uint8).reshape(len(records), records.itemsize)
