import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness import history
from tests.compare.runs import add_cost, add_time, write_run
from tests.conftest import assert_refused, require_ok

pytestmark = pytest.mark.usefixtures("no_plots")


def write_runs(folder: Path, count: int, edits, numbers, **options) -> list:
    """Write `count` runs, of which `numbers` are edited; return the series of their metrics."""
    for number in range(1, count + 1):
        write_run(folder / str(number), seed=number, edits=edits if number in numbers else {})
    return history.read_series(history.find_runs([folder])[0], **options)


def read_rows(folder: str) -> list[dict[str, str]]:
    with Path(folder, "history.csv").open() as stream:
        return list(csv.DictReader(stream))


@pytest.fixture
def year(tmp_path) -> Path:
    """Sixteen runs: the machine's speed varies, delaunay is 12 % slower from the tenth on."""
    rng = np.random.default_rng(1)
    for number in range(1, 17):
        edits = {"delaunay": add_time(0.12)} if number >= 10 else {}
        if number >= 6:
            edits["ear-clipping"] = add_cost(0.03)
        speed = math.exp(rng.normal(0, 0.05))
        # The order of the names differs from the order of creation.
        write_run(tmp_path / f"run-{99 - number}", seed=number, edits=edits, speed=speed)
    return tmp_path


def test_changes_have_positions_in_the_order_of_creation(year):
    twice = [year / "run-98", year / "run-98" / "cases.jsonl"]  # the first run
    runs = history.find_runs([year, *twice])[0]
    assert [run.path.name for run in runs] == [f"run-{99 - number}" for number in range(1, 17)]
    series = history.read_series(runs)
    changes = {(s.metric, s.id.name): s.changes for s in series if s.changes}
    assert changes == {
        ("quads", "ear-clipping"): (5,),
        ("helper_lanes", "ear-clipping"): (5,),
        ("time", "delaunay"): (9,),
    }
    together = next(s for s in series if s.id.name == history.GROUP_NAME)
    assert together.metric == "time"
    assert np.ptp(np.log(together.values)) > 0.05


def test_changed_content_is_not_a_change(tmp_path):
    def other(entry):
        entry["scene_hash"] = "0" * 16
        add_cost(0.5)(entry)

    all_series = write_runs(tmp_path, 6, {"*": other}, (4, 5, 6))
    assert not any(series.changes for series in all_series)


def test_missing_runs_are_not_changes(tmp_path):
    for number in range(1, 5):
        leave_out = ("fan",) if number == 2 else ()
        write_run(tmp_path / str(number), seed=number, leave_out=leave_out)
    runs, _ = history.find_runs([tmp_path])
    fan = next(series for series in history.read_series(runs) if series.id.name == "fan")
    assert np.isnan(fan.values).tolist() == [False, True, False, False]
    assert fan.changes == ()


def test_common_change_of_runs_without_the_first_case_is_found(tmp_path):
    for number in range(1, 11):
        leave_out = ("fan",) if number in (2, 4, 7, 9) else ()
        speed = 1.0 if number <= 5 else 1.2
        write_run(tmp_path / str(number), seed=number, speed=speed, leave_out=leave_out)
    series = history.read_series(history.find_runs([tmp_path])[0])
    together = next(entry for entry in series if entry.id.name == history.GROUP_NAME)
    assert together.changes == (5,)


def test_cached_triangulations_have_no_values(tmp_path):
    def read_back(entry):
        entry |= {"polygons_cached": 500, "triangulate_s": 0.5}

    edits = {"delaunay": read_back}
    all_series = write_runs(tmp_path, 6, edits, (2, 5), metrics=["triangulate_ms"])
    delaunay = next(series for series in all_series if series.id.name == "delaunay")
    assert np.isnan(delaunay.values).tolist() == [False, True, False, False, True, False]
    assert np.nanmax(delaunay.values) == 50
    assert not any(series.changes for series in all_series)


def test_zero_times_are_not_changes(tmp_path):
    edits = {"fan": lambda entry: entry.update(triangulate_s=0.0)}
    all_series = write_runs(tmp_path, 6, edits, range(1, 7), metrics=["triangulate_ms"])
    assert not any(series.changes for series in all_series)


def test_the_command_draws_and_lists(harness, year):
    out, _ = require_ok(harness("history", str(year), "--out", "plots", "--all"))
    files = {path.name for path in Path("plots").iterdir()}
    metrics = ("quads", "helper_lanes", "time")
    assert files == {"history.csv"} | {f"{m}.{kind}" for m in metrics for kind in ("png", "svg")}
    change = "city 1024 px, opengl on llvmpipe: 70,400 → 72,512 (+3.0 %)"
    assert f"quads of ear-clipping, {change}" in out
    assert "time of delaunay" in out
    rows = read_rows("plots")
    marked = [row for row in rows if row["change"] == "1"]
    assert len(rows) == 16 * (5 + 5 + 6)
    assert len(marked) == 3


def test_largest_changes_are_shown_and_other_series_counted(harness, year):
    out, _ = require_ok(harness("history", str(year), "--out", "plots"))
    series = {(row["metric"], row["triangulator"]) for row in read_rows("plots")}
    assert len(series) == history.MAX_SERIES
    counters = {("quads", "ear-clipping"), ("helper_lanes", "ear-clipping")}
    assert counters | {("time", "delaunay")} < series
    assert "16 runs, 12 series: plots; 4 more series: --all, or choose by --scene" in out
    choice = ("--triangulator", "delaunay", "--metric", "time")
    out, _ = require_ok(harness("history", str(year), "--out", "one", *choice))
    assert "16 runs, 1 series: one" in out
    assert {file.name for file in Path("one").iterdir()} == {"history.csv", "time.png", "time.svg"}


def test_studies_and_base_runs_are_skipped(harness, year):
    for name in ("validate", "pareto"):
        environment = {"command": ["harness", "study", name, "--scene", "city"]}
        write_run(year / name, seed=3, facts={"environment": environment})
    write_run(year / "run-98/base", seed=3, facts={"beside": {"is_base": True}})
    runs, studies = history.find_runs([year])
    assert (len(runs), studies) == (16, 2)
    assert len(history.find_runs([year], studies=True)[0]) == 18
    assert len(history.find_runs([year / "pareto"])[0]) == 1  # a folder given by name is read
    out, _ = require_ok(harness("history", str(year), "--out", "plots"))
    assert out.startswith("skipped: 2 studies; see --all")


def test_single_run_has_no_history(harness):
    write_run(Path("runs/one"), seed=1)
    out, _ = require_ok(harness("history", "runs", "--out", "plots"))
    assert "1 run, 0 series: no case was measured by two runs; 16 more series" in out
    assert not Path("plots").exists()


@pytest.mark.parametrize(
    ("arguments", "code", "parts"),
    [
        (["nowhere"], 2, ["nowhere has no run"]),
        (["runs", "--metrics", "qads"], 2, ["qads", "quads"]),
        (["runs", "--metrics", "bbox_tests"], 4, ["bbox_tests"]),
        (["runs", "--scene", "cyti"], 2, ["cyti", "city"]),
        (["runs", "--triangulator", "delauney"], 2, ["delauney", "delaunay"]),
        (["runs", "--rasteriser", "opengls"], 2, ["opengls", "opengl"]),
    ],
)
def test_bad_usage(harness, arguments, code, parts):
    write_run(Path("runs/one"), seed=1)
    assert_refused(harness("history", *arguments), *parts, code=code)


@given(st.lists(st.integers(0, 3), min_size=1, max_size=30))
def test_exact_changes_are_all_differences(values):
    changes = history.find_exact_changes(np.array(values, float))
    assert changes == [n for n in range(1, len(values)) if values[n] != values[n - 1]]


@given(seed=st.integers(0, 2**32), runs=st.integers(1, 60))
def test_a_level_series_with_outliers_has_no_changes(seed, runs):
    rng = np.random.default_rng(seed)
    logs = rng.normal(0, 0.006, runs)
    logs[rng.random(runs) < 0.05] += 0.7  # a busy machine
    lonely = np.convolve(logs > 0.3, np.ones(2 * 3), mode="same").max(initial=0) <= 1
    assert not lonely or history.find_noisy_changes(logs) == []


@given(seed=st.integers(0, 2**32), index=st.integers(5, 15), sign=st.sampled_from([-1, 1]))
def test_step_is_detected_at_its_index(seed, index, sign):
    logs = np.random.default_rng(seed).normal(0, 0.006, 20)
    logs[index:] += sign * 3 * history.MIN_STEP
    assert history.find_noisy_changes(logs) == [index]
