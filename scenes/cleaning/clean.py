"""Any geometries in, valid polygons out; nothing left out or changed without a note."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.cleaning.contours import mended
from scenes.scene import Note

_POLYGON = shapely.GeometryType.POLYGON
_REASONS = {
    "Self-intersection": "self-intersects",
    "Ring Self-intersection": "touches itself",
    "Hole lies outside shell": "has a hole outside its exterior ring",
    "Nested holes": "has nested holes",
    "Holes are nested": "has nested holes",
    "Interior is disconnected": "has a disconnected interior",
    "Too few points in geometry component": "has a ring of too few distinct vertices",
    "Duplicate Rings": "has a duplicate ring",
}


@dataclass(frozen=True)
class Cleaned:
    """Valid, oriented, two-dimensional polygons, and for each the index of its geometry."""

    polygons: NDArray[Any]
    source: NDArray[np.int64]
    dropped: list[Note]
    repaired: list[Note]


Locate = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Takes (n, 2) coordinates back to those of the source, so that a user finds the place."""


def clean(
    geometries: Any, labels: list[str] | None = None, locate: Locate | None = None
) -> Cleaned:
    """Explode, flatten, repair and orient.

    `geometries` is a sequence of shapely geometries or None; `labels` name them in the notes
    ("feature 0", "feature 1", ... unless given). Each part of a multi-polygon becomes a polygon.
    An invalid polygon is repaired with `shapely.make_valid`; what then has no area is dropped. If
    the geometries were projected, `locate` leads back: notes then give the source's places.

    >>> bow_tie = shapely.Polygon([(0, 0), (6, 8), (6, 0), (0, 8)])
    >>> cleaned = clean([shapely.box(0, 0, 1, 1), bow_tie, shapely.Point(0, 0)])
    >>> [polygon.area for polygon in cleaned.polygons], cleaned.source.tolist()
    ([1.0, 12.0, 12.0], [0, 1, 1])
    >>> cleaned.dropped, cleaned.repaired[0][0]
    ([('feature 2', 'is a Point, not a polygon')], 'feature 1')
    """
    given = np.asarray(geometries, dtype=object).ravel()
    dropped: list[Note] = []
    repaired: list[Note] = []

    def label(index: int) -> str:
        return labels[index] if labels is not None else f"feature {index}"

    usable = _usable(given, label, dropped)
    parts, source = _areal_parts(given, usable, label, dropped)
    parts = shapely.force_2d(parts)
    valid = shapely.is_valid(parts)
    if not valid.all():
        parts, source = _repair(parts, source, valid, label, locate, dropped, repaired)
    with np.errstate(over="ignore"):
        area = shapely.area(parts)
    keep = (area > 0) & np.isfinite(area)
    for i in np.flatnonzero(~keep):
        reason = "area overflows: coordinates too large" if area[i] > 0 else "has no area"
        dropped.append((label(source[i]), reason))
    polygons, source = _oriented(_without_repeats(parts[keep])), source[keep]
    # Of coordinates beyond 2^53 units, rounding decides, and turning a ring rounds otherwise.
    sound = shapely.area(polygons) > 0
    dropped += [(label(source[i]), "its area is lost in rounding") for i in np.flatnonzero(~sound)]
    return Cleaned(polygons[sound], source[sound], dropped, repaired)


def _usable(given: NDArray[Any], label: Any, dropped: list[Note]) -> NDArray[np.int64]:
    """Indices of geometries that exist and have finite coordinates only."""
    absent = shapely.is_missing(given) | shapely.is_empty(given)
    dropped += [(label(i), "empty geometry") for i in np.flatnonzero(absent)]
    coordinates, owner = shapely.get_coordinates(given, return_index=True)
    broken = np.zeros(len(given), dtype=bool)
    broken[owner[~np.isfinite(coordinates).all(axis=1)]] = True
    dropped += [(label(i), "has a NaN or infinite coordinate") for i in np.flatnonzero(broken)]
    return np.flatnonzero(~absent & ~broken)


def _areal_parts(
    given: NDArray[Any], usable: NDArray[np.int64], label: Any, dropped: list[Note]
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Single polygons of the usable geometries, and the index of each one's geometry."""
    if (shapely.get_type_id(given[usable]) == _POLYGON).all():  # the usual case, at no cost
        return given[usable], usable
    parts, at = shapely.get_parts(given[usable], return_index=True)
    # collections may hold multi-polygons (and collections), so explode until nothing changes
    while not np.isin(shapely.get_type_id(parts), range(4)).all():
        parts, inner = shapely.get_parts(parts, return_index=True)
        at = at[inner]
    areal = shapely.get_type_id(parts) == _POLYGON
    dropped += [
        (label(usable[at[i]]), f"is a {parts[i].geom_type}, not a polygon")
        for i in np.flatnonzero(~areal)
    ]
    return parts[areal], usable[at[areal]]


def _repair(
    parts: NDArray[Any],
    source: NDArray[np.int64],
    valid: NDArray[np.bool_],
    label: Any,
    locate: Locate | None,
    dropped: list[Note],
    repaired: list[Note],
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Replace each invalid polygon, in place, by the polygons that `make_valid` finds in it."""
    out: list[Any] = []
    owners: list[int] = []
    for part, index, good in zip(parts, source, valid, strict=True):
        pieces = [part] if good else _valid_pieces(part)
        if not good:
            fault = _fault(part, locate)
            if pieces:
                repaired.append((label(index), f"{fault}; repaired into {len(pieces)} polygon(s)"))
            else:
                dropped.append((label(index), f"{fault}; could not be repaired"))
        out.extend(pieces)
        owners.extend([index] * len(pieces))
    return np.array(out, dtype=object), np.array(owners, dtype=np.int64)


def _valid_pieces(part: shapely.Polygon) -> list[shapely.Polygon]:
    try:
        pieces = shapely.get_parts(shapely.get_parts(mended(part)))
    except shapely.GEOSException:
        return []
    areal = shapely.get_type_id(pieces) == _POLYGON
    return list(pieces[areal & shapely.is_valid(pieces) & (shapely.area(pieces) > 0)])


def _without_repeats(polygons: NDArray[Any]) -> NDArray[Any]:
    """The same polygons, a vertex that follows itself kept once and empty holes left out.

    Not `shapely.remove_repeated_points`, which also merges vertices whose distance underflows.
    """
    coordinates, owner = shapely.get_coordinates(polygons, return_index=True)
    same = (coordinates[1:] == coordinates[:-1]).all(axis=1) & (owner[1:] == owner[:-1])
    doubtful = shapely.get_num_interior_rings(polygons) > 0
    doubtful[owner[1:][same]] = True
    if not doubtful.any():  # nearly always, and ten times as fast
        return polygons
    result = polygons.copy()
    result[doubtful] = _rings_without_repeats(polygons[doubtful])
    return result


def _rings_without_repeats(polygons: NDArray[Any]) -> NDArray[Any]:
    """The same for polygons that may have repeats or holes."""
    kind, coordinates, (rings, owners) = shapely.to_ragged_array(polygons)
    if (np.diff(rings) == 0).any():
        return _rings_without_repeats(np.array([_without_empty_holes(p) for p in polygons]))
    repeat = np.zeros(len(coordinates), dtype=bool)
    repeat[1:] = (coordinates[1:] == coordinates[:-1]).all(axis=1)
    repeat[rings[:-1]] = False
    if not repeat.any():
        return polygons
    kept = np.concatenate([[0], np.cumsum(~repeat)])
    return shapely.from_ragged_array(kind, coordinates[~repeat], (kept[rings], owners))


def _oriented(polygons: NDArray[Any]) -> NDArray[Any]:
    """The same polygons, exteriors counter-clockwise and holes clockwise."""
    wrong = ~shapely.is_ccw(shapely.get_exterior_ring(polygons))
    wrong |= shapely.get_num_interior_rings(polygons) > 0
    result = polygons.copy()
    result[wrong] = shapely.orient_polygons(polygons[wrong])
    return result


def _without_empty_holes(polygon: shapely.Polygon) -> shapely.Polygon:
    holes = [hole for hole in polygon.interiors if not hole.is_empty]
    return shapely.Polygon(polygon.exterior, holes)


def _fault(part: shapely.Polygon, locate: Locate | None) -> str:
    """The reason GEOS gives for invalidity, as a phrase: "self-intersects at 3.0 4.0"."""
    text = shapely.is_valid_reason(part)
    match = re.fullmatch(r"(.*?)\[(.*)\]", text)
    reason, place = match.groups() if match else (text, "")
    phrase = _REASONS.get(reason, f"is invalid ({reason})")
    numbers = [float(number) for number in place.split()]
    if locate is not None and len(numbers) == 2:
        numbers = np.round(locate(np.array([numbers]))[0], 9).tolist()
    return f"{phrase} at {' '.join(map(str, numbers))}" if numbers else phrase
