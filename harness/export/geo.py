"""GeoJSON and GeoParquet: a feature for each polygon, with the triangles as a multi-polygon.

Parts of a multi-polygon must not share edges; programs read and draw them nevertheless, and no
other type is supported as widely. A geometry collection (`collection`) is valid.
"""

import json
import struct
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.atomic import Output
from harness.errors import InputError, UsageError
from harness.export.writers import ExportMesh, ExportMetadata, find_free_name, to_json_value
from scenes.projection import find_system
from scenes.spec import format_install_command

_DEGREES = ("EPSG:4326", "OGC:CRS84")  # the default of GeoJSON and GeoParquet, not written


class GeoJsonWriter:
    """Writes one feature per line; a member `crs` names a system other than EPSG:4326.

    `crs` is part of GeoJSON 2008, which GDAL and QGIS read; RFC 7946 allows degrees only. It is
    null for a system without a code, and for coordinates without a system.
    """

    def __init__(self, output: Output, about: ExportMetadata, *, collection: bool = False) -> None:
        self._about, self._collection = about, collection
        self._stream = output.open_published(mode="w")
        self._stream.write('{"type":"FeatureCollection",')
        if about.crs not in _DEGREES:
            system = find_system(about.crs)
            code = None if system is None else system.to_json_dict().get("id")
            crs = None
            if code is not None:
                name = f"urn:ogc:def:crs:{code['authority']}::{code['code']}"
                crs = {"type": "name", "properties": {"name": name}}
            self._stream.write(f'"crs":{json.dumps(crs)},')
        self._stream.write('"features":[')
        self._first = True

    def add(self, mesh: ExportMesh) -> None:
        """Write a batch of triangulated polygons."""
        closed = _close_rings(mesh, self._about)
        starts = mesh.triangle_offsets.tolist()
        columns = [str(name) for name in mesh.attributes]
        rows = mesh.attributes.itertuples(index=False, name=None)
        for start, end, row in zip(starts[:-1], starts[1:], rows, strict=True):
            triangles = closed[start:end, None].tolist()
            geometry: dict[str, Any] = {"type": "MultiPolygon", "coordinates": triangles}
            if self._collection:
                parts = [{"type": "Polygon", "coordinates": rings} for rings in triangles]
                geometry = {"type": "GeometryCollection", "geometries": parts}
            feature = {
                "type": "Feature",
                "properties": {k: to_json_value(v) for k, v in zip(columns, row, strict=True)},
                "geometry": geometry,
            }
            self._stream.write("\n" if self._first else ",\n")
            self._stream.write(json.dumps(feature, separators=(",", ":")))
            self._first = False

    def finish(self) -> None:
        """Write the end of the feature collection."""
        self._stream.write("\n]}\n")


def import_parquet() -> Any:
    """Return pyarrow's module for Parquet; raise UsageError if pyarrow is not installed."""
    try:
        from pyarrow import parquet
    except ImportError as error:
        raise UsageError(
            f"GeoParquet requires pyarrow: {format_install_command('geoparquet')}"
        ) from error
    return parquet


class GeoParquetWriter:
    """GeoParquet 1.1, WKB in column `geometry`, a row group for each batch.

    The coordinate reference system is the source's, as PROJJSON, or null if PROJ does not know it.
    """

    def __init__(self, output: Output, about: ExportMetadata, *, collection: bool = False) -> None:
        self._parquet = import_parquet()
        self._path = output.make_published_path()
        self._about, self._collection = about, collection
        self._writer: Any = None

    def add(self, mesh: ExportMesh) -> None:
        """Write a batch of triangulated polygons."""
        import pyarrow as pa

        table = pa.Table.from_pandas(mesh.attributes, preserve_index=False)
        names = table.column_names
        if "geometry" in names:
            free = find_free_name("geometry", names)
            table = table.rename_columns([free if n == "geometry" else n for n in names])
        geometry = pa.array(_encode_wkb(mesh, self._about, self._collection), pa.binary())
        if table.num_columns == 0:
            table = pa.table({"geometry": geometry})
        else:
            table = table.append_column("geometry", geometry)
        if self._writer is None:
            # If all values of the first batch are missing, text, the most general type, is assumed.
            fields = [
                field.with_type(pa.string()) if pa.types.is_null(field.type) else field
                for field in table.schema
            ]
            metadata = {
                "geo": self._make_geo_metadata(),
                "raster_harness": self._make_origin_metadata(),
            }
            self._schema = pa.schema(fields, metadata)
            # No dictionary encoding for geometries, which all differ.
            columns = [name for name in self._schema.names if name != "geometry"]
            self._writer = self._parquet.ParquetWriter(
                self._path, self._schema, use_dictionary=columns or False
            )
        # Types may differ between batches: all missing in one, text in the next.
        try:
            columns = [_fit_column(table.column(f.name), f.type) for f in self._schema]
            fitted = pa.table(columns, schema=self._schema)
        except (pa.ArrowException, KeyError, ValueError) as error:
            problem = f"attributes: types change within the source ({error}); make them equal"
            raise InputError(problem) from error
        self._writer.write_table(fitted)

    def finish(self, metadata: Mapping[str, str] | None = None) -> None:
        """Write the footer with additional `metadata` by name."""
        if metadata:
            self._writer.add_key_value_metadata(dict(metadata))
        self._writer.close()

    def _make_origin_metadata(self) -> str:
        about = self._about
        crs = about.crs if about.crs is not None else about.units
        return json.dumps({"crs": crs, "triangulator": about.triangulator, "credit": about.credit})

    def _make_geo_metadata(self) -> str:
        kind = "GeometryCollection" if self._collection else "MultiPolygon"
        column: dict[str, Any] = {"encoding": "WKB", "geometry_types": [kind]}
        if self._about.crs not in _DEGREES:
            system = find_system(self._about.crs)
            column["crs"] = None if system is None else system.to_json_dict()
        return json.dumps(
            {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
        )


def _fit_column(column: Any, kind: Any) -> Any:
    """Return an Arrow column as a type; all values may be missing, and lists become JSON text."""
    import pyarrow as pa

    if pa.types.is_null(column.type):
        return pa.nulls(len(column), kind)
    if pa.types.is_string(kind) and pa.types.is_nested(column.type):
        values = (to_json_value(value) for value in column.to_pylist())
        return pa.array([None if value is None else json.dumps(value) for value in values], kind)
    # As in a batch with missing values, in which pandas has floats, large integers are rounded.
    return column.cast(kind, safe=not pa.types.is_floating(kind))


_POLYGON, _MULTI_POLYGON, _COLLECTION = 3, 6, 7  # types in WKB


def _close_rings(mesh: ExportMesh, about: ExportMetadata) -> NDArray[np.float64]:
    """Return triangles as closed rings (m, 4, 2) in the source's coordinates."""
    corners = about.to_source(mesh.vertices)[mesh.triangles]
    return np.concatenate([corners, corners[:, :1]], axis=1)


def _encode_wkb(mesh: ExportMesh, about: ExportMetadata, collection: bool) -> list[bytes]:
    """Return each polygon's triangles as a little-endian WKB multi-polygon or collection.

    Shapely objects, one per triangle, took five times as long, a third of an export.
    """
    rings = _close_rings(mesh, about)
    head = [("order", "u1"), ("type", "<u4"), ("rings", "<u4"), ("points", "<u4")]
    triangles = np.empty(len(rings), [*head, ("ring", "<f8", (4, 2))])
    triangles["order"], triangles["type"] = 1, _POLYGON
    triangles["rings"], triangles["points"], triangles["ring"] = 1, 4, rings
    data, size = triangles.view(np.uint8).data, triangles.itemsize
    kind = _COLLECTION if collection else _MULTI_POLYGON
    return [
        struct.pack("<BII", 1, kind, end - start) + data[start * size : end * size]
        for start, end in pairwise(mesh.triangle_offsets.tolist())
    ]
