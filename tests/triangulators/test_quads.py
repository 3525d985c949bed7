"""The criterion that counts quads on the grid, against the rasteriser that counts them, too."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from harness.frame import View, make_frame
from harness.rasterisers.reference import predict
from scenes import load
from tests.triangulators.cases import random_simple, smooth, star
from triangulators import Skipped, certify, names, triangulate, vertices
from triangulators.criteria.quads import exact_quads
from triangulators.methods.exhaustive import enumerate_triangulations

UNITS = 256


def counted(polygon: shapely.Polygon, triangles: np.ndarray) -> int:
    """Return the quads that the reference rasteriser counts for a polygon in px."""
    points = np.rint(vertices(polygon) * UNITS).astype(np.int32)
    return int(predict(points, np.ascontiguousarray(triangles, np.int32))["quads"].sum())


@given(
    st.lists(st.integers(0, 12 * UNITS), min_size=6, max_size=6),
    st.sampled_from([1, 7, 64, 128, 256]),
)
def test_a_triangle_shades_the_quads_that_the_reference_counts(corners, step):
    corners = [step * (value // step) for value in corners]
    points = np.array(corners, np.int32).reshape(3, 2)
    expected = predict(points, np.array([[0, 1, 2]], np.int32))["quads"][0]
    assert exact_quads(*(points / UNITS).ravel()) == expected
    # The same two pixels further on, where coordinates are negative.
    assert exact_quads(*(points / UNITS - 40).ravel()) == expected


def test_it_is_the_least_of_all_triangulations():
    """300 polygons, each triangulation listed and its quads counted by the reference."""
    rng = np.random.default_rng(17)
    checked, better = 0, 0
    while checked < 300:
        size = float(rng.choice([4, 9, 30]))
        ring = vertices(random_simple(rng, int(rng.integers(5, 10)), 40)) / 40 * size
        polygon = shapely.Polygon(np.round(ring * UNITS) / UNITS)
        if not polygon.is_valid or polygon.area == 0:
            continue
        listed = enumerate_triangulations(polygon)
        counts = [counted(polygon, triangles) for triangles in listed]
        assert counted(polygon, triangulate(polygon, "optimal:exact-quads")) == min(counts)
        assert counted(polygon, triangulate(polygon, "worst:exact-quads")) == max(counts)
        better += counted(polygon, triangulate(polygon, "optimal:expected-quads")) > min(counts)
        checked += 1
    assert better > 30, "what is expected is not always what is counted"


@pytest.mark.parametrize("resolution", [256, 1024])
def test_nothing_shades_fewer(resolution):
    """Polygons of the city, with holes and without, by every triangulator and at random."""
    frame = make_frame(load("city:buildings=60").polygons, View(resolution))
    others = [name for name in names(available_only=True) if name not in ("exhaustive", "listed")]
    assert sum(bool(polygon.interiors) for polygon in frame.polygons) >= 3
    for polygon in frame.polygons:
        least = counted(polygon, triangulate(polygon, "optimal:exact-quads"))
        for name in [*others, "optimal:half-perimeter", "optimal:expected-quads"]:
            try:
                triangles = triangulate(polygon, name)
            except Skipped:
                continue
            if len(triangles) == len(vertices(polygon)) + 2 * len(polygon.interiors) - 2:
                assert counted(polygon, triangles) >= least, name
        if not polygon.interiors:
            for seed in range(10):
                triangles = triangulate(polygon, "random", seed=seed)
                assert counted(polygon, triangles) >= least


def test_with_holes_it_is_proven():
    frame = make_frame(load("city:buildings=300").polygons, View(512))
    holed = [polygon for polygon in frame.polygons if polygon.interiors][:12]
    assert len(holed) == 12
    for polygon in holed:
        triangles = triangulate(polygon, "optimal:exact-quads")
        certificate = certify(polygon, triangles, "exact-quads")
        assert certificate.proven
        assert certificate.cost == counted(polygon, triangles)


def test_too_many_vertices_are_skipped_with_the_reason():
    polygon = smooth(600)
    with pytest.raises(Skipped, match=r"exact-quads of 600 vertices: up to 500 are done"):
        triangulate(polygon, "optimal:exact-quads")
    assert len(triangulate(star(60), "optimal:exact-quads")) == 58
