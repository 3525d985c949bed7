"""Minimum quads of a frame's polygons: known if cheap, and never too high."""

import time
from contextlib import closing

import numpy as np
import pytest
import shapely

from harness.frame import View, make_frame
from harness.measuring import records, tasks
from harness.measuring.pool import MeasuringPool, collect_bounds
from harness.metrics.registry import MIN_QUADS, OUTLINE, find_metric
from harness.rasterisers.reference import count_outline_quads
from harness.results.record import LeastQuads
from harness.worker import TaskError, Worker
from scenes import load
from tests.inline import InlineWorker
from tests.measuring.test_run import inline
from tests.records import make_record
from triangulators import triangulate


def get_limits(frame, open_worker=inline):
    parts = [triangulate(polygon, "delaunay") for polygon in frame.polygons]
    with closing(MeasuringPool(open_worker, 60)) as pool:
        return collect_bounds(pool.start_bounds(frame, parts))


def test_minimum_quads_are_between_outline_and_triangulations():
    frame = make_frame(load("city:buildings=25").polygons, View(200))
    limits = get_limits(frame)
    assert (limits[OUTLINE] <= limits[MIN_QUADS]).all()
    for name in ("ear-clipping", "optimal:expected-quads", "optimal:half-perimeter", "greedy"):
        parts = [triangulate(polygon, name) for polygon in frame.polygons]
        of_polygon = tasks.count_quads(frame, parts)
        assert (limits[MIN_QUADS] <= of_polygon).all()
        assert (limits[MIN_QUADS] < of_polygon).any()


def test_the_quickest_polygons_are_solved_within_the_budget(monkeypatch):
    frame = make_frame(load("city:buildings=25").polygons, View(200))
    seconds = tasks.estimate_search_seconds(frame)
    monkeypatch.setattr(tasks, "MAX_SEARCH_S", seconds.sum() / 2)
    has_minimum = get_limits(frame)[MIN_QUADS] >= 0
    assert has_minimum.any()
    solved, next_s = seconds[has_minimum], seconds[~has_minimum].min()
    assert solved.max() <= next_s
    assert solved.sum() <= seconds.sum() / 2 < solved.sum() + next_s
    monkeypatch.setattr(tasks, "MAX_SEARCH_S", 0.0)
    assert (get_limits(frame)[MIN_QUADS] == -1).all()


def test_seconds_grow_with_height_vertices_and_holes():
    def estimate(polygon: shapely.Polygon, size: int) -> float:
        return tasks.estimate_search_seconds(make_frame([polygon], View(size))).item()

    square = shapely.box(0, 0, 100, 100)
    assert estimate(square, 640) == pytest.approx(10 * estimate(square, 64), rel=0.2)
    with_hole = square.difference(shapely.box(40, 40, 60, 60))
    assert estimate(with_hole, 64) > 8 * estimate(square, 64)


class Failing(InlineWorker):
    """An executor in which the computation of minimum quads crashes."""

    def call(self, function, *arguments, **options):
        if function is tasks.compute_min_quads:
            raise TaskError("it crashed")
        return super().call(function, *arguments, **options)


def test_a_crash_does_not_affect_outline_quads():
    frame = make_frame([shapely.box(0, 0, 1, 1)], View(32))
    limits = get_limits(frame, lambda *_: Failing())
    assert limits[OUTLINE].item() > 0
    assert MIN_QUADS not in limits


def test_regret_is_helper_lanes_above_the_minimum():
    fields = {"polygons": 3, "quads": 290, "shaded": 300, "fragments": 1000}
    regret = find_metric("regret")
    assert regret(make_record(least=fields)) == pytest.approx(200 / 160 - 1)
    assert regret(make_record()) is None
    assert regret(make_record(least={**fields, "quads": 250})) is None  # no helper lane: no ratio


def test_records_compare_polygons_with_a_minimum():
    counters = {"quads": np.array([10, 20, 40]), "fragments": np.array([30, 70, 110])}
    drawn = np.array([True, False, True])
    min_quads = np.array([9, 8, -1])
    expected = LeastQuads(polygons=1, quads=9, shaded=10, fragments=30)
    assert records._sum_least_quads(drawn, counters, min_quads) == expected
    assert records._sum_least_quads(drawn, {"fragments": counters["fragments"]}, min_quads) is None
    totals = {name: values.sum() for name, values in counters.items()}
    assert records._sum_least_quads(drawn, totals, min_quads) is None


def test_a_triangulators_timeout_does_not_limit_bounds():
    pool = MeasuringPool(Worker, 0.05)
    try:
        assert pool.compute_in_second_process(time.sleep, 0.3).result() is None
    finally:
        pool.close(at_once=True)


@pytest.mark.parametrize("scene", ["city:buildings=12", "cad:parts=2,segments=12"])
@pytest.mark.parametrize("name", ["delaunay", "optimal:half-perimeter", "worst:overdraw"])
def test_outline_quads_do_not_depend_on_the_triangulation(scene, name):
    """Compared with an image of the polygons, pixel by pixel."""
    frame = make_frame(load(scene).polygons, View(128))
    parts = [triangulate(polygon, name) for polygon in frame.polygons]
    x, y = np.meshgrid(np.arange(128) + 0.5, np.arange(128) + 0.5)
    counts = count_outline_quads(frame, parts).tolist()
    for polygon, count in zip(frame.polygons, counts, strict=True):
        inside = shapely.contains_xy(polygon, x, y)
        quads = inside.reshape(64, 2, 64, 2).any(axis=(1, 3))
        edge = shapely.distance(shapely.points(x, y), polygon.boundary) == 0
        unsure = edge.reshape(64, 2, 64, 2).any(axis=(1, 3)) & ~quads
        assert quads.sum() <= count <= quads.sum() + unsure.sum()


def test_polygons_without_triangles_have_no_outline_quads():
    frame = make_frame([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)], View(64))
    part = triangulate(frame.polygons[0], "ear-clipping")
    assert count_outline_quads(frame, [part, None]).tolist()[1] == -1
