"""Exact rasterisation of triangles row by row, in integers on the 1/256 px grid (Numba).

A pixel is covered if its centre (128/256 px from its corner) is inside all three edge functions of
the counter-clockwise triangle, y up; a centre exactly on an edge is covered if the edge is a left
edge (it runs down) or a bottom edge (horizontal, it runs right). That is the top-left rule of
Direct3D and Mesa, whose y axis points down. Within a row an edge function is linear in x, so one
floor division gives its first or last covered pixel.

Source of the edge functions: J. Pineda, "A Parallel Algorithm for Polygon Rasterization",
SIGGRAPH 1988.

A depth test does not change which pixels are covered. The depth is a plane through the triangle's
snapped vertices, here in double precision. A device computes in single precision: if two surfaces
are closer than that rounding error, either may be visible, and the test is a *tie*. Counters differ
from a device's by at most one pixel and one quad per tie.
"""

import numpy as np
from numpy.typing import NDArray

from triangulators.compute.kernels import njit

Points = NDArray[np.int32]
Triangles = NDArray[np.int32]
Edges = NDArray[np.int64]
Window = NDArray[np.int64]  # first column and row, last column and row: `Frame.window`

FRAGMENTS, QUADS, PARTIAL_QUADS, BLOCKS, BBOX_TESTS = range(5)  # columns of counts per triangle

_UNIT = 256
_HALF = 128


@njit(inline="always")
def find_pixel_range(low: int, high: int) -> tuple[int, int]:
    """Return first and last pixel with centre in [low, high] (1/256 px); first > last if none."""
    return -((_HALF - low) // _UNIT), (high - _HALF) // _UNIT


@njit(error_model="numpy")
def set_up_edges(
    points: Points, triangle: NDArray[np.int32], edges: Edges, window: Window
) -> tuple[int, int, int, int, bool]:
    """Write a triangle's edge functions to `edges`; return the triangle's box in the window.

    A row of `edges` (3, 3) is constant, per_row, per_column: constant + per_row*y - per_column*x is
    the edge function at the centre of pixel (x, y), less 1 if the top-left rule excludes the edge
    itself, so that a pixel is inside if no edge function is negative. Returns (first row, last row,
    first column, last column, whether the area is positive); without an area `edges` is not set.
    """
    ax, ay = np.int64(points[triangle[0], 0]), np.int64(points[triangle[0], 1])
    bx, by = np.int64(points[triangle[1], 0]), np.int64(points[triangle[1], 1])
    cx, cy = np.int64(points[triangle[2], 0]), np.int64(points[triangle[2], 1])
    min_x, max_x = find_pixel_range(int(min(ax, bx, cx)), int(max(ax, bx, cx)))
    first, last = find_pixel_range(int(min(ay, by, cy)), int(max(ay, by, cy)))
    min_x, max_x = max(min_x, window[0]), min(max_x, window[2])
    first, last = max(first, window[1]), min(last, window[3])
    doubled = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if doubled == 0:
        return first, last, min_x, max_x, False
    if doubled < 0:
        bx, by, cx, cy = cx, cy, bx, by
    for k in range(3):
        dx, dy = bx - ax, by - ay
        closed = dy < 0 or (dy == 0 and dx > 0)
        edges[k, 0] = dx * (_HALF - ay) - dy * (_HALF - ax) - (0 if closed else 1)
        edges[k, 1] = _UNIT * dx
        edges[k, 2] = _UNIT * dy
        ax, ay, bx, by, cx, cy = bx, by, cx, cy, ax, ay
    return first, last, min_x, max_x, True


@njit(error_model="numpy", inline="always")
def find_span(edges: Edges, y: int, min_x: int, max_x: int) -> tuple[int, int]:
    """Return first and last pixel of row `y` in a triangle and its box; first > last if none."""
    for k in range(3):
        value = edges[k, 0] + edges[k, 1] * y
        step = edges[k, 2]
        if step > 0:
            max_x = min(max_x, value // step)
        elif step < 0:
            # The minimum x with value - step x >= 0 is value / step rounded up; // rounds down.
            min_x = max(min_x, -(value // -step))
        elif value < 0:
            return min_x, min_x - 1
    return min_x, max_x


@njit(error_model="numpy")
def count_pixels_per_triangle(
    points: Points, triangles: Triangles, window: Window
) -> NDArray[np.int64]:
    """Return the counters of each triangle in the window, (m, 5); see `count_per_triangle`.

    Rows are taken by four, so that a row's span serves pixels, 2x2 quads and 4x4 blocks.
    """
    counts = np.zeros((len(triangles), 5), np.int64)
    edges = np.zeros((3, 3), np.int64)
    spans = np.zeros((4, 2), np.int64)
    for t in range(len(triangles)):
        first, last, min_x, max_x, solid = set_up_edges(points, triangles[t], edges, window)
        counts[t, BBOX_TESTS] = max(0, last - first + 1) * max(0, max_x - min_x + 1)
        if not solid or min_x > max_x:
            continue
        for block in range(first >> 2, (last >> 2) + 1):
            for j in range(4):
                y = 4 * block + j
                spans[j, 0], spans[j, 1] = 0, -1
                if first <= y <= last:
                    spans[j, 0], spans[j, 1] = find_span(edges, y, min_x, max_x)
                counts[t, FRAGMENTS] += max(0, spans[j, 1] - spans[j, 0] + 1)
            for rows in (spans[:2], spans[2:]):
                full = count_full_quads(rows)
                touched = count_touched_cells(rows, 1)
                counts[t, QUADS] += touched
                counts[t, PARTIAL_QUADS] += touched - full
            counts[t, BLOCKS] += count_touched_cells(spans, 2)
    return counts


@njit(error_model="numpy")
def count_outline_quads(
    points: Points, triangles: Triangles, bounds: NDArray[np.int64], window: Window
) -> NDArray[np.int64]:
    """Return the number of 2x2 blocks in which each polygon covers a pixel of the window, (p,).

    triangles[bounds[k]:bounds[k + 1]] are a triangulation of polygon k. A mask of the polygon's
    bounding box marks touched blocks, so that a block of several triangles counts once.
    """
    counts = np.zeros(len(bounds) - 1, np.int64)
    edges = np.zeros((3, 3), np.int64)
    for k in range(len(counts)):
        part = triangles[bounds[k] : bounds[k + 1]]
        if len(part) == 0:
            continue
        corners = points[part.ravel()]
        min_x, max_x = find_pixel_range(int(corners[:, 0].min()), int(corners[:, 0].max()))
        first, last = find_pixel_range(int(corners[:, 1].min()), int(corners[:, 1].max()))
        min_x, max_x = max(min_x, window[0]), min(max_x, window[2])
        first, last = max(first, window[1]), min(last, window[3])
        if min_x > max_x or first > last:
            continue
        column, row = min_x >> 1, first >> 1
        touched = np.zeros(((last >> 1) - row + 1, (max_x >> 1) - column + 1), np.bool_)
        for t in range(len(part)):
            bottom, top, west, east, solid = set_up_edges(points, part[t], edges, window)
            if not solid:
                continue
            for line in range(bottom, top + 1):
                low, high = find_span(edges, line, west, east)
                if low <= high:
                    begin, end = (low >> 1) - column, (high >> 1) - column + 1
                    touched[(line >> 1) - row, begin:end] = True
        counts[k] = touched.sum()
    return counts


@njit(inline="always")
def count_full_quads(spans: NDArray[np.int64]) -> int:
    """Count the quads that two rows' spans (2, 2), the lower row even, fully cover."""
    low, high = max(spans[0, 0], spans[1, 0]), min(spans[0, 1], spans[1, 1])
    return int(max(0, ((high + 1) >> 1) - ((low + 1) >> 1)))


@njit
def count_touched_cells(spans: NDArray[np.int64], shift: int) -> int:
    """Count the cells, 2**shift px wide, with a covered pixel in k spans (k, 2); sort the spans."""
    total = 0
    reach = np.int64(-1)
    for i in range(len(spans)):
        for j in range(i + 1, len(spans)):
            if spans[j, 0] < spans[i, 0]:
                for side in range(2):
                    spans[i, side], spans[j, side] = spans[j, side], spans[i, side]
        if spans[i, 0] <= spans[i, 1]:
            high = spans[i, 1] >> shift
            total += max(0, high - max(spans[i, 0] >> shift, reach + 1) + 1)
            reach = max(reach, high)
    return total


@njit(error_model="numpy")
def fill_picture(
    points: Points,
    triangles: Triangles,
    colours: NDArray[np.uint32],
    picture: NDArray[np.uint32],
    window: Window,
) -> None:
    """Draw each triangle t in `colours[t]` into `picture` (height, width), row 0 at the bottom."""
    edges = np.zeros((3, 3), np.int64)
    height, width = picture.shape
    for t in range(len(triangles)):
        first, last, min_x, max_x, solid = set_up_edges(points, triangles[t], edges, window)
        if not solid:
            continue
        min_x, max_x = max(min_x, 0), min(max_x, width - 1)
        for y in range(max(first, 0), min(last, height - 1) + 1):
            low, high = find_span(edges, y, min_x, max_x)
            if low <= high:
                picture[y, low : high + 1] = colours[t]


@njit(error_model="numpy")
def count_lanes_per_pixel(
    points: Points,
    triangles: Triangles,
    covered: NDArray[np.int64],
    helpers: NDArray[np.int64],
    window: Window,
) -> None:
    """Add to each pixel's counts the numbers of covering triangles and of helper lanes there.

    covered, helpers : (height, width), both even; row 0 at the bottom
    """
    edges = np.zeros((3, 3), np.int64)
    rows = np.zeros((2, 2), np.int64)
    for t in range(len(triangles)):
        first, last, min_x, max_x, solid = set_up_edges(points, triangles[t], edges, window)
        if not solid:
            continue
        for bottom in range(first & ~1, last + 1, 2):
            for k in range(2):
                rows[k, 0], rows[k, 1] = 0, -1
                if first <= bottom + k <= last:
                    rows[k, 0], rows[k, 1] = find_span(edges, bottom + k, min_x, max_x)
            for column in range(min_x & ~1, max_x + 1, 2):
                lanes = 0
                for lane in range(4):
                    lanes += rows[lane >> 1, 0] <= column + (lane & 1) <= rows[lane >> 1, 1]
                if lanes == 0:
                    continue
                for lane in range(4):
                    x, k = column + (lane & 1), lane >> 1
                    if rows[k, 0] <= x <= rows[k, 1]:
                        covered[bottom + k, x] += 1
                    else:
                        helpers[bottom + k, x] += 1


TIES = 3  # column after FRAGMENTS, QUADS and PARTIAL_QUADS in `count_visible_pixels`
DEEPEST = float(1 << 24)  # depth of the background; only smaller depths are drawn
ERROR_STEPS = 16.0  # constant term of a device's tolerated depth error, in depth-buffer steps

# Variable term, as a share of the change of the triangle's depth plane across the picture. Single
# precision has 24 bits; the slope of a plane is accurate to about 22.
ERROR_SHARE = 2.0**-20


@njit(error_model="numpy")
def count_visible_pixels(
    points: Points,
    depths: NDArray[np.int32],
    triangles: Triangles,
    begins: NDArray[np.int64],
    colours: NDArray[np.uint32],
    window: Window,
    picture: NDArray[np.uint32],
) -> NDArray[np.int64]:
    """Draw triangles with a depth test, and return the counters of each triangle, (m, 4).

    Columns: FRAGMENTS, pixels that pass; QUADS, 2x2 blocks with a passing pixel; PARTIAL_QUADS, 2x2
    blocks in which some pixels pass and others do not; TIES, tests within the rounding error.

    points, depths : (n, 2) in 1/256 px, and (n,) from 0, near, to `DEEPEST`
    begins : (v + 1,) first triangles of views; each view starts with cleared depths
    picture : (height, width), both even, row 0 at the bottom; receives visible `colours` (m,)
    """
    counts = np.zeros((len(triangles), 4), np.int64)
    edges = np.zeros((3, 3), np.int64)
    rows = np.zeros((2, 2), np.int64)
    height, width = picture.shape
    nearest, slack = np.empty((height, width)), np.empty((height, width))
    for view in range(len(begins) - 1):
        nearest[:], slack[:] = DEEPEST, -1.0
        for t in range(begins[view], begins[view + 1]):
            first, last, min_x, max_x, solid = set_up_edges(points, triangles[t], edges, window)
            min_x, max_x = max(min_x, 0), min(max_x, width - 1)
            if not solid or min_x > max_x:
                continue
            x0, y0, z0, across, up = _fit_plane(points, depths, triangles[t])
            # Single-precision rounding error at a pixel's centre, in steps of the depth buffer.
            tolerance = ERROR_STEPS + ERROR_SHARE * 256.0 * (abs(across) * width + abs(up) * height)
            for bottom in range(max(first, 0) & ~1, min(last, height - 1) + 1, 2):
                low, high = max_x + 1, min_x - 1
                for k in range(2):
                    rows[k, 0], rows[k, 1] = find_span(edges, bottom + k, min_x, max_x)
                    if not first <= bottom + k <= last or rows[k, 0] > rows[k, 1]:
                        rows[k, 0], rows[k, 1] = max_x + 1, min_x - 1
                    low, high = min(low, rows[k, 0]), max(high, rows[k, 1])
                for column in range(low & ~1, high + 1, 2):
                    passed = 0
                    for lane in range(4):
                        x, k = column + (lane & 1), lane >> 1
                        if not rows[k, 0] <= x <= rows[k, 1]:
                            continue
                        y = bottom + k
                        z = z0 + across * (256 * x + 128 - x0) + up * (256 * y + 128 - y0)
                        gap = nearest[y, x] - z
                        counts[t, TIES] += (
                            slack[y, x] >= 0.0 and abs(gap) <= tolerance + slack[y, x]
                        )
                        if gap > 0.0:
                            nearest[y, x], slack[y, x] = z, tolerance
                            picture[y, x] = colours[t]
                            passed += 1
                    counts[t, FRAGMENTS] += passed
                    counts[t, QUADS] += passed > 0
                    counts[t, PARTIAL_QUADS] += 0 < passed < 4
    return counts


@njit(error_model="numpy")
def _fit_plane(
    points: Points, depths: NDArray[np.int32], triangle: NDArray[np.int32]
) -> tuple[float, float, float, float, float]:
    """Return x, y, depth of the first vertex, and the change of depth per 1/256 px in x and y."""
    a, b, c = triangle
    x0, y0, z0 = float(points[a, 0]), float(points[a, 1]), float(depths[a])
    bx, by, bz = points[b, 0] - x0, points[b, 1] - y0, depths[b] - z0
    cx, cy, cz = points[c, 0] - x0, points[c, 1] - y0, depths[c] - z0
    area = bx * cy - by * cx
    return x0, y0, z0, (bz * cy - cz * by) / area, (cz * bx - bz * cx) / area
