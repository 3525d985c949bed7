"""An order of triangles for a vertex cache: Tipsify.

Source: P. V. Sander, D. Nehab, J. Barczak, "Fast triangle reordering for vertex locality and
reduced overdraw", ACM Transactions on Graphics 26(3), 2007, section 4. It takes linear time.

A first-in first-out cache of shaded vertices is assumed. All triangles around one vertex are given
one after another, a fan; then the next fan begins at a vertex that is still in the cache. Of those
it takes the one that entered the cache first, if its own fan can be given before it drops out:
a fan of r triangles shades at most 2 r new vertices. Where none is left, it goes back along the
vertices given, and then to the next vertex by number.
"""

import numpy as np

from triangulators.compute.arrays import grouped
from triangulators.compute.kernels import njit

CACHE_SIZE = 16
"""Shaded vertices that are assumed to be kept. GPUs keep 16 to 32 in each batch."""


def vertex_cache_order(
    triangles: np.ndarray, count: int, cache_size: int = CACHE_SIZE
) -> np.ndarray:
    """Return triangles (m, 3) of `count` points in the order of a vertex cache; none is turned."""
    rows = np.ascontiguousarray(triangles, dtype=np.int32)
    return rows[_rows_of(rows, count, cache_size)]


@njit(nogil=True)
def _rows_of(triangles: np.ndarray, count: int, cache_size: int) -> np.ndarray:
    """Return the (m,) rows of triangles in the order of Tipsify."""
    m = len(triangles)
    begin, places = grouped(triangles.reshape(-1), count)
    around = places // np.int32(3)  # the rows of each vertex's triangles
    left = np.diff(begin).astype(np.int32)  # how many of them are not given yet
    entered = np.zeros(count, dtype=np.int64)  # the time at which a vertex entered the cache
    time = cache_size + 1
    given = np.zeros(m, dtype=np.bool_)
    order = np.empty(m, dtype=np.int32)
    back = np.empty(3 * m, dtype=np.int32)  # vertices given, the last on top
    height, done, following = 0, 0, 0
    fan = 0 if count > 0 else -1
    while fan >= 0:
        bottom = height
        for at in range(begin[fan], begin[fan + 1]):
            row = around[at]
            if not given[row]:
                given[row] = True
                order[done] = row
                done += 1
                for corner in range(3):
                    vertex = triangles[row, corner]
                    back[height] = vertex
                    height += 1
                    left[vertex] -= 1
                    if time - entered[vertex] > cache_size:  # it is not in the cache: it is shaded
                        entered[vertex] = time
                        time += 1
        fan = _next_fan(back[bottom:height], left, entered, time, cache_size)
        while fan < 0 and height > 0:
            height -= 1
            if left[back[height]] > 0:
                fan = back[height]
        while fan < 0 and following < count:
            if left[following] > 0:
                fan = following
            following += 1
    return order


@njit(nogil=True)
def _next_fan(
    given: np.ndarray, left: np.ndarray, entered: np.ndarray, time: int, cache_size: int
) -> int:
    """Return which of the vertices just given the next fan is around; -1 where none has one."""
    fan, best = -1, -1
    for vertex in given:
        if left[vertex] > 0:
            age = time - entered[vertex]
            priority = age if age + 2 * left[vertex] <= cache_size else 0
            if priority > best:
                fan, best = vertex, priority
    return fan
