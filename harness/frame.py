"""Scenes in a viewport: polygons in pixels, y up, on the 1/256 px grid; views of a model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from harness.errors import InputError, UsageError, make_unknown_name_error
from harness.grid import SUBPIXEL, snap_polygons, to_grid
from harness.settings import FITS, RESOLUTIONS, Fit
from scenes.readers.reader import is_model
from scenes.scene import Scene, Tiling
from scenes.spec import is_path, parse_name
from triangulators.polygon_arrays import PolygonArray, offsets_of

# Empty margin on each side: a device may clip triangles that leave the viewport, and would count
# quads at the cuts twice.
MARGIN_PX = 1.0

MARGIN_STEP_PX = 64  # step of a tile's margin, which aligns quads, blocks and bins with the tile
FIXED_VIEWS = {"tile": "map tiles", "view": "a model's views"}  # scenes that define a view

FIXED_VIEW_MESSAGE = (
    "--sizes, --resolution, --rotation and --fit are unsupported for {}; set the resolution by "
    "pixels="
)

VIEW_OPTIONS = ("views", "pixels", "distance", "depth")  # parameters of a scene that request views
UNBOUNDED = np.array([-(2**30), -(2**30), 2**30, 2**30], np.int64)  # window without scissor
Rows = NDArray[np.int32]  # (m, 3), rows of three vertex indices


@dataclass(frozen=True, order=True)
class View:
    """Mapping of a scene to the viewport.

    Parameters
    ----------
    resolution : int
        Width and height of the viewport in pixels, 8 to 16384.
    rotation : float
        Degrees, counter-clockwise, about the scene's centre.
    fit : {"box", "circle", "tile", "view"}
        What fills the viewport: "box", the rotated scene's bounding box; "circle", a circle about
        the scene's centre that encloses it, so that the scale is the same at every rotation. Map
        tiles, whose polygons are in pixels already, have "tile", and models in space "view"; then
        `resolution` is the side of a tile or of a view's image.
    """

    resolution: int = 1024
    rotation: float = 0.0
    fit: Fit = "box"

    def __post_init__(self) -> None:
        low, high = RESOLUTIONS
        if not low <= self.resolution <= high:
            raise UsageError(f"resolution {self.resolution}: out of range ({low} to {high} pixels)")
        if self.fit not in FITS:
            raise make_unknown_name_error("fit", self.fit, FITS)
        if not math.isfinite(self.rotation):
            raise UsageError(f"rotation {self.rotation}: not a finite number of degrees")
        if self.fit in FIXED_VIEWS and (self.rotation or self.resolution % 2):
            raise UsageError(
                f"fit {self.fit}: requires rotation 0 and an even resolution (rotation "
                f"{self.rotation:g}, resolution {self.resolution})"
            )


@dataclass(frozen=True, eq=False)
class Viewing:
    """Views of a model; the scene's polygons are the valid flat faces, each in its plane.

    A view consists of pieces, in this order: the valid faces whose front points to the camera; such
    invalid faces (the outline touches itself, or a vertex is inside); and one piece for all loose
    triangles, those outside of faces. Triangulators change valid faces, flips also invalid faces.

    pixels : side of the image of a view
    names : (v) direction to the camera of each view, for example "1 2 3"
    pieces : p projected pieces, int32 coordinates in 1/256 px, y up; one ring for loose triangles
    depths : (n,) depth of each vertex, from 0, near, to 2**24; None without a depth test
    source : (p,) number in the scene of the face of each piece; q, the number of polygons, stands
        for loose triangles, and q + 1 + k for invalid face k
    piece_offsets : (v + 1,); view k has the pieces piece_offsets[k]:piece_offsets[k + 1]
    polygon_triangles : for each polygon its triangles in the model's file
    other_triangles : the file's triangles of other pieces, by number of the piece
    ranks : position in the model's file of each triangle of each piece, piece by piece
    front_to_back : True to draw triangles front to back instead of in the model's order
    invalid_faces : for each invalid face (n, 2) integer points in its plane, and its triangles
    """

    pixels: int
    names: tuple[str, ...]
    pieces: PolygonArray
    depths: NDArray[np.int32] | None
    source: NDArray[np.int64]
    piece_offsets: NDArray[np.int64]
    polygon_triangles: tuple[Rows, ...]
    other_triangles: dict[int, Rows]
    ranks: NDArray[np.int64]
    front_to_back: bool = False
    invalid_faces: tuple[tuple[NDArray[np.float64], Rows], ...] = ()

    @cached_property
    def rank_offsets(self) -> NDArray[np.int64]:
        """Offsets (p + 1,) of the pieces in `ranks`."""
        polygon_sizes = [len(rows) for rows in self.polygon_triangles]
        face_sizes = [len(rows) for _, rows in self.invalid_faces]
        sizes = np.array([*polygon_sizes, 0, *face_sizes])[self.source]
        for piece, rows in self.other_triangles.items():
            sizes[piece] = len(rows)
        return offsets_of(sizes)


@dataclass(frozen=True)
class Frame:
    """Polygons in pixels, ready to triangulate and draw; only arrays, so cheap to send to a worker.

    Parameters
    ----------
    width, height : int
        Size of the viewport in pixels.
    scale : float
        Pixels per scene unit.
    view : View
        Mapping of the scene to the viewport.
    source : ndarray of int64, (p,)
        Number of each polygon in the scene.
    grid : PolygonArray
        The p polygons, int32 coordinates in 1/256 px.
    dropped, repaired : tuple of (int, str)
        Numbers in the scene of polygons that snapping broke, with reasons.
    scissor : tuple of int, optional
        Left, bottom, width, height of the drawn rectangle in pixels, all even.
    tiles : ndarray of int64, (t + 1,), optional
        Polygons tiles[k]:tiles[k + 1] are tile or view k, which is drawn by a separate call, at the
        same position in the viewport as all others. By default one call draws all polygons.
    flat : Frame, optional
        For a model in space, the faces as polygons, each in its plane; these are triangulated.
    viewing : Viewing, optional
        For a model in space, the views.
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
        """Vertices (n, 2) of all polygons, in 1/256 px."""
        return self.grid.coords

    @property
    def window(self) -> NDArray[np.int64]:
        """Drawn pixels: first column, first row, last column, last row."""
        if self.scissor is None:
            return UNBOUNDED
        x, y, width, height = self.scissor
        return np.array([x, y, x + width - 1, y + height - 1], np.int64)

    @property
    def depths(self) -> NDArray[np.int32] | None:
        """Depths (n,) of the points, 0 to 2**24, or None without a depth test."""
        return None if self.viewing is None else self.viewing.depths

    @cached_property
    def polygons(self) -> PolygonArray:
        """The p polygons in px; coordinates are multiples of 1/256 px inside the viewport."""
        return replace(self.grid, coords=self.grid.coords / SUBPIXEL)

    def __getstate__(self) -> dict[str, Any]:
        """Omit the cached polygons, which are slow to send to another process."""
        return {name: value for name, value in vars(self).items() if name != "polygons"}

    def with_points(self, points: NDArray[np.int32]) -> "Frame":
        """Return the frame with other (n, 2) points in 1/256 px for the same vertices."""
        return replace(self, grid=replace(self.grid, coords=points))

    def find_owners(self, triangles: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the number of the polygon in `grid` of each of the `triangles` (m, 3)."""
        first = np.searchsorted(self.grid.vertex_offsets, triangles[:, 0], side="right")
        return (first - 1).astype(np.int32)

    def split_by_draw(self, triangles: NDArray[np.int32]) -> list[slice]:
        """Return the slice of `triangles` (m, 3), sorted by tile or view, of each draw call."""
        if self.tiles is None:
            return [slice(0, len(triangles))]
        bounds = np.searchsorted(self.find_owners(triangles), self.tiles)
        return [slice(*pair) for pair in pairwise(bounds.tolist())]

    def join_triangles(
        self, triangulations: Sequence[NDArray[np.int32] | None]
    ) -> NDArray[np.int32]:
        """Concatenate triangles (m_k, 3) of polygons, or None, as rows of vertices of `points`."""
        starts = self.grid.vertex_offsets[:-1]
        parts = [
            part + np.int32(start)
            for part, start in zip(triangulations, starts, strict=True)
            if part is not None
        ]
        if not parts:
            return np.empty((0, 3), np.int32)
        return np.ascontiguousarray(np.concatenate(parts), np.int32)


def make_bare_frame(
    resolution: int, points: NDArray[np.int32], vertices: int | None = None
) -> Frame:
    """Return a frame of polygons of `vertices` points each, or one; `points` (n, 2) in 1/256 px."""
    grid = PolygonArray.of_single_rings(points, vertices or len(points))
    return make_grid_frame(resolution, grid)


def make_grid_frame(resolution: int, grid: PolygonArray) -> Frame:
    """Return a frame of polygons in 1/256 px that need neither mapping nor snapping."""
    source = np.arange(len(grid), dtype=np.int64)
    return Frame(resolution, resolution, 1.0, View(resolution), source, grid)


def make_scene_frame(scene: Scene, view: View) -> Frame:
    """Map a scene to the viewport; raise UsageError if the scene defines another view."""
    fit = get_scene_view(scene).fit
    if view.fit != fit and fit in FIXED_VIEWS:
        raise UsageError(f"{scene.name}: {FIXED_VIEW_MESSAGE.format(FIXED_VIEWS[fit])}")
    if scene.tiling is not None:
        return _make_tiles_frame(scene, scene.tiling, view)
    viewing = get_viewing(scene)
    if viewing is not None:
        frame = make_grid_frame(viewing.pixels, viewing.pieces)
        flat = make_grid_frame(RESOLUTIONS[1], to_grid(scene.polygons))
        source, tiles = viewing.source, viewing.piece_offsets
        return replace(frame, view=view, source=source, tiles=tiles, flat=flat, viewing=viewing)
    return make_frame(scene.polygons, view)


def get_scene_view(scene: Scene) -> View:
    """Return the view that map tiles or a model define, or else the default view."""
    if scene.tiling is not None:
        return View(scene.tiling.pixels, fit="tile")
    viewing = get_viewing(scene)
    return View() if viewing is None else View(viewing.pixels, fit="view")


def _make_tiles_frame(scene: Scene, tiling: Tiling, view: View) -> Frame:
    # The viewport's margin is for parts of polygons outside the tile, which are not drawn.
    polygons = np.array(scene.polygons, dtype=object)
    bounds = shapely.total_bounds(polygons)
    reach = float(max(-bounds[:2].min(), bounds[2:].max() - tiling.pixels, 0.0))
    margin = -(-math.ceil(reach) // MARGIN_STEP_PX) * MARGIN_STEP_PX
    moved = shapely.transform(polygons, lambda xy: xy + margin)
    frame = _make_snapped_frame(moved, 1.0, view, tiling.pixels + 2 * margin)
    tiles = np.searchsorted(frame.source, tiling.first)
    return replace(frame, scissor=(margin, margin, tiling.pixels, tiling.pixels), tiles=tiles)


def make_frame(polygons: Sequence[Polygon], view: View) -> Frame:
    """Map polygons to the viewport of `view` and snap them.

    Parameters
    ----------
    polygons : sequence of shapely.Polygon
        Polygons in scene units, y up.
    view : View
        Mapping to the viewport.

    Returns
    -------
    Frame

    Raises
    ------
    InputError
        If there is no polygon, or the polygons have no extent.
    """
    if not polygons:
        raise InputError("the scene has no polygon to draw; give another scene or condition")
    return _make_snapped_frame(*_fit_to_view(polygons, view), view, view.resolution)


def _make_snapped_frame(polygons: NDArray[Any], scale: float, view: View, side: int) -> Frame:
    pieces, source, dropped, repaired = snap_polygons(polygons)
    grid = to_grid(pieces)
    return Frame(side, side, scale, view, source, grid, dropped=dropped, repaired=repaired)


def _fit_to_view(polygons: Sequence[Polygon], view: View) -> tuple[NDArray[Any], float]:
    """Rotate, scale and centre polygons; return polygons in px, and the scale in px per unit."""
    west, south, east, north = shapely.total_bounds(np.array(polygons, dtype=object))
    centre = np.array([(west + east) / 2, (south + north) / 2])
    angle = math.radians(view.rotation)
    matrix = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    if view.rotation % 90 == 0:
        matrix = np.rint(matrix)
    moved = shapely.transform(np.array(polygons, dtype=object), lambda xy: (xy - centre) @ matrix.T)
    low_x, low_y, high_x, high_y = shapely.total_bounds(moved)
    if view.fit == "circle":
        coordinates = shapely.get_coordinates(moved)
        shift = np.zeros(2)
        extent = 2 * float(np.sqrt((coordinates**2).sum(axis=1)).max())
    else:
        shift = np.array([(low_x + high_x) / 2, (low_y + high_y) / 2])
        extent = float(max(high_x - low_x, high_y - low_y))
    if not (math.isfinite(extent) and extent > 0):
        raise InputError("the scene's polygons have no extent (all vertices are equal)")
    scale = (view.resolution - 2 * MARGIN_PX) / extent
    middle = view.resolution / 2
    return shapely.transform(moved, lambda xy: (xy - shift) * scale + middle), scale


@dataclass(frozen=True, eq=False, repr=False)
class ModelScene(Scene):
    """A scene whose polygons are a model's flat faces; the model's views are drawn instead."""

    viewing: Viewing | None = None

    def _update_hash(self, digest: Any) -> None:
        super()._update_hash(digest)
        if self.polygons and self.viewing is not None:
            digest.update(self.viewing.pieces.coords.astype("<i4").tobytes())
            digest.update(self.viewing.source.astype("<i8").tobytes())


def get_viewing(scene: Scene) -> Viewing | None:
    """Return the views of a scene, or None if the scene is not a model."""
    return scene.viewing if isinstance(scene, ModelScene) else None


def is_model_with_views(text: str) -> bool:
    """Return whether a name such as "part.glb:views=24" requests views, even if misspelt."""
    name, arguments = parse_name(text)
    model = is_model(Path(name)) and any(get_close_matches(key, VIEW_OPTIONS) for key in arguments)
    return is_path(name) and ("views" in arguments or model)
