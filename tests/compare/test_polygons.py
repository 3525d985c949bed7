"""Where a case got worse: the polygons that grew most are named and shown."""

from pathlib import Path

import numpy as np
import pytest

from harness.compare.comparison import compare_runs
from harness.compare.model import Settings
from harness.compare.outputs import to_html, to_markdown
from harness.compare.polygons import _counted, most_grown
from harness.heatmaps import lane_maps
from harness.stored.folder import Run, read_arrays, read_run
from tests.measuring.test_run import measure, plan_for
from triangulators import triangulate

METHOD = "optimal:half-perimeter"


def varying(polygon):
    return triangulate(polygon, METHOD)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder, found = tmp_path_factory.mktemp("runs"), []
    name = f"{__name__}:varying"
    for number, method in enumerate(("optimal:half-perimeter", "ear-clipping")):
        globals()["METHOD"] = method
        plan = plan_for(
            Path("city:buildings=40"), triangulators=(name,), rasterisers=("reference",)
        )
        measure(plan, folder / str(number))
        found.append(read_run(folder / str(number)))
    return found


def test_the_three_that_grew_most_are_those_of_the_columns(runs):
    base, head = runs
    comparison = compare_runs(base, head, Settings(gates=("counters",)))
    grown = most_grown(base, head, comparison)
    columns = [read_arrays(run, run.records[0]["key"])["helper_lanes"] for run in runs]
    growth = columns[1].astype(int) - columns[0]
    assert sorted(growth)[-3:][::-1] == [each.head - each.base for each in grown]
    for each in grown:
        assert (each.base, each.head) == (columns[0][each.polygon], columns[1][each.polygon])
        drawn = [int(lane_maps(each.frame, rows)[1].sum()) for rows in each.triangles.values()]
        assert drawn == [each.base, each.head]  # what is shown is what was counted
    text, page = to_markdown(comparison, grown=grown), to_html(comparison, grown)
    assert page.count("data:image/png;base64,") == 3
    for each in grown:
        said = f"polygon {each.polygon} ({len(each.frame.points)} vertices)"
        assert said in page
        assert said in text


def test_what_got_better_or_kept_no_columns_shows_none(runs, tmp_path):
    base, head = runs
    better = compare_runs(head, base, Settings(gates=("counters",)))
    assert most_grown(head, base, better) == []
    for array in (head.path / "polygons").iterdir():
        np.savez(array, other=np.zeros(1))
    comparison = compare_runs(base, head, Settings(gates=("counters",)))
    assert comparison.regressed()
    assert most_grown(base, head, comparison) == []
    assert "Where it grew most" not in to_html(comparison)


def test_of_one_polygon_the_totals_are_its_own(tmp_path):
    run = Run(tmp_path, {}, [])
    entry = {"key": "a" * 16, "polygons": 1, "counters": {"helper_lanes": 7}}
    assert _counted(run, entry) == {"helper_lanes": [7]}
    assert _counted(run, entry | {"polygons": 2}) == {}


def test_columns_that_are_no_counters_of_polygons_are_not_looked_at(monkeypatch):
    columns = {
        "helper_lanes": np.array([3.0, 4.0]),
        "quads": np.ones((2, 2)),
        "bbox_tests": np.array(["1", "2"]),
        "fragments": np.array([5, 6]),
    }
    monkeypatch.setattr("harness.compare.polygons.read_arrays", lambda *_: columns)
    found = _counted(Run(Path("run"), {}, []), {"key": "x"})
    assert {name: each.tolist() for name, each in found.items()} == {"helper_lanes": [3, 4]}
