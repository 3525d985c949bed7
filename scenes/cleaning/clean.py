"""Any geometries in, valid polygons out; nothing left out or changed without a note.

Closed contours become filled polygons by the rules of fonts and SVG.
"""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

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


def usual_reason(reason: str) -> str:
    """Return a reason without its place.

    >>> usual_reason("self-intersects at 3.0 4.0; repaired into 2 polygons")
    'self-intersects'
    """
    return reason.split(" at ")[0].split(";")[0]


NOTES_KEPT = 1000
"""Notes of a kind that are kept with their names; all are counted by their reasons."""


@dataclass
class Noted:
    """What was done to polygons: "dropped", "repaired" or "failed".

    counts : by kind and reason, of how many; kept : by kind, the first `NOTES_KEPT` notes
    """

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    kept: dict[str, list[Note]] = field(default_factory=dict)

    def note(self, kind: str, notes: Sequence[Note], times: int = 1) -> None:
        """Count notes of a kind, each of `times` polygons, and keep the first of them."""
        for _, reason in notes:
            self.counts[kind, usual_reason(reason)] += times
        kept = self.kept.setdefault(kind, [])
        kept += notes[: NOTES_KEPT - len(kept)]

    def told(self, *kinds: str) -> list[tuple[str, str, str]]:
        """Return (kind, which, reason) of the notes that were kept of these kinds."""
        return [(kind, *note) for kind in kinds for note in self.kept.get(kind, ())]


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
    names = labels or [f"feature {index}" for index in range(len(given))]
    usable = _usable(given, names, dropped)
    parts, source = _areal_parts(given, usable, names, dropped)
    parts = shapely.force_2d(parts)
    valid = shapely.is_valid(parts)
    if not valid.all():
        parts, source = _repair(parts, source, valid, names, locate, dropped, repaired)
    with np.errstate(over="ignore"):
        area = shapely.area(parts)
    keep = (area > 0) & np.isfinite(area)
    for i in np.flatnonzero(~keep):
        reason = "area overflows: coordinates too large" if area[i] > 0 else "has no area"
        dropped.append((names[source[i]], reason))
    plain = _without_empty_holes(shapely.remove_repeated_points(parts[keep]))
    polygons, source = shapely.orient_polygons(plain), source[keep]
    # Of coordinates beyond 2^53 units, rounding decides, and turning a ring rounds otherwise.
    sound = shapely.area(polygons) > 0
    dropped += [(names[source[i]], "its area is lost in rounding") for i in np.flatnonzero(~sound)]
    return Cleaned(polygons[sound], source[sound], dropped, repaired)


def _usable(given: NDArray[Any], names: list[str], dropped: list[Note]) -> NDArray[np.int64]:
    """Indices of geometries that exist and have finite coordinates only."""
    absent = shapely.is_missing(given) | shapely.is_empty(given)
    dropped += [(names[i], "empty geometry") for i in np.flatnonzero(absent)]
    coordinates, owner = shapely.get_coordinates(given, return_index=True)
    broken = np.zeros(len(given), dtype=bool)
    broken[owner[~np.isfinite(coordinates).all(axis=1)]] = True
    dropped += [(names[i], "has a NaN or infinite coordinate") for i in np.flatnonzero(broken)]
    return np.flatnonzero(~absent & ~broken)


def _areal_parts(
    given: NDArray[Any], usable: NDArray[np.int64], names: list[str], dropped: list[Note]
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
        (names[usable[at[i]]], f"is a {parts[i].geom_type}, not a polygon")
        for i in np.flatnonzero(~areal)
    ]
    return parts[areal], usable[at[areal]]


def _repair(
    parts: NDArray[Any],
    source: NDArray[np.int64],
    valid: NDArray[np.bool_],
    names: list[str],
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
                repaired.append((names[index], f"{fault}; repaired into {len(pieces)} polygon(s)"))
            else:
                dropped.append((names[index], f"{fault}; could not be repaired"))
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


def _without_empty_holes(polygons: NDArray[Any]) -> NDArray[Any]:
    rings, owner = shapely.get_rings(polygons, return_index=True)
    empty = np.unique(owner[shapely.is_empty(rings)])
    if not len(empty):
        return polygons
    result = polygons.copy()
    for i in empty:
        holes = [hole for hole in polygons[i].interiors if not hole.is_empty]
        result[i] = shapely.Polygon(polygons[i].exterior, holes)
    return result


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


def in_rows(
    polygons: Sequence[shapely.Polygon], gap: float = 0.1, aspect: float = 1.0
) -> list[shapely.Polygon]:
    """The polygons, moved into rows from the top, in order, none touching another.

    `gap` is the space between them as a share of their mean width; `aspect` the wanted width to
    height of the whole.

    >>> row = in_rows([shapely.box(9, 9, 10, 10), shapely.box(5, 5, 6, 6)], gap=0.5, aspect=9)
    >>> [polygon.bounds for polygon in row]
    [(0.0, -1.0, 1.0, 0.0), (1.5, -1.0, 2.5, 0.0)]
    """
    if not polygons:
        return []
    bounds = shapely.bounds(np.asarray(polygons))
    sizes = bounds[:, 2:] - bounds[:, :2]
    space = gap * sizes.mean()
    width = max(np.sqrt(aspect * (sizes + space).prod(axis=1).sum()), sizes[:, 0].max())
    out, x, y, tallest = [], 0.0, 0.0, 0.0
    for polygon, (left, _, _, top), (w, h) in zip(polygons, bounds, sizes, strict=True):
        if x > 0 and x + w > width:
            x, y, tallest = 0.0, y - tallest - space, 0.0
        out.append(moved(polygon, x - left, y - top))
        x, tallest = x + w + space, max(tallest, h)
    return out


def moved(geometry: shapely.Polygon, dx: float, dy: float) -> shapely.Polygon:
    """The polygon, translated.

    >>> moved(shapely.box(0, 0, 1, 1), 2.0, 3.0).bounds
    (2.0, 3.0, 3.0, 4.0)
    """
    shifted: shapely.Polygon = shapely.transform(geometry, lambda xy: xy + np.array([dx, dy]))
    return shifted


Rule = Literal["nonzero", "evenodd"]

MOST = 200_000
"""Crossings of a ring that is repaired, into about as many polygons."""

_FEW, _MANY = 100, 1000
"""Vertices below which no polygon crosses itself often; pieces of edges of one that does."""


def filled(contours: Sequence[NDArray[Any]], rule: Rule = "nonzero") -> list[Any]:
    """The area that the contours, (n, 2) arrays without a closing point, fill together.

    Returns a list of one geometry, or none. Contours that do not cross keep their vertices; others
    are resolved, which adds vertices where they cross.

    >>> square = np.array([(0, 0), (4, 0), (4, 4), (0, 4)])
    >>> [area.area for area in filled([square, square[::-1] / 2 + 1])]
    [12.0]
    """
    rings = np.array([shapely.Polygon(c) for c in contours if len(c) >= 3], dtype=object)
    if not len(rings):
        return []
    if not shapely.is_valid(rings).all():
        return [_resolved(rings, rule)]
    if rule == "evenodd":
        # each contains itself
        _, inner = shapely.STRtree(rings).query(rings, predicate="contains")
        depth = np.bincount(inner, minlength=len(rings)) - 1
        outers, holes = rings[depth % 2 == 0], rings[depth % 2 == 1]
    else:
        outers, holes = _by_direction(rings)
    return [_nested(outers, holes) or _resolved(rings, rule)]


def _by_direction(rings: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Rings with the direction of the largest one, and rings with the opposite direction."""
    turns = shapely.is_ccw(shapely.get_exterior_ring(rings))
    along = turns == turns[np.argmax(shapely.area(rings))]
    return rings[along], rings[~along]


def _nested(outers: NDArray[Any], holes: NDArray[Any]) -> Any | None:
    """Each hole put into the smallest ring around it; None if that gives no valid geometry.

    A filled ring may lie inside a hole, as in the copyright sign.
    """
    outers = outers[np.argsort(shapely.area(outers), kind="stable")]
    around, hole = shapely.STRtree(holes).query(outers, predicate="covers")
    owner = np.full(len(holes), len(outers))
    np.minimum.at(owner, hole, around)
    if (owner == len(outers)).any():
        return None
    by_owner = np.split(
        np.argsort(owner, kind="stable"), np.cumsum(np.bincount(owner, minlength=len(outers)))[:-1]
    )
    inner = shapely.get_exterior_ring(holes)
    pairs = zip(outers, by_owner, strict=True)
    whole = shapely.MultiPolygon([shapely.Polygon(o.exterior, inner[own]) for o, own in pairs])
    return whole if whole.is_valid else None


def _resolved(rings: NDArray[Any], rule: Rule) -> Any:
    """Rings that cross, resolved: parity of cover, or cover by what runs as the largest does."""
    if rule == "evenodd":
        return even_odd(shapely.get_exterior_ring(rings))
    along, against = _by_direction(rings)
    filled_area = shapely.union_all([mended(ring) for ring in along])
    if not len(against):
        return filled_area
    return shapely.difference(filled_area, shapely.union_all([mended(ring) for ring in against]))


def mended(polygon: shapely.Polygon) -> Any:
    """What an invalid polygon covers an odd number of times.

    `shapely.make_valid`, but where a ring crosses itself so often that this would take for ever: it
    peels layer after layer, each at the cost of all crossings. Raises shapely.GEOSException where
    GEOS does, and for a ring that crosses itself more than `MOST` times.

    >>> mended(shapely.Polygon([(0, 0), (6, 8), (6, 0), (0, 8)])).area
    24.0
    """
    if shapely.get_num_coordinates(polygon) > _FEW:
        rings = shapely.get_rings(polygon)
        if _crossings(rings) > MOST:
            raise shapely.GEOSException(f"it crosses itself more than {MOST} times")
        noded = shapely.unary_union(rings)
        if shapely.get_num_geometries(noded) > _MANY:
            return even_odd(rings, noded)
    return shapely.make_valid(polygon)


def _crossings(rings: NDArray[Any]) -> float:
    """About how many times edges cross, by those that cross some of them."""
    points, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    edges = shapely.linestrings(np.stack([points[:-1][same], points[1:][same]], axis=1))
    some = edges[:: max(len(edges) // _FEW, 1)]
    found = shapely.STRtree(edges).query(some, predicate="crosses").shape[1]
    return found * len(edges) / len(some) / 2


def even_odd(rings: NDArray[Any], noded: Any | None = None) -> Any:
    """The area that lies within an odd number of rings, which may cross in any way.

    The faces between the rings are found, and a point in each; the ray from it to the right meets
    an odd number of edges or not. `noded` are the rings cut where they meet, if that is known.

    >>> even_odd(shapely.get_rings([shapely.box(0, 0, 4, 4), shapely.box(2, 2, 6, 6)])).area
    24.0
    """
    noded = shapely.unary_union(rings) if noded is None else noded
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(noded)))
    x, y = shapely.get_coordinates(shapely.point_on_surface(faces)).T
    order = np.argsort(y)
    x, y = x[order], y[order]
    odd = np.zeros(len(faces), dtype=bool)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    a, b = points[:-1][same], points[1:][same]
    upward = (a[:, 1] < b[:, 1])[:, None]
    low, high = np.where(upward, a, b), np.where(upward, b, a)
    first, last = np.searchsorted(y, low[:, 1]), np.searchsorted(y, high[:, 1])
    for (x0, y0), (x1, y1), i, j in zip(low, high, first, last, strict=True):
        if i < j:
            odd[i:j] ^= (x1 - x0) * (y[i:j] - y0) > (x[i:j] - x0) * (y1 - y0)
    return shapely.coverage_union_all(faces[order][odd])
