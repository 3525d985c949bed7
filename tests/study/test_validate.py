"""Studies end to end on the exact CPU rasterisers, with known results."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.commands.outcome import choose_folder
from harness.errors import InputError
from harness.results.record import Record
from harness.results.run_folder import read_run
from harness.settings import StudySize
from harness.stats.run_quality import DISTURBED, RunState
from harness.study.correlations import (
    correlate_by_resolution,
    make_correlation_table,
    make_measure_table,
)
from harness.study.subjects import choose_polygons, choose_triangulators
from harness.triangulating.recipes import parse_all
from scenes import load
from scripts.repeated_runs import compare_repeated
from tests.conftest import assert_refused, require_ok, run_command, shorten_runs
from tests.measuring.test_run import interrupt_after_one
from tests.records import get_rows, make_record


def test_polygons_are_simple_and_of_all_sizes():
    city = load("city")
    polygons_chosen = choose_polygons(city, StudySize(polygons=12))
    sizes = [len(part.polygons[0].exterior.coords) - 1 for _, part in polygons_chosen]
    assert sizes == sorted(sizes)
    assert sizes[0] >= 8
    assert sizes[-1] >= 30
    for number, part in polygons_chosen:
        assert part.polygons == [city.polygons[number]]
        assert not part.polygons[0].interiors


def test_triangulations_are_sampled_broadly():
    city = load("city:buildings=80")
    polygon = choose_polygons(city, StudySize(polygons=3))[1][1].polygons[0]
    names = [
        str(triangulator) for triangulator in choose_triangulators(StudySize(random=30), polygon)
    ]
    assert {"ear-clipping", "delaunay", "optimal:overdraw", "worst:half-perimeter"} <= set(names)
    assert sum(name.startswith("random#") for name in names) == 30
    assert len(set(names)) == len(names)


def test_all_triangulations_of_a_small_polygon_are_listed():
    triangulators = choose_triangulators(StudySize(random=30), load("paper").polygons[0])
    names = [str(triangulator) for triangulator in triangulators]
    assert sum(name.startswith("listed#") for name in names) == 47
    assert not any(name.startswith("random") for name in names)


def test_a_scene_without_simple_polygons_is_refused():
    with pytest.raises(InputError, match="no polygon without holes"):
        choose_polygons(load("city:buildings=5"), StudySize(max_vertices=3))


def test_out_and_resume_are_mutually_exclusive(harness):
    assert_refused(
        harness("study", "validate", "--scene", "paper", "--out", "a", "--resume", "b"),
        "--out",
        "--resume",
    )


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize("command", ["validate", "pareto"])
def test_stopped_study_is_reported_and_resumed(harness, command, monkeypatch):
    monkeypatch.setattr("harness.commands.study_validate.QUICK_S", 1e-4)
    arguments = (
        "study",
        command,
        "--scene",
        "paper",
        "--rasterisers",
        "reference",
        "--budget",
        "0.001",
    )
    with monkeypatch.context() as patched:
        interrupt_after_one(patched)
        code, out, _ = harness(*arguments, "--out", "stopped")
    assert code == 130
    assert "continue with the same command and --resume stopped" in out
    disturbed = RunState(DISTURBED, ("another program ran",))
    monkeypatch.setattr("harness.measuring.run.assess_records", lambda *_: disturbed)
    out, _ = require_ok(harness(*arguments, "--resume", "stopped"))
    assert ("predicts the helper lanes of reference on cpu best (rank" in out) == (
        command == "validate"
    )
    assert "the run's times are disturbed: another program ran. Therefore results use exact" in out


@pytest.mark.usefixtures("no_plots", "in_process")
@pytest.mark.parametrize("command", ["validate", "pareto"])
def test_failed_case_is_reported_with_the_exit_code(harness, command, monkeypatch):
    monkeypatch.setenv("MOCK_FAULT", "count:raise")  # for an odd number of triangles: seven here
    triangulators = parse_all(
        ["delaunay", "optimal:overdraw", "optimal:half-perimeter", "worst:overdraw"]
    )
    monkeypatch.setattr("harness.study.subjects.choose_triangulators", lambda *_: triangulators)
    rasterisers = "reference,tests.mock:MockRasteriser"
    arguments = (
        "study",
        command,
        "--scene",
        "paper",
        "--rasterisers",
        rasterisers,
        "--budget",
        "0.001",
    )
    code, _, err = harness(*arguments, "--out", "out")
    assert code == 5
    assert "cases failed" in err.splitlines()[-1]
    assert "scripted failure" in (Path("out") / "cases.jsonl").read_text()
    assert list(Path("out").glob("*.csv"))  # measured results are written


def test_a_study_of_a_file_has_both_names():
    folder = choose_folder("there/own.geojson", None, None, before="validate-")
    assert folder.name.startswith("validate-own-")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "out"
    arguments = ["study", "validate", "--scene", "city:buildings=80", "--quick", "--quiet"]
    arguments += ["--rasterisers", "reference", "--resolution", "512", "--out", str(folder)]
    with pytest.MonkeyPatch.context() as patch:
        shorten_runs(patch)  # this test evaluates counters, not times
        patch.setattr("harness.commands.study_validate.QUICK_S", 1e-4)
        assert run_command(*arguments) == 0
    return folder


def test_a_is_exact_for_box_tests_and_h_is_not(study):
    table = pd.read_csv(study / "correlations.csv")
    assert list(table.columns) == [
        *("rasteriser", "device", "criterion", "measure", "statistic"),
        *("value", "ci_low", "ci_high", "polygons"),
    ]
    cells = table[table["statistic"] == "spearman_within"].set_index(
        ["rasteriser", "criterion", "measure"]
    )["value"]
    assert cells["reference", "overdraw", "bbox_tests"] > 0.999
    assert cells["reference", "exact-quads", "helper_lanes"] == 1.0
    assert cells["binning", "exact-tiles-16", "tiles_16"] == 1.0
    assert cells["reference", "half-perimeter", "helper_lanes"] > 0.9
    assert (
        cells["reference", "half-perimeter", "helper_lanes"]
        > cells["reference", "overdraw", "helper_lanes"]
    )
    assert np.isnan(cells["reference", "complexity", "helper_lanes"])


def test_study_has_a_record_per_triangulation_and_plots(study):
    stored = read_run(study)
    assert stored.problems == []
    assert {record["status"] for record in get_rows(stored)} <= {"ok", "skipped"}
    assert len({record["scene"] for record in get_rows(stored)}) == 6
    plots = {path.name for path in (study / "plots").iterdir()}
    assert "predicted-vs-measured-reference-cpu.svg" in plots
    assert (study / "criteria.md").read_text().count("| half-perimeter |") == 4


def test_equal_triangulations_count_once(study):
    records = list(read_run(study).records)
    table = make_measure_table(records)
    twin = [record.with_id(triangulator="twin") for record in records]
    with_twin = make_measure_table([*records, *twin])
    assert len(with_twin) == len(table)
    pd.testing.assert_frame_equal(make_correlation_table(with_twin), make_correlation_table(table))


def test_all_triangulations_of_the_papers_polygon_are_listed(harness, tmp_path):
    counts = {}
    for mode in ("paper", "conforming"):
        assert harness("inspect", "paper", "--every", mode, "--out", f"all/{mode}")[0] == 0
        table = pd.read_csv(tmp_path / "all" / mode / "triangulations.csv")
        counts[mode] = len(table)
    assert counts == {"paper": 47, "conforming": 29}
    table = pd.read_csv(tmp_path / "all" / "paper" / "triangulations.csv")
    assert table["conforming"].sum() == 29
    assert table.loc[0, "overdraw"] == 53
    assert not table.loc[0, "conforming"]
    assert table[table["conforming"]]["overdraw"].min() == 56


def test_the_expected_quads_rank_better_than_the_half_perimeter(study):
    table = pd.read_csv(study / "correlations.csv")
    mask = (table["rasteriser"] == "reference") & (table["measure"] == "helper_lanes")
    cells = table[mask & (table["statistic"] == "spearman_within")].set_index("criterion")["value"]
    assert cells["expected-quads"] > 0.98
    assert cells["expected-quads"] > cells["half-perimeter"] > cells["overdraw"]


def test_correlations_of_each_resolution(study):
    table = pd.read_csv(study / "measured.csv").query("rasteriser == 'reference'")
    assert correlate_by_resolution(table).empty
    twice = pd.concat([table, table.assign(resolution=64)])
    sizes = correlate_by_resolution(twice)
    assert set(sizes["resolution"]) == {64, 512}
    of_one_size = make_correlation_table(table)
    of_512 = sizes[sizes["resolution"] == 512].drop(columns="resolution").reset_index(drop=True)
    pd.testing.assert_frame_equal(of_512, of_one_size)


def scripted(name: str, seconds: list[float], quads: int = 5) -> Record:
    return make_record(
        name,
        key=name * 16,
        polygons=1,
        counters={"quads": quads},
        time={"samples_s": seconds, "reference_s": [1.0] * len(seconds)},
    )


def test_agreement_is_computed_over_decided_pairs(monkeypatch):
    monkeypatch.setattr("scripts.repeated_runs.drop_equal_triangulations", list)
    steady = [1.0] * 12
    first = [scripted("a", steady), scripted("b", [2.0] * 12), scripted("c", [3.0] * 12)]
    swapped = [scripted("a", steady), scripted("b", [4.0] * 12), scripted("c", [3.0] * 12, 6)]
    cases, unequal, verdicts = compare_repeated(first, swapped)
    assert (cases, unequal) == (3, ["c" * 16])
    assert verdicts == {("opengl", "llvmpipe"): (3, 2, 3, 2)}
    undecided = [scripted("a", steady), scripted("b", [0.5, 2.0] * 6), scripted("c", [3.0] * 12)]
    assert compare_repeated(first, undecided)[2] == {("opengl", "llvmpipe"): (3, 2, 2, 2)}
