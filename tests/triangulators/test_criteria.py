"""The criteria against plain definitions, and the closed form against an average."""

import numba
import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from harness.frame import View, make_frame
from harness.rasterisers.reference import count_per_triangle as rasterised
from scenes import load
from tests.triangulators.cases import (
    PAPER,
    mean_blocks,
    smooth,
    star,
    twice_area,
)
from triangulators import SkippedError, TriangulationError, certify, criteria, triangulate, vertices
from triangulators.criteria import predict, predict_many
from triangulators.criteria.criterion import CALIBRATED_FEATURES
from triangulators.criteria.features import exact_quads
from triangulators.polygon_arrays import offsets_of

numbers = st.integers(-500, 500).map(lambda value: value / 4)
corners = st.tuples(*[st.tuples(numbers, numbers)] * 3)
ONE = np.array([[0, 1, 2]])


def define_costs(a, b, c) -> dict[str, float]:
    """Return the sums of a triangle, in plain Python."""
    x, y = zip(a, b, c, strict=True)
    width, height = max(x) - min(x), max(y) - min(y)
    area = abs(twice_area(a, b, c)) / 2
    sides = [np.hypot(*(np.subtract(p, q))) for p, q in ((b, c), (c, a), (a, b))]
    angles = []
    for k in range(3):
        opposite, one, two = sides[k], sides[k - 1], sides[k - 2]
        cosine = (one**2 + two**2 - opposite**2) / (2 * one * two)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return {
        "area": area,
        "bbox_area": width * height,
        "overdraw": width * height - area,
        "half_perimeter": width + height,
        "edge_length": sum(sides),
        "shape": sum(abs(60 - angle) for angle in angles),
        "beauty": -area / sum(sides),
        "complexity": 24.0,
        "expected_quads": mean_blocks((a, b, c), 2),
    }


@given(corners)
def test_features_equal_plain_definitions(triangle):
    assume(abs(twice_area(*triangle)) > 0.5)
    sums = predict(np.array(triangle), ONE)
    for name, expected in define_costs(*triangle).items():
        assert sums[name] == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(corners)
def test_expected_blocks_are_exact_except_slivers_with_gaps(triangle):
    area = abs(twice_area(*triangle)) / 2
    assume(area > 0.25)
    blocks = predict(np.array(triangle), ONE)["expected_blocks"]
    exact = mean_blocks(triangle, 4)
    # Gaps cannot make the number of blocks larger than the number of covered centres.
    assert exact * (1 - 1e-9) - 1e-9 <= blocks <= area + 1e-9
    sides = [np.subtract(triangle[k - 1], triangle[k]) for k in range(3)]
    longest = max(np.hypot(*side) for side in sides)
    if 2 * area / longest > max(4, longest / 3):  # no sharp corner, where gaps begin
        assert blocks == pytest.approx(exact, rel=0.05)


def test_sums_of_the_papers_polygon():
    polygon = PAPER
    predicted = predict(vertices(polygon), triangulate(polygon, "optimal"))
    sums = ("triangles", "area", "overdraw", "bbox_area", "complexity", "expected_setups")
    assert [predicted[name] for name in sums] == [7, 46.0, 56.0, 102.0, 24 * 7, 7]


def test_mixed_is_normalised_as_stated():
    polygon = star(20)
    points, triangles = vertices(polygon), triangulate(polygon, "delaunay")
    sums = predict(points, triangles)
    expected = (
        2 * sums["overdraw"] / sums["area"]
        + 3 * sums["shape"] / (240 * sums["triangles"])
        + 5 * sums["complexity"] / (24 * sums["triangles"])
    )
    total = criteria.find("mixed", alpha=2, beta=3, gamma=5).total(points, triangles)
    assert total == pytest.approx(expected, rel=1e-12)


def test_calibrated_takes_coefficients_by_name():
    points, triangles = vertices(star(20)), triangulate(star(20), "delaunay")
    sums = predict(points, triangles)
    coefficients = {name: 2.0 + k for k, name in enumerate(CALIBRATED_FEATURES)}
    expected = sum(weight * sums[key] for key, weight in coefficients.items())
    criterion = criteria.find("calibrated", coefficients=coefficients)
    assert criterion.total(points, triangles) == pytest.approx(expected, rel=1e-12)
    with pytest.raises(ValueError, match="helper"):
        criteria.find("calibrated", coefficients={"helper": 1.0})


@numba.njit
def _no_number(ax, ay, bx, by, cx, cy):
    return np.nan


@numba.njit
def _beyond_sums(ax, ay, bx, by, cx, cy):
    return 1e308


@pytest.mark.parametrize("name", ["optimal", "refined", "worst"])
@pytest.mark.parametrize("holes", [False, True])
def test_nan_criterion_raises_one_error(name, holes):
    polygon = shapely.Point(0, 0).buffer(5, quad_segs=8)
    if holes:
        polygon = polygon.difference(shapely.box(-1, -1, 1, 1))
    with pytest.raises(TriangulationError, match="is nan, not a finite number"):
        triangulate(polygon, name, criterion=_no_number)
    with pytest.raises(TriangulationError, match="is inf, not a finite number"):
        triangulate(polygon, name, criterion=_beyond_sums)


@numba.njit
def _no_number_for_large_ones(ax, ay, bx, by, cx, cy):
    doubled = abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    return np.nan if doubled > 50 or doubled == 0 else doubled


OCTAGON = 0.7 * np.array([(0, 0), (5, -2), (10, 0), (12, 5), (10, 10), (5, 12), (0, 10), (-2, 5)])


def test_nan_triangle_is_avoided_if_possible():
    polygon, criterion = shapely.Polygon(OCTAGON), _no_number_for_large_ones
    best = [triangulate(polygon, name, criterion=criterion) for name in ("optimal", "exhaustive")]
    totals = [criteria.find(criterion).total(OCTAGON, triangles) for triangles in best]
    assert totals[0] == pytest.approx(totals[1], rel=1e-12)
    assert certify(polygon, best[0], criterion).proven
    with pytest.raises(TriangulationError, match="is nan, not a finite number"):
        certify(polygon, triangulate(polygon, "max-area"), criterion)


def test_degenerate_triangles_may_be_nan():
    """For example a ratio of sides; no result has such a triangle."""
    square = shapely.Polygon([(0, 0), (3, 0), (6, 0), (6, 3), (6, 6), (3, 6), (0, 6), (0, 3)])
    for name in ("optimal", "refined", "flips"):
        assert len(triangulate(square, name, criterion=_no_number_for_large_ones)) == 6


UNITS = 256


@given(
    st.lists(st.integers(0, 12 * UNITS), min_size=6, max_size=6),
    st.sampled_from([1, 7, 64, 128, 256]),
)
def test_exact_quads_equal_reference_rasteriser(corners, step):
    corners = [step * (value // step) for value in corners]
    points = np.array(corners, np.int32).reshape(3, 2)
    expected = rasterised(points, np.array([[0, 1, 2]], np.int32))["quads"][0]
    assert exact_quads(*(points / UNITS).ravel()) == expected
    # The same two pixels further on, where coordinates are negative.
    assert exact_quads(*(points / UNITS - 40).ravel()) == expected


def test_exact_quads_are_proven():
    frame = make_frame(load("city:buildings=300").polygons, View(512))
    holed = [polygon for polygon in frame.polygons if polygon.interiors][:12]
    simple = [polygon for polygon in frame.polygons if not polygon.interiors][:60]
    assert len(holed) == 12
    for polygon in holed + simple:
        triangles = triangulate(polygon, "optimal:exact-quads")
        certificate = certify(polygon, triangles, "exact-quads")
        assert certificate.proven
        points = np.rint(vertices(polygon) * UNITS).astype(np.int32)
        assert certificate.cost == rasterised(points, triangles)["quads"].sum()


def test_too_many_vertices_are_skipped_with_the_reason():
    polygon = smooth(600)
    with pytest.raises(SkippedError, match=r"exact-quads: the polygon has 600 vertices \(more"):
        triangulate(polygon, "optimal:exact-quads")
    assert len(triangulate(star(60), "optimal:exact-quads")) == 58


def test_predict_many_equals_predict():
    polygons = make_frame(load("city:buildings=40").polygons, View(256)).polygons
    parts = [triangulate(polygon, "ear-clipping") for polygon in polygons]
    parts[3] = parts[3][:0]
    columns = predict_many(
        polygons.coords,
        polygons.vertex_offsets,
        np.concatenate(parts),
        offsets_of([len(part) for part in parts]),
    )
    for k, part in enumerate(parts):
        single = predict(polygons.rings_of(k)[0], part)
        assert {name: column[k] for name, column in columns.items()} == single
    assert columns["area"][3] == columns["beauty"][3] == 0.0
