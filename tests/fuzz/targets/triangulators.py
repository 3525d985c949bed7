"""Triangulators on random polygons: valid triangulations, none better than the optimum."""

from typing import Any

import numpy as np
import shapely
from hypothesis import strategies as st

from tests.fuzz.target import target
from tests.triangulators.cases import Rings, all_triangulations, polygon_of, rings, twice_area
from tests.triangulators.test_bridges import CRITERIA as BRIDGED
from tests.triangulators.test_bridges import check_against_brute_force
from tests.triangulators.test_everywhere import check
from triangulators import criteria, triangulate, vertices
from triangulators.verify import verify

MAX_BRUTE_FORCE_VERTICES = 13

CRITERIA = ("overdraw", "half-perimeter", "edge-length", "shape")


@target("triangulators", rings())
def check_triangulators(value: Rings) -> None:
    """Check every triangulator as tests/triangulators does, also off the grid."""
    assert check(polygon_of(value), value) > 0


@target("optimum", rings(max_vertices=8, max_holes=0, on_grid=True))
def check_optimum(value: Rings) -> None:
    """Compare with a list of all triangulations by GEOS, which is exact on the grid."""
    polygon = polygon_of(value)
    points = vertices(polygon)
    if len(np.unique(points, axis=0)) < len(points):
        return  # the list identifies vertices by position
    triangulations = [np.array(triangles) for triangles in all_triangulations(polygon)]
    for criterion in CRITERIA:
        cost = criteria.find(criterion)
        costs = [cost.total(points, triangles) for triangles in triangulations]
        for name, expected in (("optimal", min(costs)), ("worst", max(costs))):
            total = cost.total(points, triangulate(polygon, f"{name}:{criterion}"))
            assert abs(total - expected) <= 1e-9 * max(costs), (name, criterion, total, expected)


@target("optimum-with-holes", rings(max_vertices=7, max_holes=2, on_grid=True))
def check_optimum_with_holes(value: Rings) -> None:
    """Compare with a search over all sets of triangles in integers."""
    polygon = polygon_of(value)
    if len(vertices(polygon)) <= MAX_BRUTE_FORCE_VERTICES:
        for name in BRIDGED:
            check_against_brute_force(polygon, name)


change = st.fixed_dictionaries(
    {
        "action": st.sampled_from(["move vertex", "drop", "duplicate", "reverse", "flip"]),
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
    """Valid triangles are counter-clockwise, fill the polygon and do not overlap."""
    polygon = polygon_of(value["rings"])
    points = vertices(polygon)
    triangles = triangulate(polygon, "greedy")
    for edit in value["changes"]:
        triangles = _apply_change(triangles, len(points), edit)
    shapes = [shapely.Polygon(points[row]) for row in triangles]
    counter_clockwise = all(twice_area(*points[row]) > 0 for row in triangles)
    # Areas are exact on the grid: triangles that fill the polygon and have its area do not overlap.
    fills = shapely.union_all(shapes).symmetric_difference(polygon).area < 1e-9 * polygon.area
    adds_up = sum(twice_area(*points[row]) for row in triangles) == sum(
        twice_area(*points[row]) for row in triangulate(polygon, "greedy")
    )
    assert verify(polygon, triangles).ok == (counter_clockwise and fills and adds_up)


def _apply_change(triangles: np.ndarray, vertex_count: int, change: dict[str, Any]) -> np.ndarray:
    if not len(triangles):
        return triangles
    row, column = change["row"] % len(triangles), change["column"]
    changed = triangles.copy()
    if change["action"] == "drop":
        return np.delete(changed, row, axis=0)
    if change["action"] == "duplicate":
        return np.vstack((changed, changed[row]))
    if change["action"] == "reverse":
        changed[row] = changed[row][::-1]
    elif change["action"] == "move vertex":
        changed[row, column] = change["vertex"] % vertex_count
    else:  # the other diagonal of two neighbours, inside or outside the polygon
        neighbour = change["vertex"] % len(triangles)
        shared = set(changed[row].tolist()) & set(changed[neighbour].tolist())
        if len(shared) == 2:
            a, b = sorted(shared)
            # A changed triangle may have the same vertex twice and so no third vertex.
            third = [[v for v in changed[k].tolist() if v not in shared] for k in (row, neighbour)]
            if all(third):
                (c, *_), (d, *_) = third
                changed[row], changed[neighbour] = (a, c, d), (b, c, d)
    return changed
