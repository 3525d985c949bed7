"""The limit: what the outline, drawn in one piece, would shade."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from harness.frame import View, make_frame
from harness.rasterisers.reference import outlines, predict
from scenes import load
from triangulators import Skipped, names, triangulate


def quads_of(frame, parts):
    """Return (p,) quads that the reference counts of each polygon's triangles."""
    triangles = frame.join(parts)
    counts = predict(frame.points, triangles)["quads"]
    return np.bincount(frame.owner(triangles), counts, len(parts)).astype(int)


@pytest.mark.parametrize(
    ("scene", "resolution"),
    [("city:buildings=40", 64), ("cad:parts=2,segments=12", 301), ("stress:vertices=24", 1024)],
)
def test_no_triangulation_is_below_it(scene, resolution):
    frame = make_frame(load(scene).polygons, View(resolution))
    limit = outlines(frame, [triangulate(polygon, "delaunay") for polygon in frame.polygons])
    assert (limit > 0).any()
    compared = 0
    for name in (*names(available_only=True), "optimal:expected-quads"):
        if name in ("exhaustive", "listed", "pareto"):
            continue
        for number, polygon in enumerate(frame.polygons):
            try:
                part = triangulate(polygon, name)
            except Skipped:
                continue
            parts = [part if k == number else None for k in range(len(frame.polygons))]
            assert quads_of(frame, parts)[number] >= limit[number], (name, number)
            compared += 1
    assert compared > 5 * len(frame.polygons)


def test_it_does_not_depend_on_the_triangulation():
    frame = make_frame(load("city:buildings=60").polygons, View(256))
    found = [
        outlines(frame, [triangulate(polygon, name) for polygon in frame.polygons])
        for name in ("delaunay", "optimal:half-perimeter", "worst:overdraw")
    ]
    assert (found[0] == found[1]).all()
    assert (found[0] == found[2]).all()


def test_a_single_triangle_is_at_it():
    rng = np.random.default_rng(3)
    for _ in range(50):
        polygon = shapely.Polygon(rng.uniform(0, 100, (3, 2)))
        frame = make_frame([polygon], View(int(rng.integers(16, 400))))
        parts = [triangulate(each, "ear-clipping") for each in frame.polygons]
        assert outlines(frame, parts).tolist() == quads_of(frame, parts).tolist()


def test_it_is_counted_by_pixels():
    """Against the picture of the polygons, pixel by pixel."""
    frame = make_frame(load("city:buildings=12").polygons, View(128))
    parts = [triangulate(polygon, "delaunay") for polygon in frame.polygons]
    x, y = np.meshgrid(np.arange(128) + 0.5, np.arange(128) + 0.5)
    for polygon, count in zip(frame.polygons, outlines(frame, parts).tolist(), strict=True):
        inside = shapely.contains_xy(polygon, x, y)
        quads = inside.reshape(64, 2, 64, 2).any(axis=(1, 3))
        edge = shapely.distance(shapely.points(x, y), polygon.boundary) == 0
        unsure = edge.reshape(64, 2, 64, 2).any(axis=(1, 3)) & ~quads
        assert quads.sum() <= count <= quads.sum() + unsure.sum()


def test_a_polygon_without_triangles_has_none():
    frame = make_frame([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)], View(64))
    part = triangulate(frame.polygons[0], "ear-clipping")
    assert outlines(frame, [part, None]).tolist()[1] == -1
