"""Changes that make the gate fail, and changes that must not."""

import contextlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.compare.comparison import compare_runs
from harness.compare.matching import find_changed_hardware
from harness.compare.model import Settings, parse_threshold
from harness.compare.outputs import to_html, to_json, to_junit, to_markdown
from harness.compare.wording import build_tables, format_headline
from harness.errors import IncompatibleRunsError, UsageError
from harness.metrics.groups import IDENTIFYING_CRITERIA
from harness.rasterisers.reference import Binning
from harness.results.run_folder import read_run
from scripts.repeated_runs import compare_repeated
from tests.compare.runs import (
    SCENARIOS,
    TRIANGULATORS,
    Edit,
    add_cost,
    add_time,
    make_case,
    make_cases,
    make_plan,
    pair_rounds,
    read_pair,
    write_pair,
)
from tests.metrics.test_decision import base, make_fields
from tests.records import make_record, make_run

COUNTERS = Settings(gates=("counters",))


def set_counters(counters: dict[str, int]) -> Edit:
    def edit(entry: dict[str, Any]) -> None:
        entry |= {"counters": dict(counters), "rasteriser": "theirs", "device": "asic"}
        entry.pop("time", None)

    return edit


def compare(base: Edit, head: Edit, settings: Settings = COUNTERS):
    plan = make_plan(rasterisers=["theirs"])
    edits = {1: {"*": base}, 2: {"*": head}}
    runs = (make_run(make_cases(seed, edits[seed]), plan=plan) for seed in edits)
    return compare_runs(*runs, settings)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("scene", "cad"), ("triangulator", "fan"), ("rasteriser", "webgpu"), ("device", "zink")),
        *(("resolution", 512), ("rotation", 30.0), ("fit", "circle"), ("options", {"samples": 4})),
        ("options", {"texture": 1}),
    ],
)
def test_fields_of_the_identity_distinguish_cases(field, value):
    case = make_case("delaunay", seed=1)
    recounted = make_record(**case | {"polygons": 3})
    assert make_record(**case | {field: value}).id != make_record(**case).id == recounted.id


def test_counters_of_the_binner_and_of_the_order_are_gated():
    names = (*Binning.counters, "vertex_batches", "transformed_vertices")
    before = {name: 1000 + number for number, name in enumerate(names)}
    for name in before:
        after = before | {name: round(before[name] * 1.5)}
        comparison = compare(set_counters(before), set_counters(after))
        assert comparison.exit_code == 1
        assert f"{name.replace('_', ' ')} {before[name]:,} → " in format_headline(comparison)
        assert all(case.list_regressed_counters()[0].metric == name for case in comparison.cases)


@pytest.mark.parametrize(("share", "worst"), [(0.2, "fan"), (2.0, "delaunay")])
def test_headline_names_the_largest_growth_of_counters_or_times(tmp_path, share, worst):
    """One case has 1.4 times more helper lanes; another, without counters, takes longer."""

    def uncounted(entry: dict[str, Any]) -> None:
        entry["counters"] = {}

    def slow(entry: dict[str, Any]) -> None:
        uncounted(entry)
        add_time(share)(entry)

    edits = {"delaunay": slow, "fan": add_cost(0.5)}
    runs = read_pair(tmp_path, {"edits": {"delaunay": uncounted}}, edits=edits)
    comparison = compare_runs(*runs, Settings(gates=("counters", "time")))
    assert {case.id.name for case in comparison.list_regressed_cases()} == {"delaunay", "fan"}
    assert format_headline(comparison).startswith(f"Regression: {worst}, city")


def test_regressed_counters_have_the_first_columns():
    before = {"quads": 100, "spills": 100, "stalls": 100}
    after = before | {"spills": 150, "stalls": 150}
    (group,) = build_tables(compare(set_counters(before), set_counters(after)))
    assert group.heading[1:4] == ("spills", "stalls", "quads")


@pytest.mark.parametrize("name", ["spills", "overdraw", "draw_ms", "half_perimeter"])
def test_unregistered_counters_are_gated(name):
    comparison = compare(set_counters({name: 100}), set_counters({name: 101}))
    assert comparison.exit_code == 1
    assert "+1.0 %" in format_headline(comparison)
    assert "101 (+1.0 %)" in str(build_tables(comparison)[0].rows[0].cells)
    back = compare(set_counters({name: 101}), set_counters({name: 100}))
    assert back.exit_code == 0
    assert "5 improved" in format_headline(back)


def test_a_threshold_may_name_any_counter_of_the_runs():
    loose = Settings(gates=("counters",), thresholds={"spills": 0.02})
    comparison = compare(set_counters({"spills": 100}), set_counters({"spills": 101}), loose)
    assert comparison.exit_code == 0


@pytest.mark.parametrize("shared", ["fragments", "hits", "samples_passed"])
@pytest.mark.parametrize("after", [999, 1001])
def test_shared_counters_are_gated_in_both_directions(shared, after):
    comparison = compare(set_counters({shared: 1000}), set_counters({shared: after}))
    assert comparison.exit_code == 1
    assert f"covers other pixels: {shared.replace('_', ' ')}" in str(build_tables(comparison))


@pytest.mark.parametrize("after", [{"vertex_shader_invocations": 1001}, {}])
def test_driver_statistics_are_not_gated(after):
    before = set_counters({"vertex_shader_invocations": 1000, "hits": 9})
    comparison = compare(before, set_counters({**after, "hits": 9}))
    assert comparison.exit_code == 0
    assert "no counter differs" in format_headline(comparison)
    with pytest.raises(UsageError, match="no change of vertex_shader_invocations is better"):
        parse_threshold("vertex_shader_invocations=5%")


def test_missing_counter_is_a_regression():
    before = set_counters({"spills": 100, "hits": 9})
    comparison = compare(before, set_counters({"hits": 9}))
    assert comparison.exit_code == 1
    assert "spills no longer counted" in format_headline(comparison)


@pytest.mark.parametrize("gates", [("counters",), ("time",), ("counters", "time")])
@pytest.mark.parametrize("name", [name for name in SCENARIOS if name != "no-baseline"])
def test_regression_is_reported_only_with_exit_code_1(tmp_path, name, gates):
    with contextlib.chdir(tmp_path):
        SCENARIOS[name].make()
        runs = read_run(Path("base")), read_run(Path("head"))
    comparison = compare_runs(*runs, Settings(gates=gates))
    if name in ("now-skipped", "cut-short", "empty-run", "corrupt-line"):
        assert comparison.exit_code == 1
    texts = [write(comparison) for write in (format_headline, to_markdown, to_junit, to_html)]
    if comparison.exit_code != 1:
        # Words of an alarm require exit code 1; the style sheet may have such names.
        text = " ".join(texts).partition("<style>")[0] + " ".join(texts).partition("</style>")[2]
        assert "regressed" not in text.replace("no time regressed", "")
        assert "<failure" not in text
    else:
        assert all("egress" in text or "<error" in text or "<failure" in text for text in texts)
    if "time" not in gates:
        timed = any(case.time is not None for case in comparison.list_compared())
        assert ("not gated" in to_junit(comparison)) == timed


def test_largest_drift_of_separate_runs_is_reported_and_not_gated():
    """A program that starts between two runs slows the reference draw less than the cases."""
    runs = make_run(make_cases(1)), make_run(make_cases(2, {"*": add_time(0.55)}))
    comparison = compare_runs(*runs)
    (drift,) = comparison.drifts
    assert (comparison.exit_code, drift.outcome, drift.gated) == (0, "regressed", False)
    less = replace(drift, ratio=1.2)
    assert format_headline(replace(comparison, drifts=(less, drift))) == format_headline(comparison)


def test_drift_in_common_rounds_is_gated(tmp_path):
    edits = {"*": pair_rounds(0.02)}
    base, head = read_pair(tmp_path, {"noise": 0.3}, seed=1, noise=0.3, edits=edits)
    comparison = compare_runs(base, head)
    assert {case.time.against for case in comparison.cases} == {"rounds"}
    assert {case.time.outcome for case in comparison.cases} == {"regressed"}
    (drift,) = comparison.drifts
    assert (drift.gated, drift.outcome) == (True, "regressed")
    assert drift.low < 1.02 < drift.high
    assert compare_runs(head, base).exit_code == 0
    assert compare_runs(base, head, COUNTERS).exit_code == 0


def test_drift_equal_to_the_threshold_is_tolerated():
    runs = []
    for sample_s in (1.0, 1.25):
        cases = make_cases(1)
        for case in cases:
            case["time"]["samples_s"] = [sample_s] * 30
        runs.append(make_run(cases))
    exact = compare_runs(*runs, Settings(thresholds={"time": 0.25}))
    assert {case.time.ratio for case in exact.cases} == {1.25}
    assert {case.time.outcome for case in exact.cases} == {"unchanged"}
    assert [drift.outcome for drift in exact.drifts] == ["unchanged"]
    assert exact.exit_code == 0


@pytest.mark.parametrize("plan", [None, make_plan(scene="elsewhere")], ids=["none", "moved file"])
def test_missing_case_without_a_matching_plan_is_a_regression(tmp_path, plan):
    """The plan of a run of a moved file has another path, and the records have the name."""
    base, head = write_pair(folder=tmp_path, cut_short=("fan",), facts={"plan": plan})
    if plan is None:
        (head / "run.json").unlink()
    comparison = compare_runs(read_run(base), read_run(head))
    assert [case.id.name for case in comparison.list_regressed_cases()] == ["fan"]


def test_planned_rasteriser_without_records_is_a_regression():
    """The second rasteriser of the plan has no record, so its device is unknown."""

    facts = {"plan": make_plan(rasterisers=["opengl", "theirs"])}
    cases = make_cases(1)
    asic = {"rasteriser": "theirs", "device": "asic"}
    theirs = [{**case, "key": f"f{case['key'][1:]}", **asic} for case in cases]
    base, head = make_run([*cases, *theirs], **facts), make_run(cases, **facts)
    comparison = compare_runs(base, head)
    assert {case.id.rasteriser for case in comparison.list_regressed_cases()} == {"theirs"}
    narrower = make_run(cases, plan=make_plan(rasterisers=["opengl"]))
    assert compare_runs(base, narrower).exit_code == 0


def test_200000_samples_are_compared():
    """Very short draws have 200,000 samples; comparing all pairs would take gigabytes."""
    rng, runs = np.random.default_rng(1), []
    for _ in ("base", "head"):
        cases = make_cases(1)
        for case in cases:
            for name in ("samples_s", "reference_s", "empty_s"):
                samples = 1e-6 * (1 + np.abs(rng.normal(0, 0.05, 200_000)))
                case["time"][name] = samples.tolist()
        runs.append(make_run(cases))
    comparison = compare_runs(*runs)
    assert {case.time.outcome for case in comparison.cases} == {"unchanged"}
    assert to_json(comparison)["exit_code"] == 0


def test_only_cases_measured_in_both_runs_are_repeated():
    done = make_case("fan", seed=1)
    failed = done | {"status": "failed", "counters": {}}
    good, bad = make_record(**done), make_record(**failed)
    assert compare_repeated([good], [good])[0] == 1
    assert compare_repeated([good], [bad])[0] == compare_repeated([bad], [good])[0] == 0


def test_repeated_verdicts_are_counted_per_pair():
    def run(**draws):
        records = [base(), *(make_fields(name, verdict) for name, verdict in draws.items())]
        return [
            make_record(**record, predicted=dict.fromkeys(IDENTIFYING_CRITERIA, float(number)))
            for number, record in enumerate(records)
        ]

    first = run(delaunay="faster", greedy="slower")
    key = ("opengl", "llvmpipe")
    assert compare_repeated(first, first)[1:] == ([], {key: (3, 3, 3, 3)})
    # greedy is now equal to ear clipping: this pair is undecided, the other pairs are unchanged
    assert compare_repeated(first, run(delaunay="faster", greedy="level"))[2] == {key: (3, 2, 2, 2)}
    slower = run(delaunay="slower", greedy="slower")
    assert compare_repeated(first, slower)[2] == {key: (3, 1, 2, 1)}
    miscounted = [replace(first[0], counters={"quads": 6}), *first[1:]]
    assert compare_repeated(first, miscounted)[:2] == (3, [first[0].key])


def test_thresholds_are_printed_once(tmp_path):
    settings = Settings(thresholds={"time": 0.07, "quads": 0.02})
    text = to_markdown(compare_runs(*read_pair(tmp_path, seed=1), settings))
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
def test_case_outside_the_plan_is_not_a_regression(tmp_path, narrower):
    runs = read_pair(tmp_path, cut_short=("fan",), facts={"plan": make_plan(**narrower)})
    comparison = compare_runs(*runs, Settings(across_devices=True))
    on_a_device = "devices" in narrower  # the other records are in HEAD
    assert [case.id.name for case in comparison.list_regressed_cases()] == ["fan"] * on_a_device


def test_driver_version_may_change_and_device_may_not():
    names = ("Intel(R) UHD (535.1)", "Intel(R) UHD (550.2)", "Intel(R) Iris(R) (550.2)")
    details = ({"details": {"renderer": name}} for name in names)
    runs = [make_run([], devices={"opengl on gpu0": facts}) for facts in details]
    assert find_changed_hardware(runs[0], runs[1]) == {}
    assert find_changed_hardware(*runs[1:]) == {"opengl on gpu0": names[1:]}


def test_devices_of_every_rasteriser_are_compared(tmp_path):
    """The runs share the device of opengl; those of webgpu differ, so its cases have no pair."""

    def on(device: str) -> dict[str, Edit]:
        return {"fan": lambda record: record.update(rasteriser="webgpu", device=device)}

    runs = read_pair(tmp_path, {"edits": on("lavapipe")}, edits=on("swiftshader"))
    with pytest.raises(IncompatibleRunsError, match=r"webgpu: BASE ran on lavapipe and HEAD on sw"):
        compare_runs(*runs, Settings())
    comparison = compare_runs(*runs, Settings(across_devices=True))
    assert comparison.machines_differ  # although only one case ran on another device
    assert len(comparison.cases) == len(TRIANGULATORS)
