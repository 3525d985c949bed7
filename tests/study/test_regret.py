"""Regret on made-up records, where the right answers are known."""

from __future__ import annotations

import numpy as np
import pytest

from harness.figures.intervals import FEWEST
from harness.figures.registry import find
from harness.study.regret import (
    _figure,
    main_measures,
    plot_regret,
    regret_table,
    summarise,
    written,
)

NAMES = ("optimal:exact-quads", "optimal:half-perimeter", "random#0", "random#1", "worst:overdraw")
QUADS = (100, 103, 110, 120, 150)
H = (11.0, 10.0, 12.0, 13.0, 20.0)
A = (4.0, 5.0, 3.0, 6.0, 9.0)


def records_of(polygon: str, scale: float = 1.0, seconds=None, work: int = 0) -> list[dict]:
    """Return the records of one polygon; `seconds` (5, rounds) of each drawing."""
    found = []
    for number, name in enumerate(NAMES):
        record = {
            "key": f"{polygon}-{name}-{work}",
            "scene": polygon,
            "rasteriser": "reference",
            "device": "cpu",
            "resolution": 64,
            "rotation": 0.0,
            "fit": "box",
            "options": {"work": work, "samples": 1},
            "triangulator": name,
            "status": "ok",
            "polygons": 1,
            "proven": 1 if number == 0 else None,
            "conforming": True,
            "counters": {"quads": int(QUADS[number] * scale), "fragments": 300},
            "predicted": {"half_perimeter": H[number], "overdraw": A[number], "shape": 1.0},
            "time": None,
        }
        if seconds is not None:
            samples = seconds[number].tolist()
            record["time"] = {"samples_s": samples, "reference_s": [1.0] * len(samples)}
        found.append(record)
    return found


def row_of(table, **wanted):
    for name, value in wanted.items():
        table = table[table[name] == value]
    assert len(table) == 1
    return table.iloc[0]


def test_a_criterion_loses_what_its_choice_costs_more():
    table = regret_table(records_of("a"))
    by_h = row_of(table, kind="criterion", name="half-perimeter", measure="quads")
    assert (by_h["triangulator"], by_h["best"]) == ("optimal:half-perimeter", NAMES[0])
    assert by_h["regret"] == pytest.approx(0.03)
    assert by_h["least_known"]
    by_a = row_of(table, kind="criterion", name="overdraw", measure="quads")
    assert by_a["triangulator"] == "random#0"
    assert by_a["regret"] == pytest.approx(0.10)
    # What is the same for all triangulations chooses none.
    assert not (table["name"] == "shape").any()
    # The worst is no choice; random ones are one family.
    assert set(table[table["kind"] == "triangulator"]["name"]) == {*NAMES[:2], "random"}


def test_the_best_measured_is_no_least_without_a_proof():
    records = records_of("a")
    records[0]["proven"] = 0
    assert not regret_table(records)["least_known"].any()


def test_over_polygons_each_counts_once():
    table = summarise(regret_table(records_of("a") + records_of("b", 2.0) + records_of("c", 3.0)))
    random = row_of(table, name="random", measure="quads")
    assert random["polygons"] == 3
    assert random["mean"] == pytest.approx(0.15)
    assert np.isnan(random["ci_low"]), "three equal values tell no interval"
    assert random["least_known"] == 1.0


def test_counters_count_once_whatever_the_work():
    records = records_of("a") + records_of("a", work=8)
    table = regret_table(records)
    assert len(table[table["measure"] == "quads"]) == len(regret_table(records_of("a")))


def test_equal_times_show_no_regret():
    """The least of several noisy medians makes the others look slower, and its rival faster."""
    rng = np.random.default_rng(5)
    records = []
    for polygon in range(60):
        noise = rng.lognormal(0.0, 0.05, (len(NAMES), 24))
        records += records_of(f"polygon {polygon}", seconds=noise)
    table = regret_table(records)
    timed = table[(table["measure"] == "time_work_0") & (table["kind"] == "criterion")]
    assert abs(timed["regret_low"].mean()) < 0.006
    assert timed["regret_high"].mean() > 0.01
    assert (timed["regret_high"] >= 0).all()
    shown = summarise(timed)
    assert len(shown) == 2
    assert shown["ci_low"].between(0, 0.001).all(), "nothing is better than the best"
    assert shown["ci_high"].between(0.005, 0.05).all()


def test_a_slower_choice_is_found():
    rng = np.random.default_rng(6)
    records = []
    for polygon in range(30):
        noise = rng.lognormal(0.0, 0.02, (len(NAMES), 24))
        noise[1] *= 1.05  # what half-perimeter chooses
        records += records_of(f"polygon {polygon}", seconds=noise)
    table = summarise(regret_table(records))
    row = row_of(table, name="half-perimeter", measure="time_work_0")
    assert row["ci_low"] < 0.05 < row["ci_high"]
    assert 0.04 < row["mean"] < 0.06


def test_rounds_of_one_epoch_do_not_confirm_each_other():
    """Where its buffers lie makes a drawing fast in all rounds of an epoch, and of no other."""
    rng = np.random.default_rng(7)
    ends = []
    for polygon in range(40):
        epoch = np.repeat(rng.lognormal(0.0, 0.02, (len(NAMES), 6)), 4, axis=1)
        records = records_of(f"polygon {polygon}", seconds=epoch)
        for record in records:
            record["time"]["epochs"] = [4] * 6
        timed = regret_table(records).query("measure == 'time_work_0' and kind == 'criterion'")
        ends.append(timed[["regret_low", "regret_high"]].mean())
    low, high = np.mean(ends, axis=0)
    # Rounds of one epoch would have confirmed its fastest: both ends would be 1 %.
    assert low < 0.004 < 0.006 < high


def test_least_is_claimed_for_one_sample_a_pixel_alone():
    records = records_of("a")
    assert regret_table(records).query("measure == 'quads'")["least_known"].all()
    for record in records:
        record["options"] = {"work": 0, "samples": 4}
    assert not regret_table(records)["least_known"].any()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([0.0] * 12, "0.00% (all equal)"),
        ([0.1, 0.2, 0.3], "20.00% (too few polygons)"),
        ([0.0] * 11 + [1.2], "10.00% (one decides)"),
    ],
)
def test_where_there_is_no_interval_it_says_why(values, words):
    records = [r for k in range(len(values)) for r in records_of(f"p{k}")]
    table = regret_table(records).query("measure == 'quads' and name == 'overdraw'").copy()
    table = table.assign(**dict.fromkeys(("regret", "regret_low", "regret_high"), values))
    assert written(summarise(table).iloc[0]) == words


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (["time_work_0", "fragments", "quads", "helper_lanes"], ["quads", "helper_lanes"]),
        (["bbox_tests", "spills"], ["bbox_tests"]),
        ([], []),
    ],
)
def test_quads_are_shown_or_the_main_counter_and_all_times(names, shown):
    times = [name for name in names if name.startswith("time")]
    assert main_measures(names) == shown + times


def test_the_least_of_times_is_known_of_no_drawing():
    seconds = np.ones((len(NAMES), 24))
    table = regret_table(records_of("one", seconds=seconds))
    assert not table[table["measure"] == "time_work_0"]["least_known"].any()
    assert table[table["measure"] == "quads"]["least_known"].all()


def test_as_many_polygons_as_are_asked_for_are_not_too_few():
    row = {"ci_low": np.nan, "ci_high": np.nan, "mean": 0.1, "worst": 0.1}
    assert written({**row, "polygons": FEWEST}) == "10.00% (all equal)"
    assert written({**row, "polygons": FEWEST - 1}) == "10.00% (too few polygons)"
    assert written({**row, "worst": 0.1 * FEWEST, "polygons": FEWEST}) == "10.00% (one decides)"


def test_a_counter_that_a_drawing_lacks_is_not_judged():
    records = records_of("one")
    del records[2]["counters"]["quads"]
    records[2]["counters"]["fragments"] = None
    assert regret_table(records_of("one"))["measure"].unique().tolist()
    assert regret_table(records).empty


def test_the_picture_has_criteria_on_top_best_first_and_says_what_0_is():
    counted = [r for k in range(FEWEST) for r in records_of(f"polygon {k}")]
    summary = summarise(regret_table(counted))
    figure = _figure(summary, ["quads"], "here")
    axes = figure.axes[0]
    names = [label.get_text() for label in axes.get_yticklabels()][::-1]
    criteria = summary[summary["kind"] == "criterion"].sort_values("mean", kind="stable")
    assert names[: len(criteria)] == [find(name).title for name in criteria["name"]]
    assert len(names) > len(criteria)
    assert "that there are" in figure.get_suptitle()
    unproven = [{**record, "proven": None} for record in counted]
    told = _figure(summarise(regret_table(unproven)), ["quads"], "here").get_suptitle()
    assert "that were measured" in told


def test_the_picture_of_each_view_is_named_after_it(tmp_path):
    summary = summarise(regret_table([r for k in range(3) for r in records_of(f"p{k}")]))
    files = plot_regret(summary, tmp_path)
    assert {file.parent for file in files} == {tmp_path / "plots"}
    assert {file.stem for file in files} == {"regret-reference-cpu-64-0"}
    assert all(file.stat().st_size for file in files)
    assert plot_regret(summary[:0], tmp_path) == []
