"""The draws of a profile: one list, made from a seed, each kind of which isolates a term or two.

    kind       what differs among its draws                what is equal
    few        triangles                                   their size
    aspect     aspect, angle, and so lanes and boxes       triangles, area
    size       size                                        aspect
    lanes      triangles, pixels                           helper lanes, half-perimeter
    places     helper lanes, blocks                        triangles, pixels, half-perimeter
    cuts       lanes, half-perimeter, boxes                triangles, vertices, pixels
    strips     triangles, half-perimeter                   pixels
    slivers    length, angle                               triangles; hardly any pixel
    long       angle, and so boxes                         what a box's pixels do not tell
    vertices   vertices                                    all else
    work       arithmetic of a fragment                    all else
    twice      everything but vertices, doubled            vertices

All are drawn in one viewport of `placing.SIDE` px, all coordinates are whole numbers of 1/256 px,
and no draw but those of `twice` covers a pixel more than once. Whoever makes the list in another
language has made the same one if the checksums are equal.
"""

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, bare_frame
from harness.grid import SUBPIXEL, coarsen
from harness.profile import placing
from harness.profile.placing import DIRECTIONS, LEVEL, SIDE, SLANTED, Direction

DESIGN = 2
"""Version of the list: a page of another version has other draws."""

ASPECTS = (1, 2, 4, 8, 16, 32, 64)
AREAS = {8: 1500, 64: 800}
"""Areas in px^2 at which aspects differ, and triangles of a draw."""

FEW = ((2048, 1), (2048, 16))
"""Sizes in 1/256 px and numbers of triangles of draws that have next to nothing in them."""

SIZES = (64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768)
"""Base and height of triangles of one aspect, in 1/256 px: a quarter pixel to 128 px."""

MOST = 3000
"""Triangles of a draw of small ones."""

EQUAL_LANES = ((1024, 2880), (2048, 1440), (4096, 720), (8192, 360), (16384, 180))
"""Sizes in 1/256 px and numbers of triangles that have equal helper lanes, within 4 %."""

RINGS = ((12, 16, 1), (48, 16, 1), (48, 64, 1), (192, 16, 1), (192, 64, 1), (192, 32, 8))
"""Width in px, corners and flatness of the convex polygons that are cut in several ways."""

STRIPS = ((256, 16), (1024, 16), (4096, 16), (512, 64))
"""Step in 1/256 px and height in px of strips as wide as the viewport."""

SLIVERS = ((64, 16, 2000), (64, 64, 2000), (16, 16, 2000))
"""Length in px, height in 1/256 px and number of triangles thinner than a pixel."""

LONG = ((256, 256, 200), (256, 2048, 60), (448, 1024, 40))
"""The same of thin triangles as long as those of large polygons.

Their boxes grow by far more than anything else when they are turned. Without them a law takes what
small triangles miss for a cost of boxes, and is wrong about large ones.
"""

MESHES = (2, 16)
SHARED_RINGS = (0, 2)
"""Sides in px of meshes, and places among `RINGS`, that are drawn with vertices shared or not."""

WORK = (16, 64)
"""Rounds of arithmetic of a fragment."""


@dataclass(frozen=True)
class Draw:
    """One draw of the design.

    kind, name : what it is for, and what it is
    group : draws that differ in what the kind isolates, and in nothing else
    frame, triangles : what is drawn, (m, 3) over the frame's points
    work : rounds of arithmetic of a fragment
    aspect, area : base in ratio to height, and area in px^2, of draws of the kind aspect; else 0
    """

    kind: str
    name: str
    group: str
    frame: Frame
    triangles: NDArray[np.int32]
    work: int = 0
    aspect: int = 0
    area: int = 0

    @property
    def checksum(self) -> int:
        """CRC-32 of the points, then the triangles, as 32-bit integers, the low byte first."""
        parts = (self.frame.points, self.triangles)
        return zlib.crc32(b"".join(np.ascontiguousarray(part, "<i4").tobytes() for part in parts))


def draws(seed: int = 0) -> list[Draw]:
    """Return the draws of the design, in the order of the table above."""
    kinds = (
        _alike("few", 0, FEW, seed),
        _aspects(seed),
        _alike("size", 200, ((side, MOST) for side in SIZES), seed),
        _alike("lanes", 300, EQUAL_LANES, seed),
        *(kind(seed) for kind in (_places, _cuts, _strips, _thin, _vertices, _work, _twice)),
    )
    return [draw for kind in kinds for draw in kind]


def snapped(draw: Draw, step: int) -> Draw:
    """Return the draw with its points moved to multiples of `step`/256 px.

    So devices draw it whose grid is coarser than ours.
    """
    points = coarsen(draw.frame.points, step)
    return draw if step == 1 else replace(draw, frame=bare_frame(SIDE, points))


def sides(area: int, aspect: int) -> tuple[int, int]:
    """Return base and height in 1/256 px of a triangle of `area` px^2, base / height = `aspect`.

    Both are rounded down, so area and aspect are met within the grid.
    """
    doubled = 2 * area * SUBPIXEL * SUBPIXEL
    height = isqrt(doubled // aspect)
    return doubled // height, height


def _scattered(
    base: int, height: int, direction: Direction, count: int, numbers: tuple[int, int]
) -> tuple[Frame, NDArray[np.int32]]:
    """Return triangles that share no vertex; numbers : seed, and number of the draw."""
    shape = placing.triangle(base, height)
    points = placing.placed(shape, (base, height), direction, placing.mixed(*numbers, count))
    return _loose(points)


def _loose(corners: NDArray[np.int32]) -> tuple[Frame, NDArray[np.int32]]:
    """Return (m, 3, 2) triangles, each with three vertices of its own.

    So all draws have three a triangle, but those that tell what a vertex costs.
    """
    rows = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return bare_frame(SIDE, corners.reshape(-1, 2)), rows


def _aspects(seed: int) -> Iterator[Draw]:
    each = product(AREAS.items(), DIRECTIONS, ASPECTS)
    for number, ((area, count), direction, aspect) in enumerate(each, 101):
        made = _scattered(*sides(area, aspect), direction, count, (seed, number))
        name = f"{area} px^2, {aspect}:1, turned {direction.x}/{direction.y}"
        yield Draw("aspect", name, f"aspect {area}", *made, aspect=aspect, area=area)


def _alike(kind: str, first: int, shapes: Iterable[tuple[int, int]], seed: int) -> Iterator[Draw]:
    """Yield triangles of one aspect; shapes : base and height in 1/256 px, and how many."""
    for number, (side, count) in enumerate(shapes, first):
        made = _scattered(side, side, SLANTED, count, (seed, number))
        name = f"{side / SUBPIXEL:g} px"
        yield Draw(kind, name if count == MOST else f"{count} triangles of {name}", kind, *made)


def _places(seed: int) -> Iterator[Draw]:
    """Triangles in boxes of 4 px, all boxes as far from a corner of the 8-px grid."""
    side, across = 4 * SUBPIXEL, 52  # 52 by 52 boxes, 16 px apart, fill the viewport
    number = np.arange(across * across)
    cell = np.stack([number % across, number // across], axis=-1) * 16 + 96
    local = placing.triangle(side, side)(placing.mixed(seed, 320, len(number)))
    for start in range(4):
        made = _loose((local + (cell[:, None] + start) * SUBPIXEL).astype(np.int32))
        yield Draw("places", f"boxes of 4 px from pixel {start}", "places", *made)


def _rings(seed: int, place: int) -> tuple[Frame, NDArray[np.int32]]:
    """Return one of `RINGS` as often as there is room, and where each copy's points begin."""
    width, corners, flat = RINGS[place]
    size = width * SUBPIXEL, width * SUBPIXEL // flat
    outline = placing.ring(corners, *size)
    count = max(1, MOST // (corners - 2))
    numbers = placing.mixed(seed, 400 + place, count)
    points = placing.placed(lambda _: outline[None], size, SLANTED, numbers)
    return bare_frame(SIDE, points.reshape(-1, 2)), np.arange(len(points), dtype=np.int32) * corners


def _cuts(seed: int) -> Iterator[Draw]:
    for place, (width, corners, flat) in enumerate(RINGS):
        frame, starts = _rings(seed, place)
        for way, cut in placing.WAYS.items():
            triangles = (cut(corners) + starts[:, None, None]).reshape(-1, 3)
            name = f"rings of {width} by {width // flat} px, {corners} corners, {way}"
            yield Draw("cuts", name, f"cuts {width} {corners}", *_loose(frame.points[triangles]))


def _strips(seed: int) -> Iterator[Draw]:
    width = (SIDE - 8) * SUBPIXEL
    for number, (step, height) in enumerate(STRIPS):
        steps = width // step
        bands = min((SIDE - 8) // (height + 2), max(1, MOST // (2 * steps)))
        random = placing.mixed(seed, 500 + number, bands * 2 * (steps + 1))
        stray = random.reshape(bands, 2, steps + 1)
        low = 4 * SUBPIXEL + np.arange(bands) * (height + 2) * SUBPIXEL
        # Vertices 0 to `steps` along the bottom of a band, then as many along its top: the vertex
        # above k is k + steps + 1. No two triangles are alike.
        ends = np.stack([low, low + height * SUBPIXEL], axis=-1)[:, :, None]
        x = 3 * SUBPIXEL + np.arange(steps + 1) * step + stray % (step // 2)
        y = ends + stray // SUBPIXEL % SUBPIXEL
        points = np.stack([x, y], axis=-1).reshape(-1, 2)
        k = np.arange(steps)
        first = np.stack([k, k + 1, k + steps + 1], axis=-1)
        second = np.stack([k + 1, k + steps + 2, k + steps + 1], axis=-1)
        band = np.stack([first, second], axis=1).reshape(-1, 3)
        starts = np.arange(bands) * 2 * (steps + 1)
        triangles = (band + starts[:, None, None]).reshape(-1, 3).astype(np.int32)
        name = f"steps of {step / SUBPIXEL:g} px, {height} px high"
        made = _loose(points.astype(np.int32)[triangles])
        yield Draw("strips", name, "strips", *made)


def _thin(seed: int) -> Iterator[Draw]:
    for kind, sizes, directions, first in (
        ("slivers", SLIVERS, (LEVEL, SLANTED), 601),
        ("long", LONG, DIRECTIONS, 621),
    ):
        each = product(sizes, directions)
        for number, ((length, height, count), direction) in enumerate(each, first):
            made = _scattered(length * SUBPIXEL, height, direction, count, (seed, number))
            name = f"{length} by {height / SUBPIXEL:g} px, turned {direction.x}/{direction.y}"
            yield Draw(kind, name, kind, *made)


def _vertices(seed: int) -> Iterator[Draw]:
    """Meshes of squares cut in two and rings, with shared vertices, and with three a triangle."""
    shared = [(f"a mesh of {side} px", *_mesh(seed, side)) for side in MESHES]
    for place in SHARED_RINGS:
        width, corners, _ = RINGS[place]
        frame, starts = _rings(seed, place)
        triangles = (placing.halved(corners) + starts[:, None, None]).reshape(-1, 3)
        # Every other triangle, so that no draw is that of another kind.
        shared.append((f"half of rings of {width} px", frame, triangles[::2]))
    for name, frame, triangles in shared:
        yield Draw("vertices", f"{name}, shared", f"vertices {name}", frame, triangles)
        made = _loose(frame.points[triangles])
        yield Draw("vertices", f"{name}, unshared", f"vertices {name}", *made)


def _mesh(seed: int, side: int) -> tuple[Frame, NDArray[np.int32]]:
    """Return squares of `side` px, their corners moved, each cut in two."""
    across = min(40, (SIDE - 8) // side)
    step = np.arange(across + 1) * side * SUBPIXEL + 4 * SUBPIXEL
    even = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    random = placing.mixed(seed, 650 + side, len(even))
    room = side * SUBPIXEL // 2
    points = even + np.stack([random % room, random // SUBPIXEL % room], axis=-1)
    k = np.arange(across)
    corner = (k[:, None] * (across + 1) + k).ravel()
    right, up = corner + 1, corner + across + 1
    halves = [np.stack([corner, right, up], -1), np.stack([right, up + 1, up], -1)]
    triangles = np.stack(halves, 1).reshape(-1, 3).astype(np.int32)
    return bare_frame(SIDE, points.astype(np.int32)), triangles


def _work(seed: int) -> Iterator[Draw]:
    shapes = (("16 px", (4096, 4096), 300), ("8 px^2, 64:1", sides(8, 64), 800))
    for number, (name, size, count) in enumerate(shapes):
        made = _scattered(*size, SLANTED, count, (seed, 700 + number))
        for work in (0, *WORK):
            yield Draw("work", f"{name}, {work} rounds", f"work {name}", *made, work=work)


def _twice(seed: int) -> Iterator[Draw]:
    for number, (side, count) in enumerate(((1024, 2000), (8192, 300))):
        frame, once = _scattered(side, side, SLANTED, count, (seed, 800 + number))
        for times in (1, 2):
            name = f"{side / SUBPIXEL:g} px, {times} times"
            yield Draw("twice", name, f"twice {side}", frame, np.tile(once, (times, 1)))
