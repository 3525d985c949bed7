"""Vector files through GDAL: GeoJSON, GeoPackage, Shapefile, FlatGeobuf, OSM PBF and many more."""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import pyogrio
import shapely
from numpy.typing import NDArray
from pyogrio import errors

from scenes.files import Raw, Source
from scenes.scene import Note, SceneError

_FAULTS = (
    errors.DataSourceError,
    errors.DataLayerError,
    errors.FieldError,
    errors.FeatureError,
    errors.GeometryError,
    errors.CRSError,
    RuntimeError,
    ValueError,
    OSError,
)


def read(source: Source, size: int) -> Iterator[Raw]:
    """Geometries of one layer, `size` features at a time.

    The layer is the one asked for, else the first that can hold polygons.
    """
    with warnings.catch_warnings():
        # GDAL's remarks on single features come back as our own notes
        warnings.simplefilter("ignore")
        try:
            layer = _layer(source)
            start = 0
            while True:
                raw, count = _chunk(source, layer, start, size)
                yield raw
                if count < size:
                    return
                start += count
        except _FAULTS as error:
            raise SceneError(_message(source, error)) from error


def _chunk(source: Source, layer: str, start: int, size: int) -> tuple[Raw, int]:
    """Features start .. start + size, and how many there were."""
    # OSM files have no index: skipping would parse the file afresh for every chunk
    whole = source.path.suffix.lower() in (".pbf", ".osm")
    meta, fids, wkb, columns = pyogrio.raw.read(
        source.path,
        layer=layer,
        where=source.where,
        skip_features=start,
        max_features=None if whole else size,
        force_2d=True,
        return_fids=True,
    )
    if wkb is None:
        raise SceneError(f"{source.path} has no geometry in layer {layer}: give one with polygons")
    labels = [f"feature {fid}" for fid in fids]
    geometries, dropped, repaired = _geometries(wkb, labels)
    table = pd.DataFrame(dict(zip(meta["fields"], columns, strict=True)), index=range(len(wkb)))
    raw = Raw(geometries, labels, table, meta["crs"], "units", dropped, repaired)
    return _without(raw, dropped), 0 if whole else len(wkb)


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


def _without(raw: Raw, dropped: list[Note]) -> Raw:
    """The chunk less the features that are noted already."""
    if not dropped:
        return raw
    gone = {which for which, _ in dropped}
    keep = [i for i, label in enumerate(raw.labels) if label not in gone]
    return Raw(
        np.asarray(raw.geometries, dtype=object)[keep],
        [raw.labels[i] for i in keep],
        None if raw.attributes is None else raw.attributes.iloc[keep].reset_index(drop=True),
        raw.crs,
        raw.units,
        raw.dropped,
        raw.repaired,
    )


def _layer(source: Source) -> str:
    layers = pyogrio.list_layers(source.path)
    known = [str(name) for name, _ in layers]
    if not known:
        raise SceneError(f"{source.path} has no layer: give a file with polygons")
    if source.layer is not None:
        if source.layer not in known:
            nearest = difflib.get_close_matches(source.layer, known, n=1)
            hint = f"did you mean {nearest[0]}?" if nearest else "it has: " + ", ".join(known)
            raise SceneError(f"{source.path} has no layer {source.layer!r}; {hint}")
        return source.layer
    for name, kind in layers:
        if kind is not None and any(word in kind for word in ("Polygon", "Surface")):
            return str(name)
    for name, kind in layers:
        if kind in ("Unknown", "GeometryCollection"):
            return str(name)
    return known[0]


def _message(source: Source, error: Exception) -> str:
    text = " ".join(str(error).split())
    if "SQL" in text and source.where is not None:
        return f"{source.path}: condition {source.where!r} is not valid: {text}"
    if "not recognized as being in a supported file format" in text:
        if source.path.is_dir():
            return f"{source.path} is a folder: give a file in it"
        kind = f"{source.path.suffix} file" if source.path.suffix else "file with geometries"
        return f"{source.path} is not a readable {kind}: it is damaged, or of an unknown format"
    return f"{source.path} cannot be read: {text.split('. It might help')[0]}"
