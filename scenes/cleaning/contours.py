"""Closed contours to filled polygons, by the rules of fonts and SVG."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

Rule = Literal["nonzero", "evenodd"]


def filled(contours: Sequence[NDArray[Any]], rule: Rule = "nonzero") -> list[Any]:
    """The area that the contours, (n, 2) arrays without a closing point, fill together.

    Returns a list of one geometry, or none. Contours that do not cross keep their vertices; others
    are resolved, which adds vertices where they cross.
    """
    rings = [shapely.Polygon(c) for c in contours if len(c) >= 3]
    if not rings:
        return []
    if not all(ring.is_valid for ring in rings):
        return [_resolved(rings, rule)]
    if rule == "evenodd":
        depth = [sum(other.contains(ring) for other in rings) % 2 for ring in rings]
        outers = [r for r, d in zip(rings, depth, strict=True) if d == 0]
        holes = [r for r, d in zip(rings, depth, strict=True) if d == 1]
    else:
        outers, holes = _by_direction(rings)
    return [_nested(outers, holes) or _resolved(rings, rule)]


def _by_direction(rings: list[Any]) -> tuple[list[Any], list[Any]]:
    """Rings with the direction of the largest one, and rings with the opposite direction."""
    largest = max(rings, key=lambda ring: ring.area).exterior.is_ccw
    along = [r for r in rings if r.exterior.is_ccw == largest]
    return along, [r for r in rings if r.exterior.is_ccw != largest]


def _nested(outers: list[Any], holes: list[Any]) -> Any | None:
    """Each hole put into the smallest ring around it; None if that gives no valid geometry.

    A filled ring may lie inside a hole, as in the copyright sign.
    """
    outers = sorted(outers, key=lambda ring: ring.area)
    owned: list[list[Any]] = [[] for _ in outers]
    for hole in holes:
        around = [k for k, outer in enumerate(outers) if outer.covers(hole)]
        if not around:
            return None
        owned[around[0]].append(hole.exterior)
    pairs = zip(outers, owned, strict=True)
    whole = shapely.MultiPolygon([shapely.Polygon(o.exterior, inner) for o, inner in pairs])
    return whole if whole.is_valid else None


def _resolved(rings: list[Any], rule: Rule) -> Any:
    """Rings that cross, resolved: parity of cover, or cover by what runs as the largest does."""
    sound = shapely.make_valid(np.array(rings, dtype=object))
    if rule == "evenodd":
        return functools.reduce(shapely.symmetric_difference, sound)
    along, against = _by_direction(rings)
    filled_area = shapely.union_all(shapely.make_valid(np.array(along, dtype=object)))
    if not against:
        return filled_area
    cut = shapely.union_all(shapely.make_valid(np.array(against, dtype=object)))
    return shapely.difference(filled_area, cut)
