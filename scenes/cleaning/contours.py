"""Closed contours to filled polygons, by the rules of fonts and SVG."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

Rule = Literal["nonzero", "evenodd"]

MOST = 200_000
"""Crossings of a ring that is repaired, into about as many polygons."""

_FEW, _MANY = 100, 1000
"""Vertices below which no polygon crosses itself often; pieces of edges of one that does."""


def filled(contours: Sequence[NDArray[Any]], rule: Rule = "nonzero") -> list[Any]:
    """The area that the contours, (n, 2) arrays without a closing point, fill together.

    Returns a list of one geometry, or none. Contours that do not cross keep their vertices; others
    are resolved, which adds vertices where they cross.
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
