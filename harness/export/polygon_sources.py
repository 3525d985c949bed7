"""The polygons of a scene or a file, a part at a time, with what a writer may say of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.errors import UsageError
from scenes import load
from scenes.cleaning.projection import Projection
from scenes.files import read_chunks
from scenes.readers.reader import is_model
from scenes.registry import split


@dataclass(frozen=True)
class Part:
    """Polygons of the source that are dealt with together."""

    polygons: NDArray[Any]
    attributes: pd.DataFrame | None
    about: dict[str, Any]
    dropped: list[tuple[str, str]]
    repaired: list[tuple[str, str]]
    notes: tuple[str, ...] = ()


def parts_of(
    source: str,
    layer: str | None,
    where: str | None,
    limit: int | None,
    project: bool | None,
    size: int,
    solid: bool = False,
) -> Iterator[Part]:
    """The source's polygons, a file's in chunks, cut off after `limit`.

    `solid`: they become a 3D model. Raises UsageError where the source is one, too.
    """
    if limit is not None and limit < 1:
        raise UsageError(f"limit={limit} leaves no polygon: give 1 or more")
    name, given, is_file = split(source)
    if not is_file:
        if any(value is not None for value in (layer, where, project)):
            raise UsageError(f"layer, where and project are for files; {name} is a scene")
        whole = _of_scene(source, size)
    else:
        if solid and is_model(Path(name)):
            raise UsageError(
                f"{name} is a 3D model, whose faces would be laid flat beside each other: measure "
                f"it with `run --scene {name}`, or write its faces as .geojson, .parquet or .npz"
            )
        options = {"layer": layer, "where": where, "project": project}
        known = {**given, **{name: v for name, v in options.items() if v is not None}}
        limit = limit if limit is not None else known.pop("limit", None)
        whole = of_file(name, known, size)
    left = limit
    for part in whole:
        if left is not None and len(part.polygons) >= left:
            table = None if part.attributes is None else part.attributes.iloc[:left]
            yield replace(part, polygons=part.polygons[:left], attributes=table)
            return
        left = None if left is None else left - len(part.polygons)
        yield part


def _of_scene(source: str, size: int) -> Iterator[Part]:
    scene = load(source)
    about = {"units": scene.units, "credit": scene.credit}
    polygons = np.asarray(scene.polygons)
    for start in range(0, len(polygons), size):
        rows = slice(start, start + size)
        table = None if scene.attributes is None else scene.attributes.iloc[rows]
        notes = ([], [], ()) if start else (scene.dropped, scene.repaired, scene.notes)
        yield Part(polygons[rows], table, about, *notes)


def of_file(path: str, options: dict[str, Any], size: int) -> Iterator[Part]:
    """The polygons of a file in chunks; `options` are those of `scenes.files.read_chunks`."""
    for chunk in read_chunks(path, size=size, **options):
        about: dict[str, Any] = {"units": chunk.units, "crs": chunk.crs}
        if chunk.projection is not None:
            about["to_source"] = partial(_degrees, projection=chunk.projection)
        made = chunk.cleaned
        notes = (made.dropped, made.repaired, chunk.notes)
        yield Part(made.polygons, chunk.attributes, about, *notes)


def _degrees(metres: NDArray[np.float64], projection: Projection) -> NDArray[np.float64]:
    # eleven decimals are a micrometre, and give most sources back the very numbers they had
    return np.round(projection.inverse(metres), 11)
