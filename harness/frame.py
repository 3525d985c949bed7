"""A scene mapped to a viewport: polygons in pixels, y up, on the 1/256 px grid.

GPUs and software rasterisers alike snap window coordinates to a sub-pixel grid, usually of
1/256 px. Snapping here, before anything is triangulated, makes the geometry that the criteria
see the geometry that is rasterised, and makes every orientation test on it exact.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from harness.errors import UsageError
from harness.settings import RESOLUTIONS, Fit
from scenes.scene import Scene, Tiling, Viewing

SUBPIXEL = 256
"""Sub-pixel positions per pixel and axis."""

MARGIN_PX = 1.0
"""Kept free at each side: geometry that is clipped has its seam quads counted twice."""

MARGIN_STEP_PX = 64
"""Of the margin round a tile, so that quads, blocks and bins lie as if the viewport began there."""

OWN_VIEWS = {"tile": "map tiles", "view": "a model's views"}
"""Fits of scenes that bring their view along, and what these are of."""

ITS_OWN_VIEW = "pixels= is the resolution of {}: leave --sizes, --resolution, --rotation, --fit out"

WHOLE = np.array([-(2**30), -(2**30), 2**30, 2**30], np.int64)
"""The window of a frame that nothing cuts."""


@dataclass(frozen=True)
class View:
    """How a scene is laid on the viewport.

    resolution : width and height of the viewport in pixels
    rotation : degrees, counter-clockwise, about the scene's centre
    fit : "box" fills the viewport with the rotated scene's bounding box; "circle" with its
        enclosing circle, so that the scale is the same at every rotation; "tile" is that of map
        tiles, whose polygons are in pixels already: `resolution` is then a tile's side; "view" that
        of a model in space, of which each view is a picture of that side
    """

    resolution: int = 1024
    rotation: float = 0.0
    fit: Fit = "box"

    def __post_init__(self) -> None:
        least, most = RESOLUTIONS
        if not least <= self.resolution <= most:
            raise UsageError(f"resolution {self.resolution} is outside {least}..{most} pixels")
        if not math.isfinite(self.rotation):
            raise UsageError(f"rotation {self.rotation} is not a finite number of degrees")
        if self.fit in OWN_VIEWS and (self.rotation or self.resolution % 2):
            raise UsageError(
                f"a {self.fit} is drawn upright, and its side is an even number of pixels"
            )


@dataclass(frozen=True)
class Frame:
    """Polygons in pixels, ready to be triangulated and drawn: arrays alone, cheap to send.

    width, height : pixels
    scale : pixels per scene unit
    source : (p,) int64, for each polygon its number in the scene
    points : (n, 2) int32, all polygons' vertices one after another, in 1/256 px
    offsets : (p + 1,) int64; polygon k owns points[offsets[k]:offsets[k + 1]]
    ring_ends : (r,) int64, where in `points` each ring ends; the first ring of a polygon is its
        exterior, the others are its holes
    dropped, repaired : (polygon number in the scene, reason) of what snapping broke
    scissor : left, bottom, width, height in pixels, all even, of what is drawn; None for all
    tiles : (t + 1,) int64; polygons tiles[k]:tiles[k + 1] are drawn by one call, over those of
        other tiles or views; None where one call draws all
    flat, viewing : of a frame that shows a model in space: the frame of its faces, each in its own
        plane, where they are triangulated, and how they are seen
    """

    width: int
    height: int
    scale: float
    view: View
    source: NDArray[np.int64]
    points: NDArray[np.int32]
    offsets: NDArray[np.int64]
    ring_ends: NDArray[np.int64]
    dropped: tuple[tuple[int, str], ...] = ()
    repaired: tuple[tuple[int, str], ...] = ()
    scissor: tuple[int, int, int, int] | None = None
    tiles: NDArray[np.int64] | None = None
    flat: "Frame | None" = None
    viewing: Viewing | None = None

    @property
    def window(self) -> NDArray[np.int64]:
        """First column and row, last column and row of the pixels that are drawn."""
        if self.scissor is None:
            return WHOLE
        left, bottom, width, height = self.scissor
        return np.array([left, bottom, left + width - 1, bottom + height - 1], np.int64)

    @property
    def depths(self) -> NDArray[np.int32] | None:
        """(n,) depths of the points, 0 to 2**24, where what is hidden is not drawn; else None."""
        return None if self.viewing is None else self.viewing.depths

    @cached_property
    def polygons(self) -> tuple[Polygon, ...]:
        """The p polygons in px; coordinates are multiples of 1/256 px inside the viewport."""
        ends = self.ring_ends
        starts = np.concatenate([[0], ends[:-1]])
        # shapely repeats each ring's first vertex at its end
        closed = np.insert(np.arange(len(self.points)), ends, starts)
        rings = np.concatenate([[0], ends + np.arange(1, len(ends) + 1)])
        owners = np.searchsorted(np.concatenate([[0], ends]), self.offsets)
        made = shapely.from_ragged_array(
            shapely.GeometryType.POLYGON, self.points[closed] / SUBPIXEL, (rings, owners)
        )
        return tuple(made)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what follows from the rest, and is slow to send to another process."""
        return {name: value for name, value in vars(self).items() if name != "polygons"}

    def owner(self, triangles: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the (m,) number of the polygon each row of `triangles` (m, 3) belongs to."""
        first = triangles[:, 0]
        return (np.searchsorted(self.offsets, first, side="right") - 1).astype(np.int32)

    def draws(self, triangles: NDArray[np.int32]) -> list[slice]:
        """Return the rows of `triangles` (m, 3), in the tiles' order, that each call draws."""
        if self.tiles is None:
            return [slice(0, len(triangles))]
        bounds = np.searchsorted(self.owner(triangles), self.tiles)
        return [slice(*pair) for pair in pairwise(bounds.tolist())]

    def join(self, triangulations: Sequence[NDArray[np.int32] | None]) -> NDArray[np.int32]:
        """Concatenate one (m_k, 3) triangulation a polygon into one over `points`.

        None leaves the polygon out.
        """
        parts = [
            part + np.int32(start)
            for part, start in zip(triangulations, self.offsets[:-1], strict=True)
            if part is not None
        ]
        if not parts:
            return np.empty((0, 3), np.int32)
        return np.ascontiguousarray(np.concatenate(parts), np.int32)


def bare_frame(resolution: int, points: NDArray[np.int32], corners: int | None = None) -> Frame:
    """Return a frame of `points` (n, 2) in 1/256 px: polygons of `corners` each, or only one,
    none of which has a hole.
    """
    offsets = np.arange(0, len(points) + 1, corners or len(points), dtype=np.int64)
    return frame_as_it_is(resolution, points, offsets, offsets[1:])


def frame_as_it_is(
    resolution: int,
    points: NDArray[np.int32],
    offsets: NDArray[np.int64],
    ring_ends: NDArray[np.int64],
) -> Frame:
    """Return a frame of polygons that are in the viewport and on the grid already."""
    source = np.arange(len(offsets) - 1, dtype=np.int64)
    return Frame(resolution, resolution, 1.0, View(resolution), source, points, offsets, ring_ends)


def frame_of(scene: Scene, view: View) -> Frame:
    """Map a scene's polygons to the viewport of `view` and snap them.

    Raises
    ------
    UsageError
        if the view is not the scene's: tiles and models have their own
    """
    own = view_of(scene).fit
    if view.fit != own and own in OWN_VIEWS:
        raise UsageError(f"{scene.name}: {ITS_OWN_VIEW.format(OWN_VIEWS[own])}")
    if scene.tiling is not None:
        return _tiled(scene, scene.tiling, view)
    if scene.viewing is not None:
        return _seen(scene, scene.viewing, view)
    return make_frame(scene.polygons, view)


def view_of(scene: Scene) -> View:
    """Return how a scene is drawn if nothing else is asked for."""
    if scene.tiling is not None:
        return View(scene.tiling.pixels, fit="tile")
    return View() if scene.viewing is None else View(scene.viewing.pixels, fit="view")


def _seen(scene: Scene, viewing: Viewing, view: View) -> Frame:
    """Lay all views of a model on each other."""
    frame = frame_as_it_is(viewing.pixels, viewing.points, viewing.offsets, viewing.ring_ends)
    flat = frame_as_it_is(RESOLUTIONS[1], *on_grid(scene.polygons))
    source, tiles = viewing.source, viewing.first
    return replace(frame, view=view, source=source, tiles=tiles, flat=flat, viewing=viewing)


def _tiled(scene: Scene, tiling: Tiling, view: View) -> Frame:
    """Lay all tiles on each other in a viewport that holds their buffers, too."""
    bounds = shapely.total_bounds(np.array(scene.polygons, dtype=object))
    reach = float(max(-bounds[:2].min(), bounds[2:].max() - tiling.pixels, 0.0))
    margin = -(-math.ceil(reach) // MARGIN_STEP_PX) * MARGIN_STEP_PX
    moved = shapely.transform(np.array(scene.polygons, dtype=object), lambda xy: xy + margin)
    frame = _snapped(moved, 1.0, view, tiling.pixels + 2 * margin)
    tiles = np.searchsorted(frame.source, tiling.first)
    return replace(frame, scissor=(margin, margin, tiling.pixels, tiling.pixels), tiles=tiles)


def make_frame(polygons: Sequence[Polygon], view: View) -> Frame:
    """Map polygons (scene units, y up) to the viewport of `view` and snap them.

    Raises
    ------
    UsageError
        if there is no polygon, or they have no extent
    """
    if not polygons:
        raise UsageError("the scene has no polygon to draw")
    return _snapped(*_place(polygons, view), view, view.resolution)


def _snapped(placed: Iterable[Polygon], scale: float, view: View, side: int) -> Frame:
    """Snap polygons in pixels of a viewport of `side` px."""
    kept: list[Polygon] = []
    source: list[int] = []
    dropped: list[tuple[int, str]] = []
    repaired: list[tuple[int, str]] = []
    for number, polygon in enumerate(placed):
        pieces, reason = snap(polygon)
        if reason:
            (repaired if pieces else dropped).append((number, reason))
        kept.extend(pieces)
        source.extend([number] * len(pieces))
    numbers = np.array(source, np.int64)
    frame = Frame(side, side, scale, view, numbers, *on_grid(kept))
    return replace(frame, dropped=tuple(dropped), repaired=tuple(repaired))


def on_coarser_grid(points: NDArray[np.int32], step: int) -> NDArray[np.int32]:
    """Return (n, 2) points in 1/256 px on the nearest multiples of `step`."""
    return ((points + step // 2) // step * step).astype(np.int32)


def on_grid(
    polygons: Sequence[Polygon],
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int64]]:
    """Return `Frame.points`, `Frame.offsets` and `Frame.ring_ends` of polygons in px."""
    from triangulators.polygon import rings_of  # compiled code, which a plan can do without

    parts = [rings_of(polygon) for polygon in polygons]
    offsets = np.cumsum([0, *(len(points) for points, _ in parts)], dtype=np.int64)
    if not parts:
        return np.empty((0, 2), np.int32), offsets, np.empty(0, np.int64)
    points = np.rint(np.concatenate([points for points, _ in parts]) * SUBPIXEL).astype(np.int32)
    ends = [ends + start for (_, ends), start in zip(parts, offsets, strict=False)]
    return points, offsets, np.concatenate(ends).astype(np.int64)


def _place(polygons: Sequence[Polygon], view: View) -> tuple[list[Polygon], float]:
    """Rotate, scale and centre; returns the polygons in px and the scale in px per unit."""
    west, south, east, north = shapely.total_bounds(np.array(polygons, dtype=object))
    centre = np.array([(west + east) / 2, (south + north) / 2])
    angle = math.radians(view.rotation)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    if view.rotation % 90 == 0:
        turn = np.rint(turn)
    moved = shapely.transform(np.array(polygons, dtype=object), lambda xy: (xy - centre) @ turn.T)
    low_x, low_y, high_x, high_y = shapely.total_bounds(moved)
    if view.fit == "circle":
        coordinates = shapely.get_coordinates(moved)
        shift = np.zeros(2)
        extent = 2 * float(np.sqrt((coordinates**2).sum(axis=1)).max())
    else:
        shift = np.array([(low_x + high_x) / 2, (low_y + high_y) / 2])
        extent = float(max(high_x - low_x, high_y - low_y))
    if not (math.isfinite(extent) and extent > 0):
        raise UsageError("the scene's polygons have no extent")
    scale = (view.resolution - 2 * MARGIN_PX) / extent
    middle = view.resolution / 2
    return list(shapely.transform(moved, lambda xy: (xy - shift) * scale + middle)), scale


def snap(polygon: Polygon) -> tuple[list[Polygon], str]:
    """Round one polygon in px to the grid; repair it where that breaks it.

    Returns its pieces, and what was done to get them, or why there are none; "" where it is whole.
    """
    rounded, lost = _round_rings(polygon)
    if rounded is not None and rounded.is_valid and rounded.area > 0:
        reason = f"{lost} vertices coincide on the 1/256 px grid" if lost else ""
        return [shapely.orient_polygons(rounded)], reason
    # Rounding made edges cross or touch: let GEOS node it on the same grid.
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
    """Round the rings and merge neighbours that coincide.

    Returns the polygon, or None if its exterior collapses, and the number of vertices lost.
    """
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
