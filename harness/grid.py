"""Snapping of polygons in pixels to the grid of 1/256 px.

GPUs and software rasterisers snap vertices to such a grid. The harness does so before the
triangulation: criteria evaluate the drawn geometry, and all orientation tests are exact.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from triangulators.polygon_arrays import PolygonArray

SUBPIXEL = 256  # sub-pixel positions per pixel and axis


class Snapped(NamedTuple):
    """Polygons on the grid.

    pieces : (q,) shapely polygons in px, valid and oriented
    source : (q,) number of the polygon from which each piece results
    dropped, repaired : (polygon number, reason) of polygons that snapping broke
    """

    pieces: NDArray[np.object_]
    source: NDArray[np.int64]
    dropped: tuple[tuple[int, str], ...]
    repaired: tuple[tuple[int, str], ...]


def snap_polygons(polygons: Sequence[Polygon] | NDArray[Any]) -> Snapped:
    """Snap polygons in px; repair or drop those that snapping breaks, and round others together."""
    before = np.asarray(polygons, dtype=object)
    rounded = shapely.transform(before, lambda xy: np.rint(xy * SUBPIXEL) / SUBPIXEL)
    sound = shapely.is_valid(rounded) & (shapely.area(rounded) > 0)
    distinct = shapely.remove_repeated_points(rounded[sound])
    count_points = shapely.get_num_coordinates
    sound[sound] = count_points(distinct) == count_points(rounded[sound])
    pieces: list[Polygon] = []
    source: list[int] = []
    dropped: list[tuple[int, str]] = []
    repaired: list[tuple[int, str]] = []
    for number in np.flatnonzero(~sound).tolist():
        parts, reason = snap_polygon(before[number])
        (repaired if parts else dropped).append((number, reason))
        pieces += parts
        source += [number] * len(parts)
    oriented = shapely.orient_polygons(rounded[sound])
    snapped = np.concatenate([oriented, np.array(pieces, dtype=object)])
    numbers = np.concatenate([np.flatnonzero(sound), np.array(source, dtype=np.int64)])
    order = np.argsort(numbers, kind="stable")
    return Snapped(snapped[order], numbers[order], tuple(dropped), tuple(repaired))


def snap_polygon(polygon: Polygon) -> tuple[list[Polygon], str]:
    """Round a polygon in px to the grid, and repair the polygon if rounding makes it invalid.

    Returns the pieces, and why the polygon changed or vanished; "" if it keeps all vertices.
    """
    rounded, lost = _round_rings(polygon)
    if rounded is not None and rounded.is_valid and rounded.area > 0:
        reason = f"{lost} vertices coincide on the 1/256 px grid" if lost else ""
        return [shapely.orient_polygons(rounded)], reason
    # Rounding made edges cross or touch; GEOS adds vertices at crossings, on the same grid.
    fixed = shapely.set_precision(polygon, 1 / SUBPIXEL)
    pieces = [
        shapely.orient_polygons(part)
        for part in shapely.get_parts(fixed)
        if isinstance(part, Polygon) and part.area > 0
    ]
    if not pieces:
        return [], "thinner than the 1/256 px grid: it vanishes"
    into = f" into {len(pieces)} pieces" if len(pieces) > 1 else ""
    return pieces, f"edges cross on the 1/256 px grid; repaired{into}"


def _round_rings(polygon: Polygon) -> tuple[Polygon | None, int]:
    """Round rings, merge coincident neighbours, drop collapsing holes; count the lost vertices."""
    before = shapely.get_num_coordinates(polygon)
    rings = []
    for position, ring in enumerate([polygon.exterior, *polygon.interiors]):
        grid = np.rint(shapely.get_coordinates(ring)[:-1] * SUBPIXEL)
        grid = grid[(grid != np.roll(grid, 1, axis=0)).any(axis=1)]
        if len(grid) >= 3:
            rings.append(grid / SUBPIXEL)
        elif position == 0:
            return None, before
    result = Polygon(rings[0], rings[1:])
    return result, int(before - shapely.get_num_coordinates(result))


def to_grid(polygons: Sequence[Polygon] | NDArray[Any]) -> PolygonArray:
    """Return polygons in px as int32 coordinates in 1/256 px."""
    arrays = PolygonArray.from_shapely(polygons)
    return replace(arrays, coords=np.rint(arrays.coords * SUBPIXEL).astype(np.int32))


def round_points(points: NDArray[np.int32], step: int) -> NDArray[np.int32]:
    """Round points (n, 2) in 1/256 px to the nearest multiples of `step`."""
    return ((points + step // 2) // step * step).astype(np.int32)
