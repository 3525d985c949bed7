from pathlib import Path

import numpy as np
import pytest

from harness.compare import polygons
from harness.compare.comparison import compare_runs
from harness.compare.matching import Match
from harness.compare.model import Settings
from harness.compare.outputs import to_html, to_markdown
from harness.compare.polygons import _read_counters, find_largest_growth
from harness.heatmaps import make_lane_maps
from harness.results.run_folder import Geometry, Run, read_arrays, read_run
from tests.measuring.test_run import make_plan, measure
from tests.records import get_rows, make_record
from triangulators import triangulate
from triangulators.polygon_arrays import PolygonArray

METHOD = "optimal:half-perimeter"


def varying(polygon):
    return triangulate(polygon, METHOD)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder, names = tmp_path_factory.mktemp("runs"), (f"{__name__}:varying",)
    plan = make_plan(Path("city:buildings=40"), triangulators=names, rasterisers=("reference",))
    for method in ("optimal:half-perimeter", "ear-clipping"):
        globals()["METHOD"] = method
        measure(plan, folder / method)
    return [read_run(folder / method) for method in ("optimal:half-perimeter", "ear-clipping")]


def test_three_largest_growths_are_those_of_the_columns(runs):
    base, head = runs
    comparison = compare_runs(base, head, Settings(gates=("counters",)))
    grown = find_largest_growth(base, head, comparison)
    columns = [read_arrays(run, get_rows(run)[0]["key"])["helper_lanes"] for run in runs]
    growth = columns[1].astype(int) - columns[0]
    assert sorted(growth)[-3:][::-1] == [polygon.head - polygon.base for polygon in grown]
    for polygon in grown:
        counted = [polygon.base, polygon.head]
        assert counted == [column[polygon.polygon] for column in columns]
        maps = [make_lane_maps(polygon.frame, rows) for rows in polygon.triangles.values()]
        assert [helpers.sum() for _, helpers in maps] == counted  # the shown lanes are the counted
    text, page = to_markdown(comparison, grown=grown), to_html(comparison, grown)
    assert page.count("data:image/png;base64,") == 3
    assert "**Largest growth** (heatmaps: compare.html)\n\n- " in text
    for polygon in grown:
        line = f"polygon {polygon.polygon} ({len(polygon.frame.points)} vertices)"
        assert line in page
        assert line in text


def test_improvements_and_missing_columns_show_no_polygons(runs, tmp_path):
    base, head = runs
    better = compare_runs(head, base, Settings(gates=("counters",)))
    assert find_largest_growth(head, base, better) == []
    for array in (head.path / "polygons").iterdir():
        np.savez(array, other=np.zeros(1))
    comparison = compare_runs(base, head, Settings(gates=("counters",)))
    assert comparison.list_regressed_cases()
    assert find_largest_growth(base, head, comparison) == []
    assert "Largest growth" not in to_html(comparison)


def test_totals_are_used_for_a_single_polygon(tmp_path):
    run = Run(tmp_path, {}, [])
    one, two = (make_record(polygons=n, counters={"helper_lanes": 7}) for n in (1, 2))
    assert _read_counters(run, one) == {"helper_lanes": [7]}
    assert _read_counters(run, two) == {}


def test_growths_are_in_descending_order(monkeypatch):
    counts = {"base": [5, 9, 7, 2], "head": [6, 9, 10, 1]}
    arrays = {name: {"quads": np.array(array)} for name, array in counts.items()}
    monkeypatch.setattr(polygons, "_read_counters", lambda run, _: arrays[run])
    record = make_record()
    growths = polygons._find_growths("base", "head", Match("", record, record))
    assert list(growths) == [("quads", 2, 7, 10), ("quads", 0, 5, 6)]


def test_polygons_of_several_cases_are_sorted_by_growth(runs, monkeypatch):
    base, head = runs
    comparison = compare_runs(base, head, Settings(gates=("counters",)))
    sizes = [("quads", 0, 5, 6), ("quads", 1, 5, 9), ("quads", 2, 5, 7)]
    monkeypatch.setattr(polygons, "_find_growths", lambda *_: iter(sizes))
    monkeypatch.setattr(polygons, "_read_polygon", lambda _base, _head, _match, *growth: growth)
    assert find_largest_growth(base, head, comparison) == [sizes[1], sizes[2], sizes[0]]


def test_polygon_is_drawn_alone_near_the_origin(monkeypatch):
    corner = np.array([(0, 0), (2000, 0), (0, 900)], np.int32)
    points = np.vstack([corner, corner + [(5000, 700)]]).astype(np.int32)
    rows = np.array([(0, 1, 2), (3, 4, 5)], np.int32)
    array, source = PolygonArray.of_single_rings(points, 3), np.array([4, 8])
    of_two = Geometry(array, source, {"fan": rows})

    def grown(index: int, geometry: object = of_two, name: str = "fan"):
        monkeypatch.setattr("harness.compare.polygons.read_geometry", lambda *_: geometry)
        record = make_record(name, resolution=64)
        match = Match("city", record, record)
        return polygons._read_polygon(None, None, match, "quads", index, 1, 2)

    second = grown(1)
    assert (second.polygon, second.metric, second.base, second.head) == (8, "quads", 1, 2)
    assert second.frame.source.tolist() == [8]
    assert second.frame.grid.vertex_counts.tolist() == [3]
    moved = points[3:] - second.frame.points
    assert (moved % polygons.QUAD == 0).all()
    assert len(np.unique(moved, axis=0)) == 1
    assert (second.frame.points.min(axis=0) < polygons.QUAD).all()
    assert second.frame.points.min() >= 0
    assert second.frame.points.max() < second.frame.width * 256
    assert [rows.tolist() for rows in second.triangles.values()] == [[[0, 1, 2]]] * 2
    assert list(second.triangles) == ["BASE: fan", "HEAD: fan"]
    assert grown(0).frame.source.tolist() == [4]
    assert grown(2) is None
    assert grown(0, None) is None
    assert grown(0, name="delaunay") is None


def test_columns_that_are_not_counters_are_ignored(monkeypatch):
    columns = {"helper_lanes": np.array([3.0, 4.0]), "quads": np.ones((2, 2))}
    columns |= {"bbox_tests": np.array(["1", "2"]), "fragments": np.array([5, 6])}
    monkeypatch.setattr("harness.compare.polygons.read_arrays", lambda *_: columns)
    counters = _read_counters(Run(Path("run"), {}, []), make_record())
    assert {name: column.tolist() for name, column in counters.items()} == {"helper_lanes": [3, 4]}
