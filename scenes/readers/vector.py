"""Vector files through GDAL: GeoJSON, GeoPackage, Shapefile, FlatGeobuf, OSM PBF and many more.

GDAL goes on after a feature that it cannot read, and says so to its error handler alone; of a
GeoJSON sequence it leaves lines out without a word. The one is heard here, the other looked for.
"""

from __future__ import annotations

import ctypes
import json
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

from scenes.cleaning.projection import system
from scenes.readers.geoparquet import to_pandas
from scenes.readers.guard import (
    LONGEST,
    cut_off,
    edges,
    numbered_lines,
    refuse_special,
    refuse_unended,
)
from scenes.readers.reader import Raw, Source
from scenes.scene import Note, SceneError
from scenes.spec import suggestion

if TYPE_CHECKING:
    import pandas as pd


def read(source: Source, size: int) -> Iterator[Raw]:
    """Geometries of one layer, `size` features at a time.

    The layer is the one asked for, else the first that can hold polygons. Raises SceneError where
    GDAL reports more failures than there are features without geometry, which are named.
    """
    if re.search(r"[\n\r\t]", str(source.path)):  # GDAL would leave these out
        raise SceneError(f"{source.path} has a tab or an end of line in its name: rename it")
    for each in _opened(source.path):
        refuse_special(each)
    by_line = is_sequence(source.path)
    if by_line:
        refuse_unended(source.path, lambda line: bool(json.loads(line)))
    failures = Failures()
    read = missing = 0
    with warnings.catch_warnings(), _explained(source):
        # GDAL's remarks on single features come back as our own notes
        warnings.simplefilter("ignore")
        layer, notes = layer_of(source)
        # OSM files have no index and are read in one go
        whole = source.path.suffix.lower() in (".pbf", ".osm")
        if find_spec("pyarrow") is not None and not whole:
            raws = _streamed(source, layer, size)
        else:
            raws = _by_skipping(source, layer, None if whole else size)
        while True:
            with failures.heard():
                raw = next(raws, None)
            if raw is not None:
                read += len(raw.labels) + len(raw.dropped)
                missing += int(shapely.is_missing(raw.geometries).sum())
            if failures.count > missing and not by_line:
                raise SceneError(
                    f"{source.path} cannot be read whole, polygons would be missing: "
                    f"{failures.first} (it is damaged: write or copy it again)"
                )
            if raw is None:
                break
            yield replace(raw, crs=_true_crs(source.path, raw.crs), notes=notes + raw.notes)
    if by_line:
        everything = source.where is None and source.rows is None
        yield from lost(source.path, read, failures.count, all_wanted=everything, size=size)
    _refuse_fewer(source, layer, read)


def _refuse_fewer(source: Source, layer: str, read: int) -> None:
    """Raise SceneError where fewer features came than the file says it has, or than were asked for.

    GDAL ends a FlatGeobuf file that was cut between two features without a word.
    """
    stated = 0
    if source.rows is not None:
        stated = source.rows[1] - source.rows[0]
    elif source.path.suffix.lower() == ".fgb":
        stated = pyogrio.read_info(source.path, layer=layer)["features"]
        if source.where is not None:  # count those that do not meet it, too
            options = {"layer": layer, "columns": [], "read_geometry": False, "return_fids": True}
            read = len(pyogrio.raw.read(source.path, **options)[1])
    if read < stated:
        raise cut_off(source.path, f"it has {read} of {stated} features")


def _opened(path: Path) -> Iterator[Path]:
    """What GDAL opens with a file: what has its name and another suffix, or lies in it, or is named
    by it."""
    folder = path if path.is_dir() else path.parent
    yield from (each for each in folder.iterdir() if folder == path or each.stem == path.stem)
    if path.suffix.lower() == ".vrt":
        text = path.read_text(encoding="utf-8", errors="replace")
        for named in re.findall(r"<SrcDataSource[^>]*>([^<]*)<", text):
            yield path.parent / ("/dev/stdin" if "/vsistdin" in named else named.strip())


@contextmanager
def _explained(source: Source) -> Iterator[None]:
    """Say of two usual errors of GDAL what a user can do."""
    try:
        yield
    except SceneError:
        raise
    except pyogrio.errors.DataSourceError as error:
        if "not recognized as being in a supported file format" not in str(error):
            raise
        found = "not a file that GDAL reads: it is damaged, or of an unknown format"
        if source.path.is_dir():
            found = f"a folder: give a file in it, or of map tiles the zoom: {source.path}:zoom=14"
        raise SceneError(f"{source.path} is {found}") from error
    except Exception as error:
        of_sql = any(word in str(error) for word in ("SQL", "such column", "syntax", "token"))
        if source.where is None or not of_sql:
            raise
        known = ", ".join(pyogrio.read_info(source.path, layer=layer_of(source)[0])["fields"])
        raise SceneError(
            f"{source.path}: condition {source.where!r} is not valid; "
            f"its attributes are {known or 'none'}"
        ) from error


def _streamed(source: Source, layer: str, size: int) -> Iterator[Raw]:
    """Chunks of one pass over the file, or over the rows that are wanted."""
    first, last = source.rows or (0, None)
    opened = pyogrio.raw.open_arrow(
        source.path,
        layer=layer,
        where=source.where,
        columns=None if source.attributes else [],
        skip_features=first,
        batch_size=size if last is None else min(size, last - first),
        use_pyarrow=True,
        return_fids=True,
    )
    with opened as (meta, batches):
        if meta["geometry_type"] is None:
            raise SceneError(_no_geometry(source, layer))
        for batch in batches:
            if last is not None:  # Arrow has no way to ask for an end
                batch = batch.slice(0, last - first)
                first += batch.num_rows
            # the feature's number, its attributes, its geometry
            wkb = batch.column(batch.num_columns - 1).to_numpy(zero_copy_only=False)
            columns = batch.select(range(1, batch.num_columns - 1))
            table: pd.DataFrame | None = None
            notes: tuple[str, ...] = ()
            if source.attributes:
                table, notes = to_pandas(columns, exact=source.rows is not None)
            raw = _raw(batch.column(0).to_pylist(), wkb, table, meta["crs"])
            yield replace(raw, notes=notes)
            if first == last:
                return


def _by_skipping(source: Source, layer: str, size: int | None) -> Iterator[Raw]:
    """Chunks of one request each; without pyarrow there is no other way."""
    start, last = source.rows or (0, None)
    while True:
        if last is not None and size is not None:
            size = min(size, last - start)
        meta, fids, wkb, columns = pyogrio.raw.read(
            source.path,
            layer=layer,
            where=source.where,
            columns=None if source.attributes else [],
            skip_features=start,
            max_features=size,
            return_fids=True,
        )
        if wkb is None:
            raise SceneError(_no_geometry(source, layer))
        table = None
        if source.attributes:
            import pandas as pd

            named = dict(zip(meta["fields"], columns, strict=True))
            table = pd.DataFrame(named, index=range(len(wkb)))
        yield _raw(fids.tolist(), wkb, table, meta["crs"])
        start += len(wkb)
        if size is None or len(wkb) < size or start == last:
            return


def _no_geometry(source: Source, layer: str) -> str:
    return f"{source.path} has no geometry in layer {layer}: give one with polygons"


def _raw(fids: list[int], wkb: NDArray[Any], table: pd.DataFrame | None, crs: str | None) -> Raw:
    """A chunk, its geometries parsed; what cannot be parsed is noted and left out."""
    labels = [f"feature {fid}" for fid in fids]
    geometries, dropped, repaired = _geometries(wkb, labels)
    gone = {which for which, _ in dropped}
    keep = np.flatnonzero([label not in gone for label in labels])
    return Raw(geometries, labels, table, crs, "units", dropped, repaired).rows(keep)


def _geometries(
    wkb: NDArray[Any], labels: list[str]
) -> tuple[NDArray[Any], list[Note], list[Note]]:
    """Geometries of WKB, None for those that cannot be parsed, with notes on these."""
    geometries = shapely.from_wkb(wkb, on_invalid="ignore")
    present = np.array([each is not None for each in wkb], dtype=bool)
    dropped, repaired = [], []
    for i in np.flatnonzero(present & shapely.is_missing(geometries)):
        geometries[i] = shapely.from_wkb(wkb[i], on_invalid="fix")
        if geometries[i] is None:
            dropped.append((labels[i], "geometry cannot be parsed (curved, or a broken ring)"))
        else:
            repaired.append((labels[i], "has a ring that is not closed; closed"))
    return geometries, dropped, repaired


def layer_of(source: Source) -> tuple[str, tuple[str, ...]]:
    """The layer to read, and a note on it where there are others."""
    layers = pyogrio.list_layers(source.path)
    known = [str(name) for name, _ in layers]
    if not known:
        raise SceneError(f"{source.path} has no layer: give a file with polygons")
    if source.layer is not None and source.layer not in known:
        hint = suggestion(source.layer, known, "it has")
        raise SceneError(f"{source.path} has no layer {source.layer!r}; {hint}")
    # the first that has polygons, or else may have some, or else the first
    kinds = [str(kind) for _, kind in layers]
    likely = [
        ("Polygon" in kind or "Surface" in kind, kind in ("Unknown", "GeometryCollection"))
        for kind in kinds
    ]
    layer = source.layer or known[likely.index(max(likely))]
    others = [name for name in known if name != layer]
    notes = [f"layer {layer} (others: {', '.join(others)})"] if others else []
    if source.path.is_dir() and source.path.suffix.lower() != ".gdb":
        # GDAL takes a folder for its Shapefiles
        unread = sorted(each.name for each in source.path.iterdir() if each.stem not in known)
        if unread:
            told = f"{len(unread)} of the folder's files not read, first {unread[0]}: name a file"
            notes.append(told)
    return layer, tuple(notes)


def _true_crs(path: Path, crs: str | None) -> str | None:
    """The reference system that the file names, where GDAL has put its own guess in its place.

    GeoJSON of 2008 may name a system in `crs`, before its features or after them, or say by null
    that there is none. If GDAL does not know the name, it takes longitude and latitude.
    """
    if crs != "EPSG:4326" or path.suffix.lower() not in (".geojson", ".json") or path.is_dir():
        return crs
    head, tail = edges(path)
    around = head.partition(b'"features"')[0] + tail.rpartition(b"]")[2]
    member = r'"crs"\s*:\s*(?:\{.*?"(?:name|href)"\s*:\s*)?(null|"[^"]*")'
    found = re.search(member, around.decode("utf-8", "replace"), re.DOTALL)
    if found is None:
        return crs
    name: str | None = json.loads(found[1])
    return name if system(name) is None else crs


_HANDLER = ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.c_int, ctypes.c_char_p)
_FAILURE = 3
"""GDAL's CE_Failure; what is less is a remark on something that was read."""


class Failures:
    """How many failures were heard, and the first of them."""

    def __init__(self) -> None:
        self.count = 0
        self.first = ""

        def heard(kind: int, _: int, text: bytes | None) -> None:
            if kind >= _FAILURE:
                self.count += 1
                self.first = self.first or (text or b"").decode("utf-8", "replace")

        # kept here: GDAL holds a bare pointer to it
        self._handler = _HANDLER(heard)

    @contextmanager
    def heard(self) -> Iterator[None]:
        """Listen while GDAL is called. Never over a `yield`: handlers are a stack of the thread."""
        library = _library()
        if library is None:
            yield
            return
        library.CPLPushErrorHandler(self._handler)
        try:
            yield
        finally:
            library.CPLPopErrorHandler()


@cache
def _library() -> Any | None:
    """GDAL as pyogrio has loaded it: found through its extension module, on Windows beside it."""
    package = Path(pyogrio.__file__).parent
    modules = sorted(package.glob("_err.*.so")) + sorted(package.glob("_err.*.pyd"))
    for file in [*modules, *sorted(package.with_name("pyogrio.libs").glob("*gdal*"))]:
        try:
            library = ctypes.CDLL(str(file))
            library.CPLPopErrorHandler.argtypes = []
            library.CPLPopErrorHandler.restype = None
            library.CPLPushErrorHandler.argtypes = [_HANDLER]
            library.CPLPushErrorHandler.restype = None
        except (OSError, AttributeError):
            continue
        return library
    return None


_GEOMETRIES = ("Point", "LineString", "Polygon", "GeometryCollection")
_KINDS = ("Feature", *_GEOMETRIES, *(f"Multi{kind}" for kind in _GEOMETRIES[:3]))
_SEQUENCES = (".geojsonl", ".geojsons", ".ndgeojson", ".ndjson", ".jsonl", ".nljson")


def is_sequence(path: Path) -> bool:
    """Whether a file has a GeoJSON object a line, by its suffix or by its first line."""
    if path.suffix.lower() not in (".json", ".geojson") or not path.is_file():
        return path.suffix.lower() in _SEQUENCES
    with path.open("rb") as stream:
        first, more = stream.readline(LONGEST).strip(), stream.read(4096).strip()
    if first.startswith((b"\x1e", b"\xef\xbb\xbf\x1e")):
        return True
    if re.search(rb'"type"\s*:\s*"(FeatureCollection|Topology|CityJSON)"', first[:4096]):
        return False
    try:
        return bool(more) and isinstance(json.loads(first), dict)
    except (ValueError, RecursionError):
        return False


def lost(path: Path, read: int, heard: int, *, all_wanted: bool, size: int) -> Iterator[Raw]:
    """Chunks without geometry, whose notes name the lines that gave no feature.

    read : features that came of the file
    heard : failures that GDAL reported; it reports fewer than there are
    all_wanted : whether no condition left features out, so that their number can be compared
    """
    lines = sum(1 for _, line in numbered_lines(path) if not line.isspace()) if all_wanted else 0
    if not heard and read >= lines:
        return
    unread = _unread(path)
    while notes := list(islice(unread, size)):
        read += len(notes)
        yield Raw([], [], dropped=notes)
    if read < lines:
        raise SceneError(
            f"{path} has {lines} features, one a line, but GDAL reads only some of them: write it "
            "again, without a byte order mark"
        )


def _unread(path: Path) -> Iterator[Note]:
    for number, line in numbered_lines(path):
        text = line.strip("\x1e\ufeff \t\r\n")
        try:
            if text and json.loads(text)["type"] not in _KINDS:
                raise KeyError
        except (ValueError, RecursionError):
            yield f"line {number}", "is not JSON"
        except (KeyError, TypeError):
            yield f"line {number}", "is JSON, but not a feature"
