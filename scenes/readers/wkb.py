"""Geometries of WKB and WKT, with notes on those that were changed or cannot be parsed."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.readers.gdal import linearize
from scenes.readers.guard import MAX_DEPTH, is_text_too_deep, is_too_deep
from scenes.scene import Note

_DEEP = f"is nested more than {MAX_DEPTH} levels deep"
UNPARSABLE = "geometry cannot be parsed"
CURVED = "has curves; replaced by chords of 4 degrees"


def parse_wkb(
    values: Sequence[bytes | None] | NDArray[Any], labels: Sequence[str]
) -> tuple[NDArray[Any], list[Note], list[Note]]:
    """Return the geometries of (E)WKB, None for those that cannot be parsed, and notes.

    The notes are those on geometries that are dropped and repaired: curves get straight edges,
    rings that are not closed are closed.

    >>> parse_wkb([None, shapely.Point(1, 2).wkb], ["a", "b"])[0].tolist()
    [None, <POINT (1 2)>]
    """
    deep = [value is not None and is_too_deep(value) for value in values]
    flat = [None if nested else value for value, nested in zip(values, deep, strict=True)]
    try:
        geometries = shapely.from_wkb(np.array([*flat, None], dtype=object), on_invalid="ignore")
    except NotImplementedError:  # one curve is enough
        geometries = np.array([*map(_parse, flat), None], dtype=object)
    geometries = geometries[:-1]
    dropped: list[Note] = []
    repaired: list[Note] = []
    for i in np.flatnonzero(shapely.is_missing(geometries)).tolist():
        if not values[i]:
            continue
        geometries[i], change = (None, _DEEP) if deep[i] else _recover(values[i])
        (dropped if geometries[i] is None else repaired).append((labels[i], change))
    return geometries, dropped, [note for note in repaired if note[1]]


def parse_wkt(text: str) -> tuple[Any | None, str]:
    """Return the geometry of WKT, or None, and how it was changed, or why it cannot be parsed."""
    if is_text_too_deep(text):
        return None, _DEEP
    try:
        geometry = shapely.from_wkt(text, on_invalid="ignore")
    except NotImplementedError:
        geometry = None
    return (geometry, "") if geometry is not None else _recover(text)


def _parse(wkb: bytes | None) -> Any | None:
    try:
        return shapely.from_wkb(wkb, on_invalid="ignore")
    except NotImplementedError:
        return None


def _recover(source: Any) -> tuple[Any | None, str]:
    """Return the geometry of WKB or WKT that GEOS does not parse, and how it was changed."""
    parse = shapely.from_wkt if isinstance(source, str) else shapely.from_wkb
    is_curved = False
    try:
        geometry = parse(source, on_invalid="fix")
    except NotImplementedError:
        geometry, is_curved = None, True
    if geometry is not None:
        return geometry, "has a ring that is not closed; closed"
    straight = linearize(source)
    geometry = None if straight is None else shapely.from_wkb(straight, on_invalid="ignore")
    if geometry is not None:
        return geometry, CURVED if is_curved else ""
    return None, f"{UNPARSABLE}: it has curves" if is_curved else UNPARSABLE
