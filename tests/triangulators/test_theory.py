"""The claims of docs/theory.md, tested on triangles and triangulations."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.triangulators.cases import hard_polygons, mean_blocks
from triangulators import triangulate, vertices
from triangulators.criteria import predict
from triangulators.criteria.features import edge_length, expected_quads, half_perimeter
from triangulators.polygon import boundary

whole = st.integers(-(2**24), 2**24)
grid = whole.map(lambda number: number / 256)  # 1/256 px, up to 65,536 px
px = st.floats(-512, 512, allow_nan=False)


def manhattan(a, b):
    return abs(a[0] - b[0]) + abs(a[1] - b[1])


@given(st.tuples(grid, grid), st.tuples(grid, grid), st.tuples(grid, grid))
def test_twice_h_is_the_manhattan_perimeter_on_the_grid(a, b, c):
    assert 2 * half_perimeter(*a, *b, *c) == manhattan(a, b) + manhattan(b, c) + manhattan(c, a)


@given(hard_polygons(), st.sampled_from(["delaunay", "ear-clipping", "worst", "greedy"]))
@settings(max_examples=60, deadline=None)
def test_h_of_a_triangulation_is_the_boundary_and_twice_the_diagonals(polygon, name):
    points, triangles = vertices(polygon), triangulate(polygon, name, repair=True)
    corners = boundary(polygon).site[triangles]
    around = sum(manhattan(points[a], points[b]) for a, b in boundary(polygon).edges)
    edges = np.sort(np.concatenate((corners[:, :2], corners[:, 1:], corners[:, ::2])), axis=1)
    pairs, met = np.unique(edges, axis=0, return_counts=True)
    inside = sum(manhattan(points[a], points[b]) for a, b in pairs[met == 2])
    assert 2 * predict(points, triangles)["half_perimeter"] == around + 2 * inside


@given(st.tuples(px, px), st.tuples(px, px), st.tuples(px, px))
def test_the_mean_of_h_over_rotations_is_the_perimeter_over_half_pi(a, b, c):
    turns = np.arange(720) * np.pi / 720
    x = np.array([np.cos(turns) * p[0] - np.sin(turns) * p[1] for p in (a, b, c)])
    y = np.array([np.sin(turns) * p[0] + np.cos(turns) * p[1] for p in (a, b, c)])
    mean = float(np.mean(np.ptp(x, axis=0) + np.ptp(y, axis=0)))
    length = edge_length(*a, *b, *c)
    assert abs(mean - 2 * length / np.pi) <= 1e-4 * length + 1e-9


def test_expected_quads_are_the_mean_over_the_grid_and_h_their_first_order():
    rng = np.random.default_rng(4)
    for _ in range(30):
        corners = rng.uniform(0, 60, (3, 2))
        quads = expected_quads(*corners.ravel())
        assert abs(quads - mean_blocks(corners, 2)) < 1e-6 * quads
        ux, uy, vx, vy = (corners[1] - corners[0]).tolist() + (corners[2] - corners[0]).tolist()
        area = abs(ux * vy - uy * vx) / 2
        h = half_perimeter(*corners.ravel())
        # Thin triangles save some of S + H + 1, never gain.
        assert quads <= (area + h + 1) / 4 + 1e-9
