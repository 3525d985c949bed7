"""Counts the squares that a descent tests, without a design: any tile, any block, any viewport.

docs/theory.md, "Squares on the way down", says why that number is a cost and follows H. Two counts:

`met` is geometry: squares of a side whose inside meets the triangle's inside. Its mean over
positions is the law of squares.

`descended` is what hardware does. A square passes if no edge has it wholly outside, at the corner
that lies furthest inside, tested at pixels' centres and with the corner one pixel too far out. That
lets squares pass that the triangle does not meet: beside its corners, where two half planes
overlap, and within a pixel of its edges.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from harness.frame import SUBPIXEL, WHOLE
from harness.rasterisers.base import Triangles
from harness.rasterisers.binning import count_tiles
from triangulators.compute.kernels import njit

DRAW, TILE, ENTERED, NODE = 3, 1, 2, 1
"""Cycles that Skybox's slice takes for a draw, a triangle in a tile, a tile that is gone down into,
and a square tested, where nothing waits for its output. The tile evaluator tests a square a cycle;
it takes a new tile when it has nothing left to test, in a cycle that tests none; and when a tile
passes, its quarters take two cycles to come back for testing. Later levels hide that: while they
are on their way, others wait in the queues. Rounded from a fit to random triangles, none of a
scene's."""


def met(
    points: NDArray[np.int32], triangles: Triangles, sides: Sequence[int]
) -> dict[int, NDArray[np.int64]]:
    """Return, for each side in px, how many squares of it each triangle (m, 3) meets, (m,)."""
    return {side: count_tiles(points, triangles, side * SUBPIXEL, WHOLE)[:, 1] for side in sides}


def mean_met(
    area: NDArray[np.float64], half_perimeter: NDArray[np.float64], side: float
) -> NDArray[np.float64]:
    """Return the mean of `met` over positions, from area (px^2) and half-perimeter (px)."""
    return 1.0 + half_perimeter / side + area / side**2


@njit(error_model="numpy")
def descended(
    edges: NDArray[np.int32], pairs: NDArray[np.int32], tile: int, block: int
) -> NDArray[np.int64]:
    """Count what is tested on the way down: (m, 3), squares, tiles that pass, blocks that pass.

    edges : (m, 3, 3), a, b and c of a triangle's edge functions, 0 at pixel (0, 0)
    pairs : (n, 3), a triangle and the lower left pixel of a tile
    tile, block : sides of the largest and the smallest square, px, powers of two
    """
    counts = np.zeros((len(edges), 3), np.int64)
    stack = np.empty((64, 3), np.int64)
    for pair in range(len(pairs)):
        edge = edges[pairs[pair, 0]]
        stack[0, 0], stack[0, 1], stack[0, 2] = pairs[pair, 1], pairs[pair, 2], tile
        depth = 1
        while depth:
            depth -= 1
            x, y, side = stack[depth]
            counts[pairs[pair, 0], 0] += 1
            passes = True
            for k in range(3):
                a, b, c = np.int64(edge[k, 0]), np.int64(edge[k, 1]), np.int64(edge[k, 2])
                grows = (a if a > 0 else 0) + (b if b > 0 else 0)
                if a * x + b * y + c + grows * side < 0:
                    passes = False
            if not passes:
                continue
            if side == tile:
                counts[pairs[pair, 0], 1] += 1
            if side == block:
                counts[pairs[pair, 0], 2] += 1
                continue
            half = side // 2
            for i in range(2):
                for j in range(2):
                    stack[depth, 0], stack[depth, 1] = x + i * half, y + j * half
                    stack[depth, 2] = half
                    depth += 1
    return counts


def cycles(draws: int, tiles: int, entered: int, nodes: int) -> int:
    """Predict the cycles of draws whose output nothing holds up."""
    return DRAW * draws + TILE * tiles + ENTERED * entered + NODE * nodes
