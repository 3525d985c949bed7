"""Studies end to end on the exact CPU rasterisers, with known results."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.errors import InputError
from harness.metrics.run_quality import DISTURBED, RunState
from harness.results.run_folder import read_run
from harness.settings import StudySize
from harness.study.subjects import choose_polygons, choose_triangulators
from harness.triangulating.recipes import parse_all
from scenes import load
from tests.conftest import require_ok, run_command, shorten_runs
from tests.measuring.test_run import interrupt_after_one
from tests.records import get_rows

PAPER = ("--scene", "paper", "--budget", "0.001", "--rasterisers")


def test_polygons_are_simple_and_of_all_sizes():
    city = load("city")
    polygons_chosen = choose_polygons(city, StudySize(polygons=12))
    sizes = [len(part.polygons[0].exterior.coords) - 1 for _, part in polygons_chosen]
    assert sizes == sorted(sizes)
    assert sizes[0] >= 8 < 30 <= sizes[-1]
    for number, part in polygons_chosen:
        assert part.polygons == [city.polygons[number]]
        assert not part.polygons[0].interiors


def test_triangulations_are_sampled_broadly():
    city = load("city:buildings=80")
    polygon = choose_polygons(city, StudySize(polygons=3))[1][1].polygons[0]
    names = [str(recipe) for recipe in choose_triangulators(StudySize(random=30), polygon)]
    assert {"ear-clipping", "delaunay", "optimal:overdraw", "worst:half-perimeter"} <= set(names)
    assert sum(name.startswith("random#") for name in names) == 30
    assert len(set(names)) == len(names)


def test_all_triangulations_of_a_small_polygon_are_listed():
    triangulators = choose_triangulators(StudySize(random=30), load("paper").polygons[0])
    names = [str(recipe) for recipe in triangulators]
    assert sum(name.startswith("listed#") for name in names) == 47
    assert not any(name.startswith("random") for name in names)


def test_a_scene_without_simple_polygons_is_refused():
    with pytest.raises(InputError, match="no polygon without holes"):
        choose_polygons(load("city:buildings=5"), StudySize(max_vertices=3))


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize("command", ["validate", "pareto"])
def test_stopped_study_is_reported_and_resumed(harness, command, monkeypatch):
    monkeypatch.setattr("harness.commands.study_validate.QUICK_S", 1e-4)
    study = ("study", command, *PAPER, "reference")
    with monkeypatch.context() as patched:
        interrupt_after_one(patched)
        code, out, _ = harness(*study, "--out", "stopped")
    assert code == 130
    assert "continue with the same command and --resume stopped" in out
    disturbed = RunState(DISTURBED, ("another program ran",))
    monkeypatch.setattr("harness.measuring.run.assess_records", lambda *_: disturbed)
    out, _ = require_ok(harness(*study, "--resume", "stopped"))
    answer = "predicts the helper lanes of reference on cpu best (rank"
    assert (answer in out) == (command == "validate")
    assert "the run's times are disturbed: another program ran. Therefore results use exact" in out


@pytest.mark.usefixtures("no_plots", "in_process")
@pytest.mark.parametrize("command", ["validate", "pareto"])
def test_failed_case_is_reported_with_the_exit_code(harness, command, monkeypatch):
    monkeypatch.setenv("MOCK_FAULT", "count:raise")  # for an odd number of triangles: seven here
    names = ["delaunay", "optimal:overdraw", "optimal:half-perimeter", "worst:overdraw"]
    triangulators = parse_all(names)
    monkeypatch.setattr("harness.study.subjects.choose_triangulators", lambda *_: triangulators)
    rasterisers = "reference,tests.mock:MockRasteriser"
    code, _, err = harness("study", command, *PAPER, rasterisers, "--out", "out")
    assert code == 5
    assert "cases failed" in err.splitlines()[-1]
    assert "scripted failure" in (Path("out") / "cases.jsonl").read_text()
    assert list(Path("out").glob("*.csv"))  # measured results are written


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "out"
    arguments = ["study", "validate", "--scene", "city:buildings=80", "--quick", "--quiet"]
    arguments += ["--random", "9"]
    arguments += ["--rasterisers", "reference", "--resolution", "512", "--out", str(folder)]
    with pytest.MonkeyPatch.context() as patch:
        shorten_runs(patch)  # this test evaluates counters, not times
        patch.setattr("harness.commands.study_validate.QUICK_S", 1e-4)
        assert run_command(*arguments) == 0
    return folder


def test_criteria_rank_the_counts_as_predicted(study):
    table = pd.read_csv(study / "correlations.csv")
    assert list(table.columns) == [
        *("rasteriser", "device", "criterion", "measure", "statistic"),
        *("value", "ci_low", "ci_high", "polygons"),
    ]
    within = table[table["statistic"] == "spearman_within"]
    cells = within.set_index(["rasteriser", "measure", "criterion"])["value"].sort_index()
    assert cells["reference", "bbox_tests", "overdraw"] > 0.999
    assert cells["binning", "tiles_16", "exact-tiles-16"] == 1.0
    lanes = cells["reference", "helper_lanes"]
    assert lanes["exact-quads"] == 1.0
    assert lanes["expected-quads"] > 0.98
    assert lanes["expected-quads"] > lanes["half-perimeter"] > lanes["overdraw"]
    assert lanes["half-perimeter"] > 0.9
    assert np.isnan(lanes["complexity"])


def test_study_has_a_record_per_triangulation_and_plots(study):
    stored = read_run(study)
    assert stored.problems == []
    assert {record["status"] for record in get_rows(stored)} <= {"ok", "skipped"}
    assert len({record["scene"] for record in get_rows(stored)}) == 6
    seeds = {record.id.number for record in stored.records if record.id.triangulator == "random"}
    assert seeds == {*range(9)}, "--random overrides --quick"
    plots = {path.name for path in (study / "plots").iterdir()}
    assert "predicted-vs-measured-reference-cpu.svg" in plots
    assert (study / "criteria.md").read_text().count("| half-perimeter |") == 4


def test_all_triangulations_of_the_papers_polygon_are_listed(harness, tmp_path):
    tables = {}
    for mode in ("paper", "conforming"):
        require_ok(harness("inspect", "paper", "--every", mode, "--out", f"all/{mode}"))
        tables[mode] = pd.read_csv(tmp_path / "all" / mode / "triangulations.csv")
    table = tables["paper"]
    assert (len(table), len(tables["conforming"])) == (47, 29)
    assert table["conforming"].sum() == 29
    assert table.loc[0, "overdraw"] == 53
    assert not table.loc[0, "conforming"]
    assert table[table["conforming"]]["overdraw"].min() == 56
