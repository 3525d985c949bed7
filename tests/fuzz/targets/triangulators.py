"""Every triangulator on any polygon: a valid triangulation, and none better than the optimum."""

from typing import Any

import numpy as np
import shapely
from hypothesis import strategies as st

from tests.fuzz.target import target
from tests.triangulators.cases import Rings, all_triangulations, polygon_of, rings, twice_area
from tests.triangulators.test_everywhere import check
from triangulators import criteria, triangulate, vertices
from triangulators.verify import verify

STEERING = ("overdraw", "half-perimeter", "edge-length", "shape")


@target("triangulators", rings())
def check_triangulators(value: Rings) -> None:
    """What tests/triangulators checks of every triangulator, off the grid too."""
    assert check(polygon_of(value), value) > 0


@target("optimum", rings(max_vertices=8, max_holes=0, on_grid=True))
def check_optimum(value: Rings) -> None:
    """On the grid, where the listing by another program (GEOS decides for it) is exact."""
    polygon = polygon_of(value)
    points = vertices(polygon)
    if len(np.unique(points, axis=0)) < len(points):
        return  # the listing knows a vertex by its place
    everything = [np.array(each) for each in all_triangulations(polygon)]
    for criterion in STEERING:
        cost = criteria.find(criterion)
        costs = [cost.total(points, triangles) for triangles in everything]
        for name, expected in (("optimal", min(costs)), ("worst", max(costs))):
            total = cost.total(points, triangulate(polygon, f"{name}:{criterion}"))
            assert abs(total - expected) <= 1e-9 * max(costs), (name, criterion, total, expected)


change = st.fixed_dictionaries(
    {
        "do": st.sampled_from(["move a corner", "drop", "double", "turn round", "exchange"]),
        "row": st.integers(0, 100),
        "column": st.integers(0, 2),
        "vertex": st.integers(0, 100),
    }
)


@target(
    "verifier",
    st.fixed_dictionaries(
        {
            "rings": rings(max_vertices=12, max_holes=1, on_grid=True),
            "changes": st.lists(change, max_size=3),
        }
    ),
)
def check_verifier(value: dict[str, Any]) -> None:
    """Valid means: every triangle turns left, they fill the polygon, and none overlap."""
    polygon = polygon_of(value["rings"])
    points = vertices(polygon)
    triangles = triangulate(polygon, "greedy")
    for each in value["changes"]:
        triangles = _changed(triangles, len(points), each)
    shapes = [shapely.Polygon(points[row]) for row in triangles]
    left = all(twice_area(*points[row]) > 0 for row in triangles)
    # On the grid areas are exact, so shapes that fill it and add up to it cannot overlap.
    fills = shapely.union_all(shapes).symmetric_difference(polygon).area < 1e-9 * polygon.area
    adds_up = sum(twice_area(*points[row]) for row in triangles) == sum(
        twice_area(*points[row]) for row in triangulate(polygon, "greedy")
    )
    assert verify(polygon, triangles).ok == (left and fills and adds_up)


def _changed(triangles: np.ndarray, vertex_count: int, change: dict[str, Any]) -> np.ndarray:
    if not len(triangles):
        return triangles
    row, column = change["row"] % len(triangles), change["column"]
    spoilt = triangles.copy()
    if change["do"] == "drop":
        return np.delete(spoilt, row, axis=0)
    if change["do"] == "double":
        return np.vstack((spoilt, spoilt[row]))
    if change["do"] == "turn round":
        spoilt[row] = spoilt[row][::-1]
    elif change["do"] == "move a corner":
        spoilt[row, column] = change["vertex"] % vertex_count
    else:  # the other diagonal of two neighbours, which may or may not be inside
        other = change["vertex"] % len(triangles)
        shared = set(spoilt[row].tolist()) & set(spoilt[other].tolist())
        if len(shared) == 2:
            a, b = sorted(shared)
            # A triangle that was spoilt before may have a corner twice, and so no third one.
            third = [[v for v in spoilt[k].tolist() if v not in shared] for k in (row, other)]
            if all(third):
                (c, *_), (d, *_) = third
                spoilt[row], spoilt[other] = (a, c, d), (b, c, d)
    return spoilt
