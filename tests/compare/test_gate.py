"""What the gate must see, and what it must not call a regression."""

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.compare.comparison import _has_other_device, compare_runs, no_baseline
from harness.compare.matching import Match, find_changed_hardware
from harness.compare.model import CaseChange, Settings, parse_threshold
from harness.compare.outputs import to_html, to_json, to_junit, to_markdown
from harness.compare.times import classify
from harness.compare.wording import build_tables, format_headline
from harness.errors import UsageError
from harness.metrics.groups import IDENTIFYING
from harness.rasterisers.reference import Binning
from harness.results.run_folder import Run, read_run
from scripts.repeated_runs import compare_repeated
from tests.compare.runs import (
    SCENARIOS,
    TRIANGULATORS,
    Edit,
    beside,
    costlier,
    plan,
    record,
    slower,
    write_run,
)
from tests.metrics.test_decision import base, made
from tests.records import make_record, make_run

COUNTERS = Settings(gates=("counters",))


def counted(counters: dict[str, int]) -> Edit:
    """Return an edit that makes the case one of a rasteriser that counts these, untimed."""

    def edit(entry: dict[str, Any]) -> None:
        entry |= {"counters": dict(counters), "rasteriser": "theirs", "device": "asic"}
        entry.pop("time", None)

    return edit


def compared(tmp_path: Path, base: Edit, head: Edit, settings: Settings = COUNTERS):
    facts = {"plan": plan(rasterisers=["theirs"])}
    runs = [
        read_run(write_run(tmp_path / name, seed=seed, edits={"*": edit}, facts=facts))
        for name, seed, edit in (("base", 1, base), ("head", 2, head))
    ]
    return compare_runs(*runs, settings)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("scene", "cad"), ("triangulator", "fan"), ("rasteriser", "webgpu"), ("device", "zink")),
        *(("resolution", 512), ("rotation", 30.0), ("fit", "circle"), ("options", {"samples": 4})),
        ("options", {"texture": 1}),
    ],
)
def test_what_differs_in_one_of_these_is_another_case(field, value):
    usual = {"fit": "box", **record("delaunay", seed=1)}
    name, other, same = (
        make_record(**usual | change).id for change in ({}, {field: value}, {"polygons": 3})
    )
    assert name != other
    assert name == same


def test_counters_of_the_binner_and_of_the_order_are_gated(tmp_path):
    names = (*Binning.counters, "vertex_batches", "transformed_vertices")
    before = {name: 1000 + number for number, name in enumerate(names)}
    for name in before:
        after = before | {name: round(before[name] * 1.5)}
        found = compared(tmp_path / name, counted(before), counted(after))
        assert found.exit_code == 1
        assert f"{name.replace('_', ' ')} {before[name]:,} → " in format_headline(found)
        assert all(case.regressions()[0].metric == name for case in found.cases)


@pytest.mark.parametrize(("share", "worst"), [(0.2, "fan"), (2.0, "delaunay")])
def test_the_headline_names_what_grew_most_whether_it_was_counted_or_timed(tmp_path, share, worst):
    """One case has 1.4 times more helper lanes, another, which counts nothing, takes longer."""

    def uncounted(entry: dict[str, Any]) -> None:
        entry["counters"] = {}

    def slow(entry: dict[str, Any]) -> None:
        uncounted(entry)
        slower(share)(entry)

    one = write_run(tmp_path / "base", seed=1, edits={"delaunay": uncounted})
    edits = {"delaunay": slow, "fan": costlier(0.5)}
    other = write_run(tmp_path / "head", seed=2, edits=edits)
    found = compare_runs(read_run(one), read_run(other), Settings(gates=("counters", "time")))
    assert {case.id.name for case in found.regressed()} == {"delaunay", "fan"}
    assert format_headline(found).startswith(f"Regression: {worst}, city")


def test_what_regressed_has_the_first_column_and_others_follow_what_is_usual(tmp_path):
    before = {"quads": 100, "spills": 100, "stalls": 100}
    after = before | {"spills": 150, "stalls": 150}
    (group,) = build_tables(compared(tmp_path, counted(before), counted(after)))
    assert group.heading[1:4] == ("spills", "stalls", "quads")


@pytest.mark.parametrize("name", ["spills", "overdraw", "draw_ms", "half_perimeter"])
def test_a_counter_nobody_registered_is_gated_whatever_its_name(tmp_path, name):
    found = compared(tmp_path, counted({name: 100}), counted({name: 101}))
    assert found.exit_code == 1
    assert "+1.0 %" in format_headline(found)
    assert "101 (+1.0 %)" in str(build_tables(found)[0].rows[0].cells)
    back = compared(tmp_path / "back", counted({name: 101}), counted({name: 100}))
    assert back.exit_code == 0
    assert "5 improved" in format_headline(back)


def test_a_threshold_may_name_any_counter_of_the_runs(tmp_path):
    edits = counted({"spills": 100}), counted({"spills": 101})
    loose = Settings(gates=("counters",), thresholds={"spills": 0.02})
    assert compared(tmp_path, *edits, loose).exit_code == 0


@pytest.mark.parametrize("shared", ["fragments", "hits", "samples_passed"])
@pytest.mark.parametrize("after", [999, 1001])
def test_pixels_that_every_triangulation_covers_may_not_change(tmp_path, shared, after):
    found = compared(tmp_path, counted({shared: 1000}), counted({shared: after}))
    assert found.exit_code == 1
    assert f"covers other pixels: {shared.replace('_', ' ')}" in str(build_tables(found))


@pytest.mark.parametrize("after", [{"vertex_shader_invocations": 1001}, {}])
def test_driver_statistics_are_not_gated(tmp_path, after):
    before = counted({"vertex_shader_invocations": 1000, "hits": 9})
    found = compared(tmp_path, before, counted({**after, "hits": 9}))
    assert found.exit_code == 0
    assert "no counter differs" in format_headline(found)
    with pytest.raises(UsageError, match="no better direction"):
        parse_threshold("vertex_shader_invocations=5%")


def test_a_counter_that_is_no_longer_counted_is_a_regression(tmp_path):
    found = compared(tmp_path, counted({"spills": 100, "hits": 9}), counted({"hits": 9}))
    assert found.exit_code == 1
    assert "spills no longer counted" in format_headline(found)


@pytest.fixture
def scenario(request, tmp_path) -> Callable[[str], Any]:
    def call(name: str, settings: Settings):
        with contextlib.chdir(tmp_path):
            SCENARIOS[name].make()
            return compare_runs(read_run(Path("base")), read_run(Path("head")), settings)

    return call


@pytest.mark.parametrize("gates", [("counters",), ("time",), ("counters", "time")])
@pytest.mark.parametrize("name", [name for name in SCENARIOS if name != "no-baseline"])
def test_nothing_is_called_a_regression_that_does_not_fail(scenario, name, gates):
    found = scenario(name, Settings(gates=gates))
    texts = (format_headline(found), to_markdown(found), to_junit(found), to_html(found))
    if found.exit_code != 1:
        # An alarm's words stand for exit code 1 alone; the style sheet has names of its own.
        shown = " ".join(texts).partition("<style>")[0] + " ".join(texts).partition("</style>")[2]
        assert "regressed" not in shown.replace("no time regressed", "")
        assert "<failure" not in shown
    else:
        assert all("egress" in text or "<error" in text or "<failure" in text for text in texts)
    if "time" not in gates:
        timed = any(case.time is not None for case in found.compared())
        assert ("not gated" in to_junit(found)) == timed


def test_a_drift_is_told_and_never_gated(tmp_path):
    """A program that starts between two runs slows the reference draw less than the cases."""
    runs = [
        read_run(write_run(tmp_path / name, seed=seed, edits={"*": slower(share)}))
        for name, seed, share in (("base", 1, 0.0), ("head", 2, 0.55))
    ]
    found = compare_runs(*runs)
    assert found.exit_code == 0
    (drift,) = found.drifts
    assert drift.outcome == "regressed"
    assert not drift.gated
    (group,) = build_tables(found)
    assert group.drift.startswith("all cases together: time 1.5")
    assert "all cases together took +55.0 % time (not gated)" in format_headline(found)
    less = replace(drift, ratio=1.2)
    assert format_headline(replace(found, drifts=(less, drift))) == format_headline(found)
    assert "not gated" in group.drift


def test_all_cases_together_are_gated_where_both_were_timed_in_the_same_rounds(tmp_path):
    base = read_run(write_run(tmp_path / "base", seed=1, noise=0.3))
    edits = {"*": beside(0.02)}
    head = read_run(write_run(tmp_path / "head", seed=1, noise=0.3, edits=edits))
    found = compare_runs(base, head)
    assert {case.time.against for case in found.cases} == {"rounds"}
    assert {case.time.outcome for case in found.cases} == {"regressed"}
    (drift,) = found.drifts
    assert (drift.gated, drift.outcome) == (True, "regressed")
    assert drift.low < 1.02 < drift.high
    assert compare_runs(head, base).exit_code == 0
    assert compare_runs(base, head, COUNTERS).exit_code == 0


def test_a_drift_on_the_threshold_is_let_pass(tmp_path):
    """Growth must exceed the threshold; equal to it is let pass, in times as in counters."""
    base = [record(name, seed=1) for name in TRIANGULATORS]
    head = [record(name, seed=1) for name in TRIANGULATORS]
    for before, after in zip(base, head, strict=True):
        before["time"]["samples_s"] = [1.0] * 30
        after["time"]["samples_s"] = [1.25] * 30
    runs = [make_run(records) for records in (base, head)]
    exact = compare_runs(*runs, Settings(thresholds={"time": 0.25}))
    assert {case.time.ratio for case in exact.cases} == {1.25}
    assert {case.time.outcome for case in exact.cases} == {"unchanged"}
    assert [drift.outcome for drift in exact.drifts] == ["unchanged"]
    assert exact.exit_code == 0
    below = compare_runs(*runs, Settings(thresholds={"time": 0.2499}))
    assert {case.time.outcome for case in below.cases} == {"regressed"}
    assert [drift.outcome for drift in below.drifts] == ["regressed"]
    assert below.exit_code == 1


def test_an_improvement_must_exceed_the_threshold_too():
    bound = math.log1p(0.25)
    assert classify(-bound, -bound, -bound, -bound, 0.25) == ("unchanged", "")
    assert classify(-1.001 * bound, -1.001 * bound, -0.3, -0.2, 0.25) == ("improved", "")


@pytest.mark.parametrize("name", ["now-skipped", "cut-short", "empty-run", "corrupt-line"])
@pytest.mark.parametrize("gates", [("counters",), ("time",)])
def test_doing_less_than_the_plan_is_a_regression(scenario, name, gates):
    found = scenario(name, Settings(gates=gates))
    assert found.exit_code == 1
    assert {case.status for case in found.regressed()} <= {"now-skipped", "not-done"}


def test_a_file_of_records_alone_cannot_hide_what_it_lacks(tmp_path):
    base = read_run(write_run(tmp_path / "base", seed=1))
    head = write_run(tmp_path / "head", seed=2, cut_short=("fan",))
    (head / "run.json").unlink()
    found = compare_runs(base, read_run(head))
    assert [case.id.name for case in found.regressed()] == ["fan"]


def test_another_rasteriser_that_was_cut_off_is_missed(tmp_path):
    """The second rasteriser of the plan left no record, so no record tells its device."""

    def on(rasteriser, device):
        return lambda entry: entry.update(
            key=f"f{entry['key'][1:]}", rasteriser=rasteriser, device=device
        )

    facts = {"plan": plan(rasterisers=["opengl", "theirs"])}
    first = write_run(tmp_path / "base", seed=1, facts=facts)
    second = write_run(tmp_path / "more", seed=1, edits={"*": on("theirs", "asic")})
    text = (second / "cases.jsonl").read_text()
    with (first / "cases.jsonl").open("a") as stream:
        stream.write(text)
    head = write_run(tmp_path / "head", seed=2, facts=facts)
    found = compare_runs(read_run(first), read_run(head))
    assert {case.id.rasteriser for case in found.regressed()} == {"theirs"}
    facts = {"plan": plan(rasterisers=["opengl"])}
    narrower = write_run(tmp_path / "narrower", seed=2, facts=facts)
    assert compare_runs(read_run(first), read_run(narrower)).exit_code == 0


def test_hundreds_of_thousands_of_samples_are_no_trouble(tmp_path):
    """A draw that takes no time is drawn that often; each case's samples once cost gigabytes."""
    rng = np.random.default_rng(1)

    def many(entry):
        timing = entry["time"]
        for name in ("samples_s", "reference_s", "empty_s"):
            timing[name] = (1e-6 * (1 + np.abs(rng.normal(0, 0.05, 200_000)))).tolist()

    runs = [make_run(map(usual(many), TRIANGULATORS)) for _ in ("base", "head")]
    found = compare_runs(*runs)
    assert {case.time.outcome for case in found.cases} == {"unchanged"}
    assert to_json(found)["exit_code"] == 0


def usual(edit: Edit) -> Callable[[str], dict[str, Any]]:
    def make(name: str) -> dict[str, Any]:
        entry = record(name, seed=1)
        edit(entry)
        return entry

    return make


def test_a_case_says_where_it_is(tmp_path):
    case = make_record(**record("fan", seed=1) | {"rotation": 22.5, "fit": "circle"}).id
    assert str(case.group) == "city 1024 px, turned 22.5°, fit to a circle, opengl on llvmpipe"


def test_a_scene_that_the_records_name_is_that_of_the_plan(tmp_path):
    """As of a run of a file that was moved: its plan has another path, its records the name."""
    base = read_run(write_run(tmp_path / "base", seed=1))
    moved = {"plan": plan(scene="elsewhere")}
    head = read_run(write_run(tmp_path / "head", seed=2, cut_short=("fan",), facts=moved))
    assert [case.id.name for case in compare_runs(base, head).regressed()] == ["fan"]


def test_only_what_both_runs_measured_repeats():
    done = record("fan", seed=1)
    failed = done | {"status": "failed", "counters": {}}
    good, bad = make_record(**done), make_record(**failed)
    assert compare_repeated([good], [good])[0] == 1
    assert compare_repeated([good], [bad])[0] == compare_repeated([bad], [good])[0] == 0


def test_verdicts_that_repeat_are_counted_pair_by_pair():
    def run(**draws):
        found = [base(), *(made(name, how) for name, how in draws.items())]
        return [
            make_record(**each | {"predicted": dict.fromkeys(IDENTIFYING, float(number))})
            for number, each in enumerate(found)
        ]

    first = run(delaunay="faster", greedy="slower")
    place = ("opengl", "llvmpipe")
    assert compare_repeated(first, first)[1:] == ([], {place: (3, 3, 3, 3)})
    # greedy is level with ear clipping now: that pair is decided no more, the others are alike
    assert compare_repeated(first, run(delaunay="faster", greedy="level"))[2] == {
        place: (3, 2, 2, 2)
    }
    assert compare_repeated(first, run(delaunay="slower", greedy="slower"))[2][place][:2] == (3, 1)


def test_thresholds_are_told_each_once(tmp_path):
    runs = [read_run(write_run(tmp_path / name, seed=1)) for name in ("base", "head")]
    text = to_markdown(compare_runs(*runs, Settings(thresholds={"time": 0.07, "quads": 0.02})))
    assert "threshold of quads: 2 %" in text
    assert "threshold of time ±7 %" in text
    assert "threshold of time:" not in text


@pytest.mark.parametrize(
    "narrower",
    [
        {"views": [{"resolution": 512, "rotation": 0.0, "fit": "box"}]},
        {"options": [{"samples": 4, "work": 0, "order": "native", "seed": 0}]},
        {"devices": ["zink"]},
    ],
)
def test_what_the_plan_did_not_ask_for_is_not_missed(tmp_path, narrower):
    base = read_run(write_run(tmp_path / "base", seed=1))
    facts = {"plan": plan(**narrower)}
    head = read_run(write_run(tmp_path / "head", seed=2, cut_short=("fan",), facts=facts))
    found = compare_runs(base, head, Settings(across_devices=True))
    on_a_device = "devices" in narrower  # whose records are there all the same
    assert [case.id.name for case in found.regressed()] == ["fan"] * on_a_device


def test_one_case_on_another_device_makes_it_another_machine():
    here, there = make_record(device="llvmpipe"), make_record(device="zink")
    name = here.id
    assert _has_other_device([Match(name, here, here), Match(name, here, there)])
    assert not _has_other_device([Match(name, here, here), Match(name, None, there)])


def test_what_head_lacks_fails_only_where_all_are_asked_for():
    name = make_record("fan").id
    for asked, found in ((True, [True, False]), (False, [False, False])):
        comparison = no_baseline("base", Run(Path("head"), {}, []), Settings(require_all=asked))
        cases = (CaseChange(name, "only-base"), CaseChange(name, "only-head"))
        assert [comparison.is_regressed(case) for case in cases] == found


def test_a_driver_may_have_another_version_and_a_device_no_other_name():
    names = ("NVIDIA H100 (535.1)", "NVIDIA H100 (550.2)", "NVIDIA H200 (550.2)")
    runs = [
        Run(Path("run"), {"devices": {"opengl on gpu0": {"details": {"renderer": name}}}}, [])
        for name in names
    ]
    assert find_changed_hardware(runs[0], runs[1]) == {}
    assert find_changed_hardware(*runs[1:]) == {"opengl on gpu0": names[1:]}
