"""The exact CPU rasteriser, the reference for all others, and a binner.

Binning assigns triangles to tiles, as the first pass of a tiled GPU does. A tile counts if its
interior meets the triangle's interior. Binning by bounding box tests only the box; exact binning
also tests the three edges, each at the corner of the tile that lies furthest inside the edge
(T. Akenine-Moller, "Conservative rasterization", GPU Gems 2, chapter 42).
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.frame import UNBOUNDED, Frame
from harness.grid import SUBPIXEL
from harness.rasterisers import spans
from harness.rasterisers.base import (
    Counters,
    CpuRasteriser,
    Drawing,
    Options,
    Sample,
    Stopwatch,
    Triangles,
    sum_per_polygon,
)
from triangulators.compute.kernels import njit

# Counters of devices that shade quads.
SHADED = ("fragments", "quads", "helper_lanes", "partial_quads", "covering_triangles")


def count_per_triangle(
    points: NDArray[np.int32], triangles: Triangles, window: NDArray[np.int64] = UNBOUNDED
) -> dict[str, NDArray[np.int64]]:
    """Return the exact counters of each triangle in the window (`Frame.window`), (m,) by name.

    - fragments: pixels whose centre the triangle covers
    - quads: 2x2 blocks with a covered pixel
    - helper_lanes: lanes of these quads whose pixel is not covered
    - partial_quads: quads with a helper lane
    - covering_triangles: 1 if a pixel is covered, otherwise 0
    - blocks: 4x4 blocks with a covered pixel
    - bbox_tests: pixel centres in the bounding box
    """
    counts = spans.count_pixels_per_triangle(points, triangles, window).T
    fragments, quads, partial, blocks, tests = counts
    return _derive_shaded(fragments, quads, partial) | {"blocks": blocks, "bbox_tests": tests}


def _derive_shaded(
    fragments: NDArray[np.int64], quads: NDArray[np.int64], partial: NDArray[np.int64]
) -> dict[str, NDArray[np.int64]]:
    covering = (fragments > 0).astype(np.int64)
    values = (fragments, quads, 4 * quads - fragments, partial, covering)
    return dict(zip(SHADED, values, strict=True))


def count_visible_per_triangle(
    frame: Frame, triangles: Triangles, picture: NDArray[np.uint32] | None = None
) -> dict[str, NDArray[np.int64]]:
    """Draw triangles (m, 3) in order with a depth test; return counters of visible pixels, (m,).

    `depth_ties` counts depth tests that depend on rounding: a device's counts of pixels and quads
    may differ by that number. `picture` (height, width), row 0 at the bottom, receives the colours.
    """
    assert frame.depths is not None
    draws = frame.split_by_draw(triangles)
    begins = np.array([0, *(rows.stop for rows in draws)], np.int64)
    if picture is None:
        picture = np.zeros((frame.height, frame.width), np.uint32)
    paint = choose_polygon_colours(frame.find_owners(triangles))
    arrays = (frame.points, frame.depths, triangles, begins, paint, frame.window)
    fragments, quads, partial, ties = spans.count_visible_pixels(*arrays, picture).T
    return _derive_shaded(fragments, quads, partial) | {"depth_ties": ties}


def count_outline_quads(
    frame: Frame, parts: Sequence[NDArray[np.int32] | None]
) -> NDArray[np.int64]:
    """Return the number of 2x2 blocks that each polygon covers, (p,); -1 without a triangulation.

    This is a lower bound of the quads of every triangulation. `parts[k]` (m, 3) is any
    triangulation that uses every vertex, or None.
    """
    sizes = [0 if part is None else len(part) for part in parts]
    bounds = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    counts = spans.count_outline_quads(
        frame.points, frame.join_triangles(parts), bounds, frame.window
    )
    return np.where([part is None for part in parts], -1, counts)


def count_quads(frame: Frame, parts: Sequence[NDArray[np.int32] | None]) -> NDArray[np.int64]:
    """Return the number of quads that each polygon's triangles, `parts[k]` (m, 3), shade, (p,)."""
    triangles = frame.join_triangles(parts)
    return sum_per_polygon(
        frame, triangles, count_per_triangle(frame.points, triangles, frame.window)["quads"]
    )


class Reference(CpuRasteriser):
    """Rasteriser that finds covered pixels row by row on one core, compiled by Numba."""

    name = "reference"
    limitation = "one sample per pixel, no fragment work and no textures"
    counters: ClassVar[tuple[str, ...]] = (*SHADED, "blocks", "bbox_tests")
    supports_scissor = True
    supports_depth = True

    def _draw_and_count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        if frame.depths is not None:
            counts = count_visible_per_triangle(frame, triangles)
        else:
            counts = count_per_triangle(frame.points, triangles, frame.window)
        return {name: sum_per_polygon(frame, triangles, n) for name, n in counts.items()}

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        return _FillDrawing(frame, triangles)


class _FillDrawing(Drawing):
    def __init__(self, frame: Frame, triangles: Triangles) -> None:
        self.frame = frame
        self.triangles = triangles
        self.colours = choose_polygon_colours(frame.find_owners(triangles))
        self.picture = np.zeros((frame.height, frame.width), np.uint32)
        self._rasterise(self.triangles[:0])  # compile the kernel

    def sample(self, repeats: int) -> Sample:
        watch = Stopwatch()
        for _ in range(repeats):
            self._rasterise(self.triangles)
        return watch.stop()

    def _rasterise(self, triangles: Triangles) -> None:
        frame = self.frame
        if frame.depths is not None:
            count_visible_per_triangle(frame, triangles, self.picture)
        else:
            spans.fill_picture(frame.points, triangles, self.colours, self.picture, frame.window)


def choose_polygon_colours(polygons: NDArray[np.int32]) -> NDArray[np.uint32]:
    """Return an opaque colour (RGBA, little-endian uint32) for each of the polygon numbers (m,)."""
    mixed = (polygons.astype(np.uint32) + np.uint32(1)) * np.uint32(2654435761)
    return (mixed >> np.uint32(8)) | np.uint32(0xFF404040)


def find_disagreements(frame: Frame, drawn: Counters, expected: Counters) -> list[str]:
    """Return a sentence for each counter that both have for each polygon and that differs."""
    sentences = []
    for name, values in expected.items():
        if name not in drawn or drawn[name].shape != values.shape:
            continue
        differing = np.flatnonzero(drawn[name] != values)
        if len(differing):
            first = differing[0]
            sentences.append(
                f"{name} differ in {len(differing)} of {len(values)} polygons; polygon "
                f"{frame.source[first]}: {drawn[name][first]} instead of {values[first]}"
            )
    return sentences


TILE_SIDES_PX = (16, 32, 64)


def count_tiles_per_triangle(
    points: NDArray[np.int32], triangles: Triangles, window: NDArray[np.int64] = UNBOUNDED
) -> dict[str, NDArray[np.int64]]:
    """Return each triangle's number of tiles in the window (px), (m,) by name as in `Binning`."""
    counts = {}
    for side in TILE_SIDES_PX:
        binned = count_tiles(points, triangles, side * SUBPIXEL, window // side)
        counts[f"tiles_{side}"] = binned[:, 0]
        counts[f"tiles_{side}_exact"] = binned[:, 1]
    return counts


@njit(error_model="numpy")
def count_tiles(
    points: NDArray[np.int32],
    triangles: NDArray[np.int32],
    side: int,
    window: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return each triangle's number of tiles of `side` (1/256 px): by box, and exact, (m, 2)."""
    counts = np.zeros((len(triangles), 2), np.int64)
    corners = np.zeros((3, 2), np.int64)
    for t in range(len(triangles)):
        min_column, max_column, bottom, top = find_tile_box(
            points, triangles[t], side, window, corners
        )
        counts[t, 0] = max(0, max_column - min_column + 1) * max(0, top - bottom + 1)
        for row in range(bottom, top + 1):
            low, high = find_tile_span(corners, row, side, min_column, max_column)
            counts[t, 1] += max(0, high - low + 1)
    return counts


@njit(error_model="numpy")
def find_tile_box(
    points: NDArray[np.int32],
    triangle: NDArray[np.int32],
    side: int,
    window: NDArray[np.int64],
    corners: NDArray[np.int64],
) -> tuple[int, int, int, int]:
    """Return first and last column, first and last row of the tiles of a triangle's bounding box.

    Tiles are clipped to `window` (in tiles); a triangle without an area has none. `corners` (3, 2)
    receives the triangle's vertices, counter-clockwise.
    """
    for k in range(3):
        corners[k, 0] = points[triangle[k], 0]
        corners[k, 1] = points[triangle[k], 1]
    doubled = (corners[1, 0] - corners[0, 0]) * (corners[2, 1] - corners[0, 1]) - (
        corners[1, 1] - corners[0, 1]
    ) * (corners[2, 0] - corners[0, 0])
    if doubled == 0:
        return 0, -1, 0, -1
    if doubled < 0:
        for axis in range(2):
            corners[1, axis], corners[2, axis] = corners[2, axis], corners[1, axis]
    min_column, max_column = corners[:, 0].min() // side, (corners[:, 0].max() - 1) // side
    bottom, top = corners[:, 1].min() // side, (corners[:, 1].max() - 1) // side
    return (
        max(min_column, window[0]),
        min(max_column, window[2]),
        max(bottom, window[1]),
        min(top, window[3]),
    )


@njit(error_model="numpy", inline="always")
def find_tile_span(
    corners: NDArray[np.int64], row: int, side: int, min_column: int, max_column: int
) -> tuple[int, int]:
    """Return the first and last column of the tiles of `row` that meet the triangle's interior.

    `corners`, `min_column` and `max_column` are those of `find_tile_box`.
    """
    for k in range(3):
        x, y = corners[k, 0], corners[k, 1]
        dx, dy = corners[(k + 1) % 3, 0] - x, corners[(k + 1) % 3, 1] - y
        furthest_row = row + 1 if dx > 0 else row
        # The corner at x = side * x' of that row is inside the edge if value > dy * side * x'.
        value = dx * (side * furthest_row - y) + dy * x
        if dy > 0:
            max_column = min(max_column, (value - 1) // (dy * side))
        elif dy < 0:
            min_column = max(min_column, -((value - 1) // (-dy * side)) - 1)
        elif value <= 0:
            return min_column, min_column - 1
    return min_column, max_column


class Binning(CpuRasteriser):
    """A binner on the CPU, which counts without drawing and cannot be timed."""

    name = "binning"
    counters: ClassVar[tuple[str, ...]] = tuple(
        f"tiles_{side}{suffix}" for side in TILE_SIDES_PX for suffix in ("", "_exact")
    )
    timed = False
    supports_scissor = True

    def _draw_and_count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        tiles = count_tiles_per_triangle(frame.points, triangles, frame.window)
        return {name: sum_per_polygon(frame, triangles, tiles[name]) for name in self.counters}
