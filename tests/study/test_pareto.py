"""The study of the Pareto front, end to end on the CPU reference and a scripted rasteriser."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from shapely import Polygon, box

from harness.frame import View, make_frame
from harness.metrics.statistics import add_run_scatter, compute_paired_ratio
from harness.results.run_folder import read_run
from harness.study import pareto
from scenes import load
from tests.conftest import assert_refused, require_ok, write_geojson
from tests.measuring.test_run import make_plan, measure
from tests.records import get_rows

pytestmark = pytest.mark.usefixtures("in_process")

MOCK = "tests.mock:MockRasteriser"
BRIEF = ["--rasterisers", MOCK, "--budget", "0.001", "--quiet"]
STUDY = ["study", "pareto", "--rasterisers", f"reference,{MOCK}", "--budget", "0.01", "--quiet"]
CITY = "city:buildings=40"


@pytest.fixture
def study(harness, tmp_path):
    """Run the study on a scene; return (folder, pareto.csv, fronts.csv, output)."""

    def run(scene: str, *more: str) -> tuple[Path, pd.DataFrame, pd.DataFrame, str]:
        out, _ = require_ok(harness(*STUDY, "--scene", scene, "--out", "out", *more))
        folder = tmp_path / "out"
        tables = [pd.read_csv(folder / f"{name}.csv") for name in ("pareto", "fronts")]
        return folder, tables[0], tables[1], out

    return run


def test_a_and_d_agree_on_the_papers_polygon(study):
    _, table, fronts, out = study("paper")
    everything = pareto.make_triangulation_table(load("paper").polygons[0], "conforming")
    best = everything["overdraw"].argmin()
    assert best == everything["shape"].argmin()
    frame = make_frame(load("paper").polygons, View(512))
    assert len(fronts) == 1
    assert fronts["overdraw"][0] == pytest.approx(56 * frame.scale**2, rel=1e-3)
    assert fronts["shape"][0] == pytest.approx(everything["shape"][best], rel=1e-3)
    assert out.split("fastest triangulator")[1].split()[:4] == ["0", "reference", "1", "0"]
    costs = table.drop_duplicates("triangulator").set_index("triangulator")
    pair = costs.loc[["optimal:mixed=1/1/0", pareto.WITH_C], ["overdraw", "shape"]].to_numpy()
    assert (pair[0] == pair[1]).all()  # C is the same for all
    sweep = table[table["kind"] == "sweep"]
    assert set(sweep["triangulator"]) == {*pareto.SWEEP, pareto.WITH_C}
    assert sweep["same_as_end"].all()
    assert table.loc[table["kind"] == "front", "triangulator"].unique().tolist() == ["pareto#0"]
    assert table["overdraw_over_area"].min() == pytest.approx(56 / 46, rel=1e-3)


@pytest.mark.usefixtures("no_plots")
def test_fronts_of_a_city_are_those_of_all_triangulations(study):
    _, table, fronts, _ = study(CITY, "--polygons", "3")
    polygons = load(CITY).polygons
    compared = 0
    for number, front in fronts.groupby("polygon"):
        polygon = make_frame([polygons[number]], View(512)).polygons[0]
        costs = front[["overdraw", "shape"]].to_numpy()
        measured = table[(table["polygon"] == str(number)) & (table["rasteriser"] == "reference")]
        front_rows = measured[measured["kind"] == "front"]
        assert len(front_rows) == min(pareto.MAX_POINTS, len(front)) == front["measured"].sum()
        assert {0, len(front) - 1} <= set(front_rows["triangulator"].str[7:].astype(int))
        assert front_rows["undominated"].all()
        if len(polygon.exterior.coords) <= 13:
            every = pareto.make_triangulation_table(polygon, "conforming")
            listed = np.column_stack((every["overdraw"], every["shape"]))
            assert pareto.mark_undominated(costs, listed).all()
            undominated = listed[pareto.mark_undominated(listed, listed)]
            assert np.ptp(undominated[:, 0]) == pytest.approx(np.ptp(costs[:, 0]))
            assert len(np.unique(undominated.round(6), axis=0)) == len(costs)
            compared += 1
    assert compared >= 1
    complete = table[(table["polygon"] == "all") & (table["rasteriser"] == "reference")]
    sweep = complete[(complete["kind"] == "sweep") & (complete["gamma"] == 0)]
    steps = sweep.set_index("triangulator").loc[list(pareto.SWEEP)]
    assert (np.diff(steps["overdraw_over_area"]) >= -1e-9).all()
    assert (np.diff(steps["shape_a_triangle"]) <= 1e-9).all()
    # Both skip polygons with holes, so their sums are over fewer polygons.
    assert not set(complete["triangulator"]) & {"fan", "max-area"}


@pytest.mark.usefixtures("no_plots")
def test_rows_have_the_records_ratios_and_the_study_resumes(study, harness):
    folder, table, _, _ = study(CITY, "--polygons", "1")
    run = read_run(folder)
    assert run.problems == []
    records = {(r["scene"], r["triangulator"], r["rasteriser"]): r for r in get_rows(run)}
    rows = table[table["polygon"] == "all"].set_index(["triangulator", "rasteriser"])
    record = records[CITY, "delaunay", "reference"]
    row = rows.loc[("delaunay", "reference")]
    assert row["helper_lanes"] == record["counters"]["helper_lanes"]
    assert row["bbox_tests"] == record["counters"]["bbox_tests"]
    assert row["overdraw"] == pytest.approx(record["predicted"]["overdraw"])
    end = records[CITY, pareto.SWEEP[0], "reference"]
    times, samples_s = record["time"], end["time"]["samples_s"]
    ratio = add_run_scatter(compute_paired_ratio(times["samples_s"], samples_s, times["epochs"]))
    values = tuple(row[["time_ratio", "ci_low", "ci_high"]])
    assert values == pytest.approx((ratio.value, ratio.low, ratio.high))
    # The scripted rasteriser's time depends only on the number of triangles.
    timed = rows.xs(MOCK, level="rasteriser")
    assert (timed.loc[list(pareto.SWEEP), "time_ratio"] == 1).all()
    assert (timed.loc[list(pareto.SWEEP), "verdict"] == "not significant").all()
    assert set(run.facts["plan"]["triangulators"]) == {r["triangulator"] for r in get_rows(run)}
    cases = (folder / "cases.jsonl").read_text()
    (folder / "pareto.csv").unlink()
    require_ok(harness(*STUDY, "--scene", CITY, "--polygons", "1", "--resume", "out"))
    assert (folder / "cases.jsonl").read_text() == cases
    pd.testing.assert_frame_equal(pd.read_csv(folder / "pareto.csv"), table)


def test_long_front_is_sampled_evenly():
    parts, fronts = pareto.make_parts("city", load("city"), 6, View(512))
    label, front = max(fronts.items(), key=lambda entry: len(entry[1]))
    assert len(front) > 100
    steps = front["k"][front["measured"]].tolist()
    assert len(steps) == pareto.MAX_POINTS
    assert np.ptp(np.diff(steps)) <= 1
    part = next(part for part in parts if part.label == label)
    expected = [*(f"pareto#{k}" for k in steps), *pareto.list_compared()]
    assert [str(recipe) for recipe in part.triangulators] == expected
    assert parts[-1].label == "city"


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ("paper --resolution 3", ["--resolution", "8"]),
        ("paper --out a --resume b", ["--out", "--resume"]),
        ("paper --rasterisers opngl", ["opngl", "opengl"]),
        ("square.geojson", ["no polygon without holes of 8 to 100 vertices"]),
    ],
)
def test_bad_usage_is_reported_in_one_line(harness, arguments, parts):
    write_geojson(Path("square.geojson"), [box(0, 0, 9, 9)])
    command = ("study", "pareto", "--quiet", "--scene")
    assert_refused(harness(*command, *arguments.split()), *parts)


def test_a_study_that_measures_nothing_is_exit_code_4(harness, monkeypatch):
    monkeypatch.setenv("MOCK_FAULT", "count:error")  # with 9 corners all have 7 triangles
    turns = np.linspace(0, 2 * np.pi, 10)[:-1]
    nonagon = Polygon(np.column_stack((np.cos(turns), np.sin(turns))))
    write_geojson(Path("nonagon.geojson"), [nonagon])
    answer = harness("study", "pareto", "--scene", "nonagon.geojson", "--out", "out", *BRIEF)
    assert_refused(answer, "nothing was measured", "out/cases.jsonl", code=4)


@pytest.mark.usefixtures("no_plots")
def test_equivalent_weights_are_one_case(harness, block):
    names = "optimal:mixed=1.0/.5/0,optimal:mixed=1/0.5/0,worst:mixed=1/0.5/0,optimal:mixed=1/1/1"
    run = ("run", "--scene", str(block), "--triangulators", names, *BRIEF)
    assert harness(*run, "--out", "results")[0] == 0
    stored = read_run(Path("results"))
    keys = {record["triangulator"]: record["key"] for record in get_rows(stored)}
    assert list(keys) == ["optimal:mixed=1/0.5/0", "worst:mixed=1/0.5/0", "optimal:mixed"]
    assert harness("run", "--resume", "results", "--quiet")[0] == 0
    assert len(get_rows(read_run(Path("results")))) == 3
    assert harness("compare", "results", "results", "--gate", "counters")[0] == 0
    mesh = ("triangulate", str(block), "-o", "block.obj", "--quiet")
    assert harness(*mesh, "--criterion", "mixed=1/0.5/0")[0] == 0
    assert "mixed=1/0.5/0" in harness("list", "criteria")[1]
    answer = harness(*mesh, "--criterion", "mixed=1/0.5")
    assert_refused(answer, "mixed=1/0.5", "alpha/beta/gamma", "3 finite numbers")
    answer = harness("run", "--scene", str(block), "--triangulators", "optimal:mixed=1/-1/0")
    assert_refused(answer, "mixed=1/-1/0", "not negative and not all 0")


def test_points_of_the_front_are_cases_by_number(block, tmp_path):
    names = ("pareto", "pareto#0", "pareto#01", "pareto#1", "pareto#99")
    records = get_rows(measure(make_plan(block, triangulators=names), tmp_path / "out"))
    status = {record["triangulator"]: record["status"] for record in records}
    # An L of six vertices and a square have a front each; the courtyard has a hole.
    assert set(status) == {"pareto#0", "pareto#1", "pareto#99"}
    assert (status["pareto#0"], status["pareto#99"]) == ("ok", "skipped")
    first = next(record for record in records if record["triangulator"] == "pareto#0")
    assert (first["polygons"], first["polygons_skipped"]) == (2, 1)
