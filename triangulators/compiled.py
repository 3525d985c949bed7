"""Compiled code: made, where it is missing, before it is needed."""

import time
from collections.abc import Sequence

import shapely


def warm_up(names: Sequence[str]) -> float:
    """Call each of some triangulators once on small polygons; return the seconds it took.

    The first time on a machine that is the time to compile them, later next to nothing.

        >>> warm_up(["fan"]) > 0.0
        True
    """
    from triangulators.calling import triangulate
    from triangulators.errors import Skipped, Unavailable
    from triangulators.verify import verify

    holes = [[(2, 2), (2, 4), (4, 4)], [(6, 6), (6, 8), (8, 8)]]
    square = [(0, 0), (9, 0), (9, 9), (0, 9)]
    # On no grid, so that it takes the way that doubles take.
    bent = shapely.Polygon([(0.1, 0), (5, 1.3), (9, 0), (8, 9), (4.7, 7), (0, 9)])
    polygons = [shapely.Polygon(square), shapely.Polygon(square, holes), bent]
    start = time.perf_counter()
    for name in names:
        for polygon in polygons:
            try:
                verify(polygon, triangulate(polygon, name))
            except (Skipped, Unavailable):
                continue
    return time.perf_counter() - start
