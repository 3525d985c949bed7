"""Valid, oriented polygons of geometries, with notes on changed geometries; layout in rows."""

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity

from scenes.fill import repair_polygon
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
    """Valid, oriented, two-dimensional polygons of cleaned geometries.

    source : (p,) index of the geometry that each polygon is from
    dropped, repaired : notes on geometries that were dropped or repaired
    """

    polygons: NDArray[Any]
    source: NDArray[np.int64]
    dropped: list[Note]
    repaired: list[Note]


Locate = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""A function that maps coordinates (n, 2) to source coordinates, for locations in notes."""


def clean(
    geometries: Any, labels: list[str] | None = None, locate: Locate | None = None
) -> Cleaned:
    """Return the valid, two-dimensional, oriented polygons of geometries, with notes on others.

    `labels` name geometries in notes; `locate` maps locations in notes to source coordinates.

    >>> bow_tie = shapely.Polygon([(0, 0), (6, 8), (6, 0), (0, 8)])
    >>> cleaned = clean([shapely.box(0, 0, 1, 1), bow_tie, shapely.Point(0, 0)])
    >>> [polygon.area for polygon in cleaned.polygons], cleaned.source.tolist()
    ([1.0, 12.0, 12.0], [0, 1, 1])
    >>> cleaned.dropped, cleaned.repaired[0][0]
    ([('feature 2', 'is a Point, not a polygon')], 'feature 1')
    """
    inputs = np.asarray(geometries, dtype=object).ravel()
    dropped: list[Note] = []
    repaired: list[Note] = []
    names = labels or [f"feature {index}" for index in range(len(inputs))]
    absent = shapely.is_missing(inputs) | shapely.is_empty(inputs)
    dropped += [(names[i], "empty geometry") for i in np.flatnonzero(absent)]
    coordinates, owner = shapely.get_coordinates(inputs, return_index=True)
    infinite = np.zeros(len(inputs), dtype=bool)
    infinite[owner[~np.isfinite(coordinates).all(axis=1)]] = True
    dropped += [(names[i], "has a NaN or infinite coordinate") for i in np.flatnonzero(infinite)]
    usable = np.flatnonzero(~absent & ~infinite)
    parts, source = _split_parts(inputs, usable, names, dropped)
    parts = shapely.force_2d(parts)
    valid = shapely.is_valid(parts)
    if not valid.all():
        parts, source = _repair_invalid(parts, source, valid, names, locate, dropped, repaired)
    with np.errstate(over="ignore"):
        area = shapely.area(parts)
    usable_area = (area > 0) & np.isfinite(area)
    for i in np.flatnonzero(~usable_area):
        reason = "area overflows: coordinates too large" if area[i] > 0 else "has no area"
        dropped.append((names[source[i]], reason))
    simple = _remove_empty_holes(shapely.remove_repeated_points(parts[usable_area]))
    polygons, source = shapely.orient_polygons(simple), source[usable_area]
    # If coordinates exceed 2^53 units, an area is a rounding error, and may be negative.
    positive = shapely.area(polygons) > 0
    dropped += [(names[source[i]], "area is lost in rounding") for i in np.flatnonzero(~positive)]
    return Cleaned(polygons[positive], source[positive], dropped, repaired)


def _split_parts(
    inputs: NDArray[Any], usable: NDArray[np.int64], names: list[str], dropped: list[Note]
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return the polygons in the usable geometries, and the index of each polygon's geometry."""
    if (shapely.get_type_id(inputs[usable]) == _POLYGON).all():  # usually there is nothing to split
        return inputs[usable], usable
    parts, at = shapely.get_parts(inputs[usable], return_index=True)
    # Collections may hold multi-polygons and collections: split until only simple types remain.
    while not np.isin(shapely.get_type_id(parts), range(4)).all():
        parts, inner = shapely.get_parts(parts, return_index=True)
        at = at[inner]
    polygonal = shapely.get_type_id(parts) == _POLYGON
    dropped += [
        (names[usable[at[i]]], f"is a {parts[i].geom_type}, not a polygon")
        for i in np.flatnonzero(~polygonal)
    ]
    return parts[polygonal], usable[at[polygonal]]


def _repair_invalid(
    parts: NDArray[Any],
    source: NDArray[np.int64],
    valid: NDArray[np.bool_],
    names: list[str],
    locate: Locate | None,
    dropped: list[Note],
    repaired: list[Note],
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return valid or repaired polygons (q,), and the index (q,) of the geometry of each."""
    polygons: list[Any] = []
    owners: list[int] = []
    for part, index, is_valid in zip(parts, source, valid, strict=True):
        pieces = [part]
        if not is_valid:
            pieces = []
            with suppress(shapely.GEOSException):
                repaired_parts = shapely.get_parts(shapely.get_parts(repair_polygon(part)))
                usable = shapely.get_type_id(repaired_parts) == _POLYGON
                usable &= shapely.is_valid(repaired_parts) & (shapely.area(repaired_parts) > 0)
                pieces = list(repaired_parts[usable])
            fault = _describe_fault(part, locate)
            if pieces:
                repaired.append((names[index], f"{fault}; repaired into {len(pieces)} polygon(s)"))
            else:
                dropped.append((names[index], f"{fault}; could not be repaired"))
        polygons.extend(pieces)
        owners.extend([index] * len(pieces))
    return np.array(polygons, dtype=object), np.array(owners, dtype=np.int64)


def _remove_empty_holes(polygons: NDArray[Any]) -> NDArray[Any]:
    """Return polygons without holes that became empty when repeated points were removed."""
    rings, owner = shapely.get_rings(polygons, return_index=True)
    empty = np.unique(owner[shapely.is_empty(rings)])
    if not len(empty):
        return polygons
    result = polygons.copy()
    for i in empty:
        holes = [hole for hole in polygons[i].interiors if not hole.is_empty]
        result[i] = shapely.Polygon(polygons[i].exterior, holes)
    return result


def _describe_fault(part: shapely.Polygon, locate: Locate | None) -> str:
    """Return why a polygon is invalid, for a note: "self-intersects at 3.0 4.0"."""
    text = shapely.is_valid_reason(part)
    match = re.fullmatch(r"(.*?)\[(.*)\]", text)
    reason, location = match.groups() if match else (text, "")
    phrase = _REASONS.get(reason, f"is invalid ({reason})")
    numbers = [float(number) for number in location.split()]
    if locate is not None and len(numbers) == 2:
        numbers = np.round(locate(np.array([numbers]))[0], 9).tolist()
    return f"{phrase} at {' '.join(map(str, numbers))}" if numbers else phrase


def arrange_in_rows(polygons: Sequence[shapely.Polygon], gap: float = 0.1) -> list[shapely.Polygon]:
    """Return the polygons, translated into rows: from the top, in order, without touching.

    `gap` is the space between polygons as a share of the mean width.

    >>> rows = arrange_in_rows([shapely.box(9, 9, 11, 10), shapely.box(5, 5, 6, 6)], 0.5)
    >>> [polygon.bounds for polygon in rows]
    [(0.0, -1.0, 2.0, 0.0), (0.0, -2.625, 1.0, -1.625)]
    """
    if not polygons:
        return []
    bounds = shapely.bounds(np.asarray(polygons))
    sizes = bounds[:, 2:] - bounds[:, :2]
    space = gap * sizes.mean()
    width = max(np.sqrt((sizes + space).prod(axis=1).sum()), sizes[:, 0].max())
    arranged, x, y, row_height = [], 0.0, 0.0, 0.0
    for polygon, (min_x, _, _, max_y), (w, h) in zip(polygons, bounds, sizes, strict=True):
        if x > 0 and x + w > width:
            x, y, row_height = 0.0, y - row_height - space, 0.0
        arranged.append(affinity.translate(polygon, x - min_x, y - max_y))
        x, row_height = x + w + space, max(row_height, h)
    return arranged
