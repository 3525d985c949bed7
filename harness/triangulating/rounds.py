"""Time triangulators on the same polygons, in rounds."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from shapely import Polygon

from harness.machine.system import cpu_clock
from harness.triangulating.recipes import Recipe
from harness.triangulating.result import FrameTriangulation
from harness.triangulating.triangulate import run_batch, warm_up
from triangulators.polygon_arrays import PolygonArray


def time_in_rounds(
    recipes: Sequence[Recipe], polygons: Sequence[Polygon], rounds: int, seed: int
) -> list[list[float]]:
    """Return for each triangulator the seconds that all polygons take it, once a round.

    Each round takes the triangulators in another order, as drawings are timed: drift of the machine
    affects all of them alike.
    """
    order = np.random.default_rng(seed)
    arrays = polygons if isinstance(polygons, PolygonArray) else PolygonArray.from_shapely(polygons)
    samples: list[list[float]] = [[] for _ in recipes]
    warm_up(*recipes)
    for _ in range(rounds):
        for index in order.permutation(len(recipes)).tolist():
            result = FrameTriangulation()
            batch = run_batch(recipes[index], arrays, result)
            for k, polygon in enumerate(polygons if len(batch) < len(arrays) else ()):
                if k not in batch:
                    start = cpu_clock()
                    with suppress(Exception, SystemExit, GeneratorExit):  # reported before
                        recipes[index].triangulate_with_gap(polygon)
                    result.seconds += cpu_clock() - start
            samples[index].append(result.seconds)
    return samples
