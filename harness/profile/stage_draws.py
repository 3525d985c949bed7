"""Draws that separate the stages of a GPU: vertices, triangles that cover samples, and quads.

    kind       differs among its draws                     equal among its draws
    orders     batches and transformed vertices            all other terms
    samples    covering triangles, and so pixels, quads    triangles, size, transformed vertices
    tiles      tiles that triangles overlap                all other terms
    mixed      one or two of three populations             the populations, each of which keeps
                                                           another stage busy for about as long

On a device whose stages work at the same time, a mixed draw takes about as long as either of its
populations; on a device that adds the stages' times, about twice as long.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from harness.frame import make_bare_frame
from harness.grid import SUBPIXEL
from harness.profile import placing
from harness.profile.placing import SIDE, Draw, make_jittered_mesh, make_unshared_triangles

STAGE_KINDS = ("orders", "samples", "tiles", "mixed")
"""Kinds whose draws differ in what no criterion predicts."""

# Sides of the squares of meshes in 1/256 px: few, half or nearly all triangles cover a sample.
MESH_SIDES = (128, 256, 512)

MESH_ACROSS, MESH_ALONG = 60, 28  # squares of a mesh in x and y, multiples of `PATCH`

# Squares in x and y of a patch, whose 32 triangles and 25 vertices fit in one vertex batch: 0.78
# vertices per triangle. No order has the 0.5 of an infinite mesh, as 32 triangles of a planar mesh
# have at least 19 vertices.
PATCH = 4

# Lengths of runs of triangles that follow each other in a strip, by transformed vertices per
# triangle: a run of n triangles has n + 2 vertices, and consecutive runs share none.
RUN_LENGTHS = {
    "1.07": (30,),
    "1.5": (4,),
    "2": (2,),
    "2.5": (1, 1, 2),
    "3": (1,),
}

RUN_STRIDE = 1033  # distance of consecutive runs, a prime that divides no number of runs
SMALL_SIDE = 128  # legs of isolated triangles in 1/256 px: shorter than the distance of samples

# Offsets from a pixel's corner in 1/256 px, at which a triangle of `SMALL_SIDE` covers the sample
# in the pixel's centre, or none; jitter moves a triangle by less than `SAMPLE_JITTER`.
ON_SAMPLE, OFF_SAMPLE = 80, 144

SAMPLE_JITTER = 32

COVERING_QUARTERS = (0, 1, 2, 3, 4)  # quarters of the triangles that cover a sample

# x in px, modulo 64, of the lines on which triangles are centred.
TILE_LINES = {
    "inside tiles of 16 px": 8,
    "across 16 px": 16,
    "across 32 px": 32,
    "across 64 px": 64,
}

TILE_BOXES = ((4, 8), (12, 16))  # boxes of triangles and their distance in y, in px

Population = tuple[NDArray[np.int32], NDArray[np.int32]]  # points (n, 2) and triangles (m, 3)


def make_stage_draws(seed: int) -> Iterator[Draw]:
    """Yield the draws of all kinds, in the order of the module's table."""
    yield from _yield_orders(seed)
    yield from _yield_samples(seed)
    yield from _yield_tiles(seed)
    yield from _yield_mixed(seed)


def _yield_orders(seed: int) -> Iterator[Draw]:
    """Yield draws of the same meshes in orders with few to many transformed vertices."""
    for number, side in enumerate(MESH_SIDES, 901):
        numbers = placing.hash_numbers(seed, number, (MESH_ACROSS + 1) * (MESH_ALONG + 1))
        points, triangles = make_jittered_mesh(MESH_ACROSS, MESH_ALONG, side, numbers)
        orders = {"0.78": _order_patches(), **{n: _order_runs(r) for n, r in RUN_LENGTHS.items()}}
        for name, rows in orders.items():
            group = f"orders {side / SUBPIXEL:g}"
            label = f"{name} vertices per triangle, squares of {side / SUBPIXEL:g} px"
            yield Draw("orders", label, group, make_bare_frame(SIDE, points), triangles[rows])


def _order_patches() -> NDArray[np.int64]:
    shape = (MESH_ALONG // PATCH, PATCH, MESH_ACROSS // PATCH, PATCH * 2)
    rows = np.arange(2 * MESH_ACROSS * MESH_ALONG).reshape(shape)
    return rows.swapaxes(1, 2).ravel()


def _order_runs(pattern: Sequence[int]) -> NDArray[np.int64]:
    """Return indices of a mesh's triangles in distant runs, whose lengths repeat `pattern`."""
    size = 2 * MESH_ACROSS * MESH_ALONG
    lengths = np.tile(pattern, size // sum(pattern))
    starts = np.cumsum(lengths) - lengths
    runs = np.arange(len(starts)) * RUN_STRIDE % len(starts)
    return np.concatenate([np.arange(starts[k], starts[k] + lengths[k]) for k in runs])


def _make_grid(
    count: int, columns: int, pitch: tuple[int, int], start: tuple[int, int]
) -> placing.Points:
    """Return corners (count, 2) of cells in 1/256 px, row by row; pitch and start in px."""
    row, column = np.divmod(np.arange(count), columns)
    return np.asarray((np.stack([column, row], axis=-1) * pitch + start) * SUBPIXEL, np.int64)


def _make_jitter(numbers: NDArray[np.int64]) -> placing.Points:
    """Return offsets (k, 2) from 0 to `SAMPLE_JITTER` - 1, given 32-bit hashes (k,)."""
    return np.stack([numbers % SAMPLE_JITTER, numbers // SUBPIXEL % SAMPLE_JITTER], axis=-1)


def _make_small_triangles(
    cells: placing.Points, numbers: NDArray[np.int64], quarters: int
) -> Population:
    """Return an isolated triangle in each cell; `quarters` of four cover one sample each."""
    covers = np.arange(len(cells)) % 4 < quarters
    corners = cells + np.where(covers, ON_SAMPLE, OFF_SAMPLE)[:, None] + _make_jitter(numbers)
    shape = np.array([[0, 0], [SMALL_SIDE, 0], [0, SMALL_SIDE]])
    frame, triangles = make_unshared_triangles((corners[:, None] + shape).astype(np.int32))
    return frame.points, triangles


def _make_patches(cells: placing.Points, numbers: NDArray[np.int64], quarters: int) -> Population:
    """Return a patch (`PATCH`) in each cell; in `quarters` of four, each triangle covers a sample.

    There, squares are stretched to 1 by 2 px, so that each half contains a sample; in other
    patches, squares are shrunk to 1/8 px and lie between samples.
    """
    covers = (np.arange(len(cells)) % 4 < quarters)[:, None]
    squares = np.where(covers, (SUBPIXEL, 2 * SUBPIXEL), SMALL_SIDE // PATCH)
    corners = cells + np.where(covers, 0, OFF_SAMPLE) + _make_jitter(numbers)
    line = PATCH + 1
    row, column = np.divmod(np.arange(line * line), line)
    points = corners[:, None] + np.stack([column, row], axis=-1) * squares[:, None]
    _, one = make_jittered_mesh(PATCH, PATCH, 2, np.zeros(line * line, np.int64))
    starts = np.arange(len(cells)) * line * line
    triangles = (one + starts[:, None, None]).reshape(-1, 3)
    return points.reshape(-1, 2).astype(np.int32), triangles.astype(np.int32)


def _yield_samples(seed: int) -> Iterator[Draw]:
    numbers = placing.hash_numbers(seed, 911, 3000)
    cells = _make_grid(3000, 60, (4, 4), (8, 8))
    for quarters in COVERING_QUARTERS:
        name = f"{quarters} of 4 isolated triangles on a sample"
        population = _make_small_triangles(cells, numbers, quarters)
        yield _make_draw("samples", name, "samples isolated", population)
    numbers = placing.hash_numbers(seed, 912, 96)
    cells = _make_grid(96, 12, (8, 12), (8, 8))
    for quarters in COVERING_QUARTERS[::2]:
        name = f"{quarters} of 4 patches on samples"
        population = _make_patches(cells, numbers, quarters)
        yield _make_draw("samples", name, "samples patches", population)


def _yield_tiles(seed: int) -> Iterator[Draw]:
    for number, (side, pitch) in enumerate(TILE_BOXES, 921):
        lines, rows = SIDE // 64 - 1, SIDE // pitch - 2
        numbers = placing.hash_numbers(seed, number, lines * rows)
        shape = placing.make_triangle_shape(side * SUBPIXEL, side * SUBPIXEL)(numbers)
        for name, line in TILE_LINES.items():
            start = line - side // 2, pitch + (pitch - side) // 2
            cells = _make_grid(lines * rows, lines, (64, pitch), start)
            geometry = make_unshared_triangles((shape + cells[:, None]).astype(np.int32))
            yield Draw("tiles", f"boxes of {side} px {name}", f"tiles {side}", *geometry)


def _yield_mixed(seed: int) -> Iterator[Draw]:
    """Yield draws of three sets of triangles, each bound by another stage, alone and in pairs.

    On an H200 each takes 4.4 to 4.6 us: 19.9 ns per vertex batch of isolated triangles between
    samples; 2.5 ns per small triangle that covers a sample; 158 ns per triangle of 64 px.
    """
    numbers = [placing.hash_numbers(seed, number, 2200) for number in (931, 932, 933)]
    small = _make_small_triangles(_make_grid(2200, 100, (4, 4), (8, 8)), numbers[0], 0)
    patches = _make_patches(_make_grid(57, 48, (8, 12), (8, 128)), numbers[1][:57], 4)
    shapes = placing.make_triangle_shape(64 * SUBPIXEL, 64 * SUBPIXEL)(numbers[2][:28])
    corners = shapes + _make_grid(28, 14, (68, 68), (8, 256))[:, None]
    frame, triangles = make_unshared_triangles(corners.astype(np.int32))
    large = frame.points, triangles
    populations = {"vertices": (small, 10), "covering": (patches, 32), "quads": (large, 1)}
    for name, (population, _) in populations.items():
        yield _make_draw("mixed", f"{name} alone", "mixed", population)
    for one, other in combinations(populations, 2):
        first, second = populations[one], populations[other]
        pairs = ((first, second), (second, first))
        keys = np.concatenate([_compute_interleaving_keys(*pair) for pair in pairs])
        order = np.argsort(keys, kind="stable")
        joined = _join_populations(first[0], second[0])
        yield _make_draw("mixed", f"{one} and {other}, interleaved", "mixed", joined, order)
    joined = _join_populations(populations["vertices"][0], populations["quads"][0])
    yield _make_draw("mixed", "vertices, then quads", "mixed", joined)


def _compute_interleaving_keys(
    population: tuple[Population, int], other: tuple[Population, int]
) -> NDArray[np.int64]:
    """Return sort keys (m,) that spread a population's blocks evenly among those of another."""
    ((_, triangles), block), ((_, others), other_block) = population, other
    other_blocks = -(-len(others) // other_block)
    return (2 * (np.arange(len(triangles)) // block) + 1) * other_blocks


def _join_populations(one: Population, other: Population) -> Population:
    points, triangles = zip(one, other, strict=True)
    shifted = (triangles[0], triangles[1] + np.int32(len(points[0])))
    return np.concatenate(points), np.concatenate(shifted)


def _make_draw(
    kind: str,
    name: str,
    group: str,
    population: Population,
    order: NDArray[np.int64] | slice = slice(None),
) -> Draw:
    points, triangles = population
    return Draw(kind, name, group, make_bare_frame(SIDE, points), triangles[order])
