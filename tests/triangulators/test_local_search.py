import numpy as np
import pytest
import shapely

from harness.frame import View, make_frame
from scenes import load
from tests.triangulators.cases import glyphs, smooth, star
from triangulators import criteria, triangulate, vertices
from triangulators.criteria.cost import compute_total_cost, find_plain_cost, make_cost
from triangulators.geometry.half_edges import find_twins
from triangulators.libraries import ear_clipping
from triangulators.optimum.local_search import MAX_RING_TRIANGLES, optimise_windows
from triangulators.polygon import boundary
from triangulators.verify import verify


@pytest.mark.parametrize("name", ["expected-quads", "shape", "exact-quads", "overdraw"])
def test_windows_are_valid_and_never_worse(name):
    cost = make_cost(criteria.find(name), 1.0, 1)
    gains = 0
    for polygon in [star(200, spread=0.4), smooth(300), *(p for _, p in glyphs("B8g%"))]:
        outline = boundary(polygon)
        triangles = ear_clipping(outline).astype(np.int32)
        before = compute_total_cost(outline.points, triangles, cost)
        twin = find_twins(triangles)
        is_optimal = optimise_windows(outline.points, triangles, twin, cost)
        after = compute_total_cost(outline.points, triangles, cost)
        assert is_optimal == (len(triangles) <= MAX_RING_TRIANGLES and not polygon.interiors)
        assert verify(polygon, triangles).conforming
        assert np.array_equal(twin, find_twins(triangles))
        assert after <= before * (1 + 1e-12)
        gains += after < before * 0.999
    assert gains >= 3


def test_one_window_is_the_optimum():
    cost = find_plain_cost(criteria.find("expected-quads"))
    for seed in range(20):
        polygon = star(40, seed=seed, spread=0.3)
        if seed % 2:
            polygon = polygon.reverse()
        outline = boundary(polygon)
        triangles = ear_clipping(outline).astype(np.int32)
        assert optimise_windows(outline.points, triangles, find_twins(triangles), cost)
        best = triangulate(polygon, "optimal:expected-quads")
        optimum = compute_total_cost(outline.points, best, cost)
        total = compute_total_cost(outline.points, triangles, cost)
        assert total == pytest.approx(optimum, rel=1e-12)


@pytest.mark.parametrize(
    ("scene", "name", "factor"),
    [
        *((scene, "expected-quads", 1.01) for scene in ("city", "glyphs", "stress")),
        ("city", "half-perimeter", 1.02),
    ],
)
def test_refined_is_close_to_the_optimum(scene, name, factor):
    polygons = make_frame(load(scene).polygons, View(1024)).polygons
    criterion = criteria.find(name)
    refined = optimal = 0.0
    for polygon in polygons[:: 1 if scene == "stress" else 5]:
        points = vertices(polygon)
        refined += criterion.total(points, triangulate(polygon, f"refined:{name}"))
        optimal += criterion.total(points, triangulate(polygon, f"optimal:{name}"))
    assert optimal <= refined <= factor * optimal


@pytest.mark.parametrize("turn", [False, True])
def test_hole_that_touches_the_exterior_at_a_vertex_leaves_no_single_ring(turn):
    shell = [(0, 0), (4, 0), (9, 0.5), (9, 6), (0, 6)]
    polygon = shapely.Polygon(shell, [[(4, 0), (6, 2), (5, 4), (3, 3)][:: -1 if turn else 1]])
    if turn:
        polygon = polygon.reverse()
    assert polygon.is_valid
    criterion = criteria.find("expected-quads")
    refined, optimal = (
        triangulate(polygon, f"{name}:expected-quads") for name in ("refined", "optimal")
    )
    assert verify(polygon, refined).conforming
    points = vertices(polygon)
    assert criterion.total(points, refined) == pytest.approx(criterion.total(points, optimal))
