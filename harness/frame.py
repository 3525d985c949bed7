"""A scene mapped to a viewport: polygons in pixels, y up, on the 1/256 px grid."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from harness.errors import InputError, UsageError, unknown
from harness.grid import SUBPIXEL, snap_polygons, to_grid
from harness.settings import FITS, RESOLUTIONS, Fit
from harness.viewing import Viewing, viewing_of
from scenes.scene import Scene, Tiling
from triangulators.polygon_arrays import PolygonArray

MARGIN_PX = 1.0
"""Kept free at each side: geometry that is clipped has its seam quads counted twice."""

MARGIN_STEP_PX = 64
"""Of the margin round a tile, so that quads, blocks and bins lie as if the viewport began there."""

OWN_VIEWS = {"tile": "map tiles", "view": "a model's views"}
"""Fits of scenes that bring their view along, and what these are of."""

ITS_OWN_VIEW = "pixels= is the resolution of {}: leave --sizes, --resolution, --rotation, --fit out"

UNBOUNDED = np.array([-(2**30), -(2**30), 2**30, 2**30], np.int64)
"""The window of a frame that nothing cuts."""


@dataclass(frozen=True, order=True)
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
        if self.fit not in FITS:
            raise unknown("fit", self.fit, FITS)
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
    grid : the p polygons, int32 coordinates in 1/256 px
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
    grid: PolygonArray
    dropped: tuple[tuple[int, str], ...] = ()
    repaired: tuple[tuple[int, str], ...] = ()
    scissor: tuple[int, int, int, int] | None = None
    tiles: NDArray[np.int64] | None = None
    flat: "Frame | None" = None
    viewing: Viewing | None = None

    @property
    def points(self) -> NDArray[np.int32]:
        """(n, 2) int32, all polygons' vertices one after another, in 1/256 px."""
        return self.grid.coords

    @property
    def window(self) -> NDArray[np.int64]:
        """First column and row, last column and row of the pixels that are drawn."""
        if self.scissor is None:
            return UNBOUNDED
        left, bottom, width, height = self.scissor
        return np.array([left, bottom, left + width - 1, bottom + height - 1], np.int64)

    @property
    def depths(self) -> NDArray[np.int32] | None:
        """(n,) depths of the points, 0 to 2**24, or None without a depth test."""
        return None if self.viewing is None else self.viewing.depths

    @cached_property
    def polygons(self) -> PolygonArray:
        """The p polygons in px; coordinates are multiples of 1/256 px inside the viewport."""
        return replace(self.grid, coords=self.grid.coords / SUBPIXEL)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what follows from the rest, and is slow to send to another process."""
        return {name: value for name, value in vars(self).items() if name != "polygons"}

    def with_points(self, points: NDArray[np.int32]) -> "Frame":
        """Return the frame with other (n, 2) points in 1/256 px for the same vertices."""
        return replace(self, grid=replace(self.grid, coords=points))

    def owner(self, triangles: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the (m,) number of the polygon each row of `triangles` (m, 3) belongs to."""
        first = np.searchsorted(self.grid.vertex_offsets, triangles[:, 0], side="right")
        return (first - 1).astype(np.int32)

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
        starts = self.grid.vertex_offsets[:-1]
        parts = [
            part + np.int32(start)
            for part, start in zip(triangulations, starts, strict=True)
            if part is not None
        ]
        if not parts:
            return np.empty((0, 3), np.int32)
        return np.ascontiguousarray(np.concatenate(parts), np.int32)


def bare_frame(resolution: int, points: NDArray[np.int32], vertices: int | None = None) -> Frame:
    """Return a frame of `points` (n, 2) in 1/256 px: polygons without holes of so many vertices.

    vertices : of each polygon; None for one polygon of all points
    """
    grid = PolygonArray.of_single_rings(points, vertices or len(points))
    return frame_of_grid(resolution, grid)


def frame_of_grid(resolution: int, grid: PolygonArray) -> Frame:
    """Return a frame of polygons that are in the viewport and on the grid already."""
    source = np.arange(len(grid), dtype=np.int64)
    return Frame(resolution, resolution, 1.0, View(resolution), source, grid)


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
        return _frame_of_tiles(scene, scene.tiling, view)
    viewing = viewing_of(scene)
    if viewing is not None:
        return _frame_of_views(scene, viewing, view)
    return make_frame(scene.polygons, view)


def view_of(scene: Scene) -> View:
    """Return the default view of a scene: its own for tiles and models."""
    if scene.tiling is not None:
        return View(scene.tiling.pixels, fit="tile")
    viewing = viewing_of(scene)
    return View() if viewing is None else View(viewing.pixels, fit="view")


def _frame_of_views(scene: Scene, viewing: Viewing, view: View) -> Frame:
    """Lay all views of a model on each other."""
    frame = frame_of_grid(viewing.pixels, viewing.pieces)
    flat = frame_of_grid(RESOLUTIONS[1], to_grid(scene.polygons))
    source, tiles = viewing.source, viewing.piece_offsets
    return replace(frame, view=view, source=source, tiles=tiles, flat=flat, viewing=viewing)


def _frame_of_tiles(scene: Scene, tiling: Tiling, view: View) -> Frame:
    """Lay all tiles on each other in a viewport that holds their buffers, too."""
    polygons = np.array(scene.polygons, dtype=object)
    bounds = shapely.total_bounds(polygons)
    reach = float(max(-bounds[:2].min(), bounds[2:].max() - tiling.pixels, 0.0))
    margin = -(-math.ceil(reach) // MARGIN_STEP_PX) * MARGIN_STEP_PX
    moved = shapely.transform(polygons, lambda xy: xy + margin)
    frame = _snap_to_frame(moved, 1.0, view, tiling.pixels + 2 * margin)
    tiles = np.searchsorted(frame.source, tiling.first)
    return replace(frame, scissor=(margin, margin, tiling.pixels, tiling.pixels), tiles=tiles)


def make_frame(polygons: Sequence[Polygon], view: View) -> Frame:
    """Map polygons (scene units, y up) to the viewport of `view` and snap them.

    Raises
    ------
    InputError
        if there is no polygon, or they have no extent
    """
    if not polygons:
        raise InputError("the scene has no polygon to draw")
    return _snap_to_frame(*_fit_to_view(polygons, view), view, view.resolution)


def _snap_to_frame(placed: NDArray[Any], scale: float, view: View, side: int) -> Frame:
    """Snap polygons in pixels of a viewport of `side` px."""
    pieces, source, dropped, repaired = snap_polygons(placed)
    grid = to_grid(pieces)
    return Frame(side, side, scale, view, source, grid, dropped=dropped, repaired=repaired)


def _fit_to_view(polygons: Sequence[Polygon], view: View) -> tuple[NDArray[Any], float]:
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
        raise InputError("the scene's polygons have no extent")
    scale = (view.resolution - 2 * MARGIN_PX) / extent
    middle = view.resolution / 2
    return shapely.transform(moved, lambda xy: (xy - shift) * scale + middle), scale
