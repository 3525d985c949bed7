"""One name, one result: a single call, a batch and the drop-in cost the same."""

import numpy as np
import pytest
import shapely

from tests.triangulators.cases import random_simple
from triangulators import triangulate, triangulate_many, vertices
from triangulators.criteria import find
from triangulators.dropin import triangulate_float64
from triangulators.polygon import rings_of
from triangulators.verify import verify

# The batch once gave this one 0.34, on no grid; the optimum is 0.31.
OFF_GRID = shapely.from_wkt(
    "POLYGON ((0.3 0.5, 0.4 0.6000000000000001, 0.5 0.7000000000000001, 0.7000000000000001 0.2,"
    " 0.6000000000000001 0.1, 0.5 0.1, 0.3 0, 0.2 0, 0.6000000000000001 0.2, 0.3 0.5))"
)


def polygons(scale: float, count: int, seed: int = 17) -> list[shapely.Polygon]:
    """Random polygons with 0 to 8 holes on a grid that `scale` may take off it."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        polygon = random_simple(rng, int(rng.integers(4, 14)), 24)
        for _ in range(len(found) % 9 * 6):
            ring = shapely.get_coordinates(random_simple(rng, 3, 4))[:-1] + rng.integers(0, 20, 2)
            cut = shapely.Polygon(polygon.exterior, [*polygon.interiors, ring])
            if cut.is_valid and len(cut.interiors) <= len(found) % 9:
                polygon = cut
        moved = shapely.transform(polygon, lambda points: points * scale)
        if moved.is_valid:
            found.append(moved)
    assert max(len(polygon.interiors) for polygon in found) >= 4
    return found


@pytest.mark.parametrize("scale", [1.0, 0.1, 1 / 3], ids=["grid", "tenths", "thirds"])
@pytest.mark.parametrize("criterion", ["half-perimeter", "overdraw"])
def test_single_batch_and_drop_in_cost_the_same(scale, criterion):
    chosen = [*polygons(scale, 72), OFF_GRID]
    name, total = f"optimal:{criterion}", find(criterion).total
    many = triangulate_many(chosen, name)
    assert many.failed == {}
    for number, polygon in enumerate(chosen):
        points = vertices(polygon)
        least = total(points, triangulate(polygon, name))
        assert verify(polygon, many[number]).conforming
        assert total(points, many[number]) == pytest.approx(least, rel=1e-12), polygon.wkt
        if criterion == "half-perimeter":
            dropped = (
                triangulate_float64(*rings_of(polygon), "optimal").reshape(-1, 3).astype(np.int32)
            )
            assert total(points, dropped) == pytest.approx(least, rel=1e-12), polygon.wkt
