"""How Skybox's tile evaluator goes down a tile, counted without its design.

A reference: whoever doubts a count or a cycle of the simulated slice finds it here by another way.
"""

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.rasterisers import Triangles
from harness.rasterisers.simulated.skybox import work
from triangulators.compute.kernels import njit

LATENCY = 2
"""Cycles after which the tile evaluator sees what it put into a queue."""


def descent(
    frame: Frame, triangles: Triangles, tile: int = 32, block: int = 4
) -> NDArray[np.int64]:
    """Return what `descended` counts of triangles that are put into tiles as Skybox does it."""
    whole = np.array([0, 0, frame.width - 1, frame.height - 1], np.int64)
    todo = work(frame.points, triangles, [slice(0, len(triangles))], whole, tile, exact=False)
    return descended(todo.edges, todo.pairs, tile, block)


@njit(error_model="numpy", inline="always")
def _passes(edge: NDArray[np.int32], x: np.int64, y: np.int64, side: np.int64) -> bool:
    """Whether no edge has the square wholly outside, at the corner that lies furthest inside."""
    for k in range(3):
        a, b, c = np.int64(edge[k, 0]), np.int64(edge[k, 1]), np.int64(edge[k, 2])
        grows = (a if a > 0 else 0) + (b if b > 0 else 0)
        if a * x + b * y + c + grows * side < 0:
            return False
    return True


@njit(error_model="numpy", inline="always")
def _first_ready(
    queues: NDArray[np.int64], first: NDArray[np.int64], end: NDArray[np.int64], cycle: np.int64
) -> int:
    """First queue from which something can be taken in a cycle, or -1."""
    for k in range(4):
        if first[k] < end[k] and queues[k, first[k], 3] <= cycle:
            return k
    return -1


@njit(error_model="numpy")
def descended(
    edges: NDArray[np.int32], pairs: NDArray[np.int32], tile: int, block: int
) -> NDArray[np.int64]:
    """Count what is tested on the way down: (m, 3), squares, blocks that pass, and cycles.

    The cycles are those of Skybox's tile evaluator where nothing holds it up. It tests a square a
    cycle. One that passes and is no block is known in the next cycle to have passed. Then its four
    quarters go into four queues, by their place, and can be taken from there `LATENCY` cycles
    later, the first queue first; but where all queues are empty, the first quarter is tested in the
    cycle after. A new tile is taken in a cycle with nothing to test.

    edges : (m, 3, 3), a, b and c of a triangle's edge functions, 0 at pixel (0, 0)
    pairs : (n, 3), a triangle and the lower left pixel of a tile
    tile, block : sides of the largest and the smallest square, px, powers of two
    """
    counts = np.zeros((len(edges), 3), np.int64)
    most = (tile // block) ** 2 + 1
    queues = np.empty((4, most, 4), np.int64)  # x, y, side, first cycle in which it can be taken
    for pair in range(len(pairs)):
        triangle = pairs[pair, 0]
        edge = edges[triangle]
        first, end = np.zeros(4, np.int64), np.zeros(4, np.int64)
        x, y, side = np.int64(pairs[pair, 1]), np.int64(pairs[pair, 2]), np.int64(tile)
        cycle = np.int64(1)  # the tile was taken in cycle 0
        testing, waiting = True, 0
        last = cycle
        passed, passed_x, passed_y, passed_side = False, x, y, side
        while testing or passed or waiting:
            # what passed in the cycle before is parted; which queue, if any, is taken from?
            taken = _first_ready(queues, first, end, cycle)
            next_testing = taken >= 0
            next_x, next_y, next_side = x, y, side
            if taken >= 0:
                next_x, next_y, next_side = queues[taken, first[taken], :3]
                first[taken] += 1
                waiting -= 1
            if passed:
                half = passed_side // 2
                for k in range(4):
                    place = passed_x + (k // 2) * half, passed_y + (k % 2) * half
                    if k == 0 and taken < 0:
                        next_testing = True
                        next_x, next_y, next_side = place[0], place[1], half
                        continue
                    queues[k, end[k]] = place[0], place[1], half, cycle + LATENCY
                    end[k] += 1
                    waiting += 1
            passed = False
            if testing:
                last = cycle
                counts[triangle, 0] += 1
                inside = _passes(edge, x, y, side)
                if inside and side == block:
                    counts[triangle, 1] += 1
                elif inside:
                    passed, passed_x, passed_y, passed_side = True, x, y, side
            testing, x, y, side = next_testing, next_x, next_y, next_side
            cycle += 1
        counts[triangle, 2] += last + 1
    return counts
