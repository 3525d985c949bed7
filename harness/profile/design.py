"""The draws of a profile, generated from a seed; each kind isolates one or two terms.

    kind       differs among its draws                     equal among its draws
    few        triangles                                   their size
    aspect     aspect, angle, and so lanes and boxes       triangles, area
    size       size                                        aspect
    lanes      triangles, pixels                           helper lanes, half-perimeter
    places     helper lanes, blocks                        triangles, pixels, half-perimeter
    cuts       lanes, half-perimeter, boxes                triangles, vertices, pixels
    strips     triangles, half-perimeter                   pixels
    slivers    length, angle                               triangles; hardly any pixel
    long       angle, and so boxes                         all terms but pixels of boxes
    vertices   vertices                                    all other terms
    work       arithmetic of a fragment                    all other terms
    twice      all terms except vertices, doubled          vertices

`stage_draws` has further kinds. All are drawn in one viewport of `placing.SIDE` px, in integers of
1/256 px; only draws of `twice` cover a pixel more than once. An implementation in another language
is correct if its checksums are equal.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, make_bare_frame
from harness.grid import SUBPIXEL, round_points
from harness.profile import placing, stage_draws
from harness.profile.placing import (
    DIRECTIONS,
    LEVEL,
    SIDE,
    SLANTED,
    Direction,
    Draw,
    make_jittered_mesh,
    make_unshared_triangles,
)

DESIGN_VERSION = 4  # pages of different versions have different draws

ASPECTS = (1, 2, 4, 8, 16, 32, 64)
# Areas in px^2 at which aspects are compared, with the number of triangles of a draw.
AREAS = {8: 1500, 64: 800}

ALMOST_EMPTY = ((2048, 1), (2048, 16))  # sizes in 1/256 px and numbers of triangles

# Base and height of triangles of one aspect, in 1/256 px: a quarter pixel to 128 px.
SIZES = (64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768)

# Base and height in 1/256 px, and numbers of triangles, at which the covering triangles and the
# quads of a draw take about as long on an H200.
BALANCED_SIZES = ((2560, 1000), (3072, 1000), (3584, 1000))

SMALL_TRIANGLES = 3000  # number in a draw of small triangles

# Sizes in 1/256 px and numbers of triangles that have equal helper lanes, within 4 %.
EQUAL_LANES = ((1024, 2880), (2048, 1440), (4096, 720), (8192, 360), (16384, 180))

# Width in px, corners, and width / height of convex polygons with several triangulations.
RINGS = ((12, 16, 1), (48, 16, 1), (48, 64, 1), (192, 16, 1), (192, 64, 1), (192, 32, 8))

# Step in 1/256 px and height in px of strips as wide as the viewport.
STRIPS = ((256, 16), (1024, 16), (4096, 16), (512, 64))

# Length in px, height in 1/256 px and number of triangles thinner than a pixel.
SLIVERS = ((64, 16, 2000), (64, 64, 2000), (16, 16, 2000))

# Length in px, height in 1/256 px and number of thin triangles as long as those of large polygons.
# Rotation enlarges their boxes far more than any other term. Without them the fit attributes the
# misfit of small triangles to boxes, and is wrong about large triangles.
LONG_THIN = ((256, 256, 200), (256, 2048, 60), (448, 1024, 40))

MESHES = (2, 16)
# Sides in px of meshes, and indices into `RINGS`, drawn with shared and with unshared vertices.
SHARED_RINGS = (0, 2)

WORK_ROUNDS = (16, 64)  # rounds of arithmetic of a fragment

# Sides in px of meshes drawn with arithmetic. An H200 shades the quads of neighbouring triangles
# together: a round in a lane takes 9 to 11 ps in scenes and for triangles of 16 px, but 21 ps for
# scattered thin triangles.
WORK_MESHES = (2, 4)

# Rounds of arithmetic in meshes: on an H200 it then takes about as long as triangles or pixels, so
# that the sum and the maximum of the stages differ most.
MESH_ROUNDS = (8, 16)


def make_draws(seed: int = 0) -> list[Draw]:
    """Return the draws of a profile; those of earlier versions of the design come first."""
    kinds = (
        _yield_equal_shapes("few", 0, ALMOST_EMPTY, seed),
        _yield_aspects(seed),
        _yield_equal_shapes("size", 200, ((side, SMALL_TRIANGLES) for side in SIZES), seed),
        _yield_equal_shapes("lanes", 300, EQUAL_LANES, seed),
        _yield_positions(seed),
        _yield_cuts(seed),
        _yield_strips(seed),
        _yield_thin(seed),
        _yield_vertices(seed),
        _yield_work(seed),
        _yield_repeated(seed),
        _yield_equal_shapes("size", 210, BALANCED_SIZES, seed),
        stage_draws.make_stage_draws(seed),
        _yield_work_in_meshes(seed),
    )
    return [draw for kind in kinds for draw in kind]


def snap_draw(draw: Draw, step: int) -> Draw:
    """Return the draw with its points on multiples of `step`/256 px, as on a coarser grid."""
    points = round_points(draw.frame.points, step)
    return draw if step == 1 else replace(draw, frame=make_bare_frame(SIDE, points))


def compute_triangle_sides(area: int, aspect: int) -> tuple[int, int]:
    """Return base and height in 1/256 px, rounded down, of a triangle with `area` px^2."""
    doubled = 2 * area * SUBPIXEL * SUBPIXEL
    height = isqrt(doubled // aspect)
    return doubled // height, height


def _scatter_triangles(
    base: int, height: int, direction: Direction, count: int, numbers: tuple[int, int]
) -> tuple[Frame, NDArray[np.int32]]:
    """Return up to `count` triangles of equal size without shared vertices, and their frame.

    base, height : in 1/256 px; numbers : seed, and number of the draw
    """
    shape = placing.make_triangle_shape(base, height)
    points = placing.place_shapes(
        shape, (base, height), direction, placing.hash_numbers(*numbers, count)
    )
    return make_unshared_triangles(points)


def _yield_aspects(seed: int) -> Iterator[Draw]:
    variants = product(AREAS.items(), DIRECTIONS, ASPECTS)
    for number, ((area, count), direction, aspect) in enumerate(variants, 101):
        geometry = _scatter_triangles(
            *compute_triangle_sides(area, aspect), direction, count, (seed, number)
        )
        name = f"{area} px^2, {aspect}:1, turned {direction.x}/{direction.y}"
        yield Draw("aspect", name, f"aspect {area}", *geometry, aspect=aspect, area=area)


def _yield_equal_shapes(
    kind: str, first: int, shapes: Iterable[tuple[int, int]], seed: int
) -> Iterator[Draw]:
    """Yield draws of triangles of aspect 1; shapes : base in 1/256 px, and number of triangles."""
    for number, (side, count) in enumerate(shapes, first):
        geometry = _scatter_triangles(side, side, SLANTED, count, (seed, number))
        number_of = "" if count == SMALL_TRIANGLES else f"{count} triangles of "
        yield Draw(kind, f"{number_of}{side / SUBPIXEL:g} px", kind, *geometry)


def _yield_positions(seed: int) -> Iterator[Draw]:
    """Yield triangles in 4-px boxes at the same offset from a corner of the 8-px grid."""
    side, across = 4 * SUBPIXEL, 52  # 52 by 52 boxes, 16 px apart, fill the viewport
    number = np.arange(across * across)
    cell = np.stack([number % across, number // across], axis=-1) * 16 + 96
    local = placing.make_triangle_shape(side, side)(placing.hash_numbers(seed, 320, len(number)))
    for start in range(4):
        geometry = make_unshared_triangles(
            (local + (cell[:, None] + start) * SUBPIXEL).astype(np.int32)
        )
        yield Draw("places", f"boxes of 4 px from pixel {start}", "places", *geometry)


def _make_rings(seed: int, index: int) -> tuple[Frame, NDArray[np.int32]]:
    """Return copies of `RINGS[index]` that fill the viewport, and each copy's first point, (k,)."""
    width, corners, flat = RINGS[index]
    size = width * SUBPIXEL, width * SUBPIXEL // flat
    outline = placing.make_ellipse_ring(corners, *size)
    count = max(1, SMALL_TRIANGLES // (corners - 2))
    numbers = placing.hash_numbers(seed, 400 + index, count)
    points = placing.place_shapes(lambda _: outline[None], size, SLANTED, numbers)
    starts = np.arange(len(points), dtype=np.int32) * corners
    return make_bare_frame(SIDE, points.reshape(-1, 2)), starts


def _yield_cuts(seed: int) -> Iterator[Draw]:
    for index, (width, corners, flat) in enumerate(RINGS):
        frame, starts = _make_rings(seed, index)
        for cut_name, cut in placing.RING_TRIANGULATIONS.items():
            triangles = (cut(corners) + starts[:, None, None]).reshape(-1, 3)
            name = f"rings of {width} by {width // flat} px, {corners} corners, {cut_name}"
            geometry = make_unshared_triangles(frame.points[triangles])
            yield Draw("cuts", name, f"cuts {width} {corners}", *geometry)


def _yield_strips(seed: int) -> Iterator[Draw]:
    width = (SIDE - 8) * SUBPIXEL
    for number, (step, height) in enumerate(STRIPS):
        steps = width // step
        bands = min((SIDE - 8) // (height + 2), max(1, SMALL_TRIANGLES // (2 * steps)))
        numbers = placing.hash_numbers(seed, 500 + number, bands * 2 * (steps + 1))
        jitter = numbers.reshape(bands, 2, steps + 1)
        low = 4 * SUBPIXEL + np.arange(bands) * (height + 2) * SUBPIXEL
        # Vertices 0 to `steps` along the bottom of a band, then as many along its top: the vertex
        # above k is k + steps + 1. No two triangles are congruent.
        ends = np.stack([low, low + height * SUBPIXEL], axis=-1)[:, :, None]
        x = 3 * SUBPIXEL + np.arange(steps + 1) * step + jitter % (step // 2)
        y = ends + jitter // SUBPIXEL % SUBPIXEL
        points = np.stack([x, y], axis=-1).reshape(-1, 2)
        k = np.arange(steps)
        first = np.stack([k, k + 1, k + steps + 1], axis=-1)
        second = np.stack([k + 1, k + steps + 2, k + steps + 1], axis=-1)
        band = np.stack([first, second], axis=1).reshape(-1, 3)
        starts = np.arange(bands) * 2 * (steps + 1)
        triangles = (band + starts[:, None, None]).reshape(-1, 3).astype(np.int32)
        name = f"steps of {step / SUBPIXEL:g} px, {height} px high"
        geometry = make_unshared_triangles(points.astype(np.int32)[triangles])
        yield Draw("strips", name, "strips", *geometry)


def _yield_thin(seed: int) -> Iterator[Draw]:
    for kind, sizes, directions, first in (
        ("slivers", SLIVERS, (LEVEL, SLANTED), 601),
        ("long", LONG_THIN, DIRECTIONS, 621),
    ):
        variants = product(sizes, directions)
        for number, ((length, height, count), direction) in enumerate(variants, first):
            geometry = _scatter_triangles(
                length * SUBPIXEL, height, direction, count, (seed, number)
            )
            name = f"{length} by {height / SUBPIXEL:g} px, turned {direction.x}/{direction.y}"
            yield Draw(kind, name, kind, *geometry)


def _yield_vertices(seed: int) -> Iterator[Draw]:
    shared = [(f"a mesh of {side} px", *_make_mesh(seed, side)) for side in MESHES]
    for index in SHARED_RINGS:
        width, corners, _ = RINGS[index]
        frame, starts = _make_rings(seed, index)
        ring = placing.triangulate_ring_by_halving(corners)
        triangles = (ring + starts[:, None, None]).reshape(-1, 3)
        # Every other triangle, so that the draw differs from those of the kind cuts.
        shared.append((f"half of rings of {width} px", frame, triangles[::2]))
    for name, frame, triangles in shared:
        yield Draw("vertices", f"{name}, shared", f"vertices {name}", frame, triangles)
        geometry = make_unshared_triangles(frame.points[triangles])
        yield Draw("vertices", f"{name}, unshared", f"vertices {name}", *geometry)


def _make_mesh(seed: int, side: int) -> tuple[Frame, NDArray[np.int32]]:
    across = min(40, (SIDE - 8) // side)
    numbers = placing.hash_numbers(seed, 650 + side, (across + 1) ** 2)
    points, triangles = make_jittered_mesh(across, across, side * SUBPIXEL, numbers)
    return make_bare_frame(SIDE, points), triangles


def _yield_work(seed: int) -> Iterator[Draw]:
    shapes = (("16 px", (4096, 4096), 300), ("8 px^2, 64:1", compute_triangle_sides(8, 64), 800))
    for number, (name, size, count) in enumerate(shapes):
        geometry = _scatter_triangles(*size, SLANTED, count, (seed, 700 + number))
        for work in (0, *WORK_ROUNDS):
            yield Draw("work", f"{name}, {work} rounds", f"work {name}", *geometry, work=work)


def _yield_work_in_meshes(seed: int) -> Iterator[Draw]:
    for side in WORK_MESHES:
        geometry = _make_mesh(seed, side)
        for work in MESH_ROUNDS:
            name = f"a mesh of {side} px, {work} rounds"
            yield Draw("work", name, f"work mesh {side}", *geometry, work=work)


def _yield_repeated(seed: int) -> Iterator[Draw]:
    for number, (side, count) in enumerate(((1024, 2000), (8192, 300))):
        frame, triangles = _scatter_triangles(side, side, SLANTED, count, (seed, 800 + number))
        for times in (1, 2):
            name = f"{side / SUBPIXEL:g} px, {times} times"
            yield Draw("twice", name, f"twice {side}", frame, np.tile(triangles, (times, 1)))
