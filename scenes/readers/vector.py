"""Reader of vector files by GDAL: GeoJSON, GeoPackage, Shapefile, FlatGeobuf, OSM PBF and more."""

from __future__ import annotations

import json
import re
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyogrio
import shapely
from numpy.typing import NDArray

from scenes.readers.gdal import FailureLog, find_crs, find_skipped_lines, is_geojson_sequence
from scenes.readers.geoparquet import to_pandas
from scenes.readers.guard import (
    check_last_line,
    check_quoted_names,
    check_quotes,
    make_truncation_error,
    refuse_special,
)
from scenes.readers.reader import RawChunk, Source
from scenes.readers.wkt import parse_wkb
from scenes.scene import SceneError
from scenes.spec import format_suggestion

if TYPE_CHECKING:
    import pandas as pd

_DRAWINGS = (".dxf", ".dgn")  # files in which areas are drawn as closed lines
_CLOSED = "closed lines are read as polygons"

_CSV_OPTIONS = {
    "GEOM_POSSIBLE_NAMES": "WKT,geometry,geom,the_geom,wkb_geometry,wkt_geom,geom_wkt,geometry_wkt",
    "KEEP_GEOM_COLUMNS": "NO",
    "AUTODETECT_TYPE": "YES",  # so that conditions (`where`) compare numbers; 007 remains text
    "AUTODETECT_SIZE_LIMIT": "0",
}

# Reason of the note on a row of CSV that GDAL reads without geometry.
_NO_WKT = "has no WKT (in a column named geometry also hexadecimal WKB), or it begins with SRID"
_DATA_SETS = (".shp", ".gpkg", ".geojson", ".json", ".fgb", ".gml", ".kml", ".csv", ".gdb", ".dxf")
"""Suffixes by which a data set is recognised in an archive."""


def read(source: Source, size: int) -> Iterator[RawChunk]:
    """Yield the geometries of a layer, `size` features at a time.

    Features that GDAL reads without geometry become notes. Raises SceneError if GDAL reports more
    failures than such features, because polygons would then be missing.
    """
    for file in _list_files(source.path):
        refuse_special(file)
    is_sequence = is_geojson_sequence(source.path)
    if is_sequence:
        check_last_line(source.path, lambda line: bool(json.loads(line)))
    if _open_options(source.path) and not (source.rows and source.rows[0]):
        check_quotes(source.path)
    failures = FailureLog()
    count = missing = 0
    with warnings.catch_warnings(), _explain_errors(source):
        # GDAL's warnings on single features are replaced by notes.
        warnings.simplefilter("ignore")
        layer, notes = choose_layer(source)
        _check_condition(source, layer)
        # OSM files have no index, so that skipping is slow: they are read at once.
        is_osm = source.path.suffix.lower() in (".pbf", ".osm")
        options: dict[str, Any] = {
            "layer": layer,
            "where": source.where,
            # A condition may use any column.
            "columns": None if source.attributes or source.where else [],
            "return_fids": True,
            **_open_options(source.path),
        }
        if find_spec("pyarrow") is not None and not is_osm:
            raws = _read_arrow(source, options, size)
        else:
            raws = _read_by_skipping(source, options, None if is_osm else size)
        while True:
            with failures.listen():
                raw = next(raws, None)
            if raw is not None:
                count += len(raw.labels) + len(raw.dropped)
                missing += int(shapely.is_missing(raw.geometries).sum())
            if failures.count > missing and not is_sequence:
                raise SceneError(
                    f"{source.path} cannot be read completely ({failures.first}): polygons would "
                    "be missing; repair it, or export it again"
                )
            if raw is None:
                break
            if _open_options(source.path):
                absent = zip(raw.labels, shapely.is_missing(raw.geometries), strict=True)
                raw.dropped.extend((label, _NO_WKT) for label, is_absent in absent if is_absent)
                raw = raw.without_dropped()
            raw = _close_lines(source, raw)
            crs = find_crs(source.path, raw.crs)
            yield replace(raw, crs=crs, notes=notes + raw.notes)
    if is_sequence:
        is_complete = source.where is None and source.rows is None
        yield from find_skipped_lines(
            source.path, count, failures.count, is_complete=is_complete, size=size
        )
    _check_feature_count(source, layer, count)


def _check_condition(source: Source, layer: str) -> None:
    if source.where is not None and source.path.suffix.lower() in (".gpkg", ".sqlite"):
        info = pyogrio.read_info(source.path, layer=layer)
        others = (info["fid_column"], info["geometry_name"], "fid", "rowid")
        names = filter(None, dict.fromkeys((*info["fields"], *others)))
        check_quoted_names(str(source.path), source.where, names)


def _check_feature_count(source: Source, layer: str, count: int) -> None:
    """Raise SceneError if fewer features were read than stated: GDAL reads truncated FlatGeobuf."""
    stated = 0
    if source.rows is not None:
        stated = source.rows[1] - source.rows[0]
    elif source.path.suffix.lower() == ".fgb":
        stated = pyogrio.read_info(source.path, layer=layer)["features"]
        if source.where is not None:  # `count` excludes features not matching: count all
            options = {"layer": layer, "columns": [], "read_geometry": False, "return_fids": True}
            count = len(pyogrio.raw.read(source.path, **options)[1])
    if count < stated:
        raise make_truncation_error(source.path, f"{count} of {stated} features")


def _list_files(path: Path) -> Iterator[Path]:
    """Yield the files that GDAL may open for a path, such as siblings, and the sources of a VRT."""
    folder = path if path.is_dir() else path.parent
    yield from (file for file in folder.iterdir() if folder == path or file.stem == path.stem)
    if path.suffix.lower() == ".vrt":
        text = path.read_text(encoding="utf-8", errors="replace")
        for name in re.findall(r"<SrcDataSource[^>]*>([^<]*)<", text):
            yield path.parent / ("/dev/stdin" if "/vsistdin" in name else name.strip())


@contextmanager
def _explain_errors(source: Source) -> Iterator[None]:
    """Raise a SceneError with a remedy for an unsupported format, and for an invalid condition."""
    try:
        yield
    except SceneError:
        raise
    except pyogrio.errors.DataSourceError as error:
        if "not recognized as being in a supported file format" not in str(error):
            raise
        problem = "has an unsupported format: convert it, e.g. to GeoJSON"
        as_tiles = f"{source.path}:zoom=14"
        if source.path.suffix.lower() in (".mbtiles", ".pmtiles"):
            problem = f"is not supported by GDAL: read it as map tiles, by a zoom: {as_tiles}"
        if source.path.suffix.lower() in (".ttf", ".otf", ".ttc"):
            problem = f"is a font: read its letters as glyphs:font={source.path},text=abc"
        if source.path.is_dir():
            problem = f"is a folder: give a file, or a zoom of map tiles: {as_tiles}"
        raise SceneError(f"{source.path} {problem}") from error
    except Exception as error:
        is_sql = any(word in str(error) for word in ("SQL", "such column", "syntax", "token"))
        if source.where is None or not is_sql:
            raise
        layer, _ = choose_layer(source)
        path, options = find_gdal_path(source.path), _open_options(source.path)
        info = pyogrio.read_info(path, layer=layer, **options)
        hint = f"attributes are {', '.join(info['fields']) or 'none'}"
        for name, kind in zip(info["fields"], info["dtypes"], strict=True):
            comparison = rf'\b{re.escape(name)}"?\s*[<>=!]+\s*[-\d]'
            if kind == "object" and re.search(comparison, source.where):
                hint += f"; {name} is text: CAST({name} AS FLOAT) is a number"
        raise SceneError(f"{source.path}: invalid condition {source.where!r}; {hint}") from error


def _open_options(path: Path) -> dict[str, str]:
    return _CSV_OPTIONS if path.suffix.lower() in (".csv", ".tsv") else {}


def find_gdal_path(path: Path) -> Path | str:
    """Return the path to give to GDAL: the file, or the only data set in a folder of an archive."""
    if re.search(r"[\n\r\t]", str(path)):  # GDAL would remove these characters
        raise SceneError(f"{path} has a tab or line end in its path: rename the file or folder")
    if path.suffix.lower() != ".zip" or not zipfile.is_zipfile(path):
        return path
    with zipfile.ZipFile(path) as archive:
        names = [entry.filename for entry in archive.infolist() if not entry.is_dir()]
    data_sets = [
        name
        for name in names
        if Path(name).suffix.lower() in _DATA_SETS and not Path(name).name.startswith(".")
    ]
    if any("/" not in name for name in data_sets or names):
        return path  # GDAL finds data sets that are not in folders
    if len(data_sets) == 1:
        return f"/vsizip/{path.resolve()}/{data_sets[0]}"
    several = f"several data sets in folders ({', '.join(data_sets[:3])})"
    content = several if data_sets else "no data set"
    raise SceneError(f"{path} has {content}: unpack it and give a file from it")


def _read_arrow(source: Source, options: dict[str, Any], size: int) -> Iterator[RawChunk]:
    """Yield chunks of `size` features from one pass over the file or `source.rows`, by pyarrow."""
    first, stop = source.rows or (0, None)
    batch_size = size if stop is None else min(size, stop - first)
    path = find_gdal_path(source.path)
    with pyogrio.raw.open_arrow(
        path, skip_features=first, batch_size=batch_size, use_pyarrow=True, **options
    ) as (meta, batches):
        _check_geometry_column(source, options["layer"], meta["geometry_type"])
        for batch in batches:
            if stop is not None:  # GDAL's Arrow streams cannot stop at a feature
                batch = batch.slice(0, stop - first)
                first += batch.num_rows
            # The columns are the feature's number, the attributes, one or more geometries.
            others = [name for name in batch.schema.names[1:] if name not in meta["fields"]][1:]
            first_geometry = batch.num_columns - 1 - len(others)
            wkb = batch.column(first_geometry).to_numpy(zero_copy_only=False)
            table: pd.DataFrame | None = None
            notes = (f"the first geometry column is read, not {', '.join(others)}",) * bool(others)
            if source.attributes:
                columns = batch.select(range(1, first_geometry))
                table, more_notes = to_pandas(columns, exact=source.rows is not None)
                notes += more_notes
            raw = _parse_chunk(batch.column(0).to_pylist(), wkb, table, meta["crs"])
            yield replace(raw, notes=notes)
            if first == stop:
                return


def _read_by_skipping(
    source: Source, options: dict[str, Any], size: int | None
) -> Iterator[RawChunk]:
    """Yield chunks of `size` features without pyarrow: each request skips the features before."""
    start, stop = source.rows or (0, None)
    path = find_gdal_path(source.path)
    while True:
        if stop is not None and size is not None:
            size = min(size, stop - start)
        meta, fids, wkb, columns = pyogrio.raw.read(
            path, skip_features=start, max_features=size, **options
        )
        _check_geometry_column(source, options["layer"], wkb)
        table = None
        if source.attributes:
            import pandas as pd

            by_name = dict(zip(meta["fields"], columns, strict=True))
            table = pd.DataFrame(by_name, index=range(len(wkb)))
        yield _parse_chunk(fids.tolist(), wkb, table, meta["crs"])
        start += len(wkb)
        if size is None or len(wkb) < size or start == stop:
            return


def _check_geometry_column(source: Source, layer: str, column: Any) -> None:
    """Raise SceneError if a layer has no geometries, so that `column` is None."""
    remedy = "give a layer with polygons"
    if _open_options(source.path):
        remedy = "name the column of WKT geometries WKT or geometry"
    if column is None:
        raise SceneError(f"{source.path} has no geometry in layer {layer}: {remedy}")


def _parse_chunk(
    fids: list[int], wkb: NDArray[Any], table: pd.DataFrame | None, crs: str | None
) -> RawChunk:
    """Return a chunk of parsed geometries, given number and (E)WKB of each feature."""
    labels = [f"feature {fid}" for fid in fids]
    geometries, dropped, repaired = parse_wkb(wkb, labels)
    return RawChunk(geometries, labels, table, crs, "units", dropped, repaired).without_dropped()


def _close_lines(source: Source, raw: RawChunk) -> RawChunk:
    """Return a drawing's chunk with closed lines as polygons; chunks of other files unchanged."""
    if source.path.suffix.lower() not in _DRAWINGS:
        return raw
    geometries = [_close_geometry(geometry) for geometry in raw.geometries]
    is_changed = any(new is not old for new, old in zip(geometries, raw.geometries, strict=True))
    return replace(raw, geometries=geometries, notes=raw.notes + (_CLOSED,) * is_changed)


def _close_geometry(geometry: Any) -> Any:
    """Return a polygon for a closed line, also in the collections that are blocks of a drawing."""
    if geometry is None or geometry.is_empty:
        return geometry
    if geometry.geom_type in ("LineString", "LinearRing"):
        is_area = geometry.is_closed and shapely.get_num_coordinates(geometry) > 3
        return shapely.Polygon(geometry.coords) if is_area else geometry
    if geometry.geom_type in ("MultiLineString", "GeometryCollection"):
        parts = [_close_geometry(part) for part in geometry.geoms]
        if any(new is not old for new, old in zip(parts, geometry.geoms, strict=True)):
            return shapely.GeometryCollection(parts)
    return geometry


def choose_layer(source: Source) -> tuple[str, tuple[str, ...]]:
    """Return the layer to read, by default the first that allows polygons, and notes on others."""
    layers = pyogrio.list_layers(find_gdal_path(source.path))
    names = [str(name) for name, _ in layers]
    if not names:
        remedy = "give a file with polygons"
        if source.path.suffix.lower() in (".mbtiles", ".pmtiles"):
            remedy = f"read it as map tiles, by a zoom: {source.path}:zoom=14"
        raise SceneError(f"{source.path} has no layer: {remedy}")
    if source.layer is not None and source.layer not in names:
        hint = format_suggestion(source.layer, names, "it has")
        raise SceneError(f"{source.path} has no layer {source.layer!r}; {hint}")
    # Prefer layers with polygons, then layers of unknown type.
    kinds = [str(kind) for _, kind in layers]
    ranks = [
        ("Polygon" in kind or "Surface" in kind, kind in ("Unknown", "GeometryCollection"))
        for kind in kinds
    ]
    layer = source.layer or names[ranks.index(max(ranks))]
    alternatives = [name for name in names if name != layer]
    notes = [f"layer {layer} (others: {', '.join(alternatives)})"] if alternatives else []
    if source.path.is_dir() and source.path.suffix.lower() != ".gdb":
        # Of a folder, GDAL reads Shapefiles only.
        unread = sorted(file.name for file in source.path.iterdir() if file.stem not in names)
        if unread:
            count = f"{len(unread)} of the folder's files"
            notes.append(f"{count} not read, first {unread[0]}: give a file")
    return layer, tuple(notes)
