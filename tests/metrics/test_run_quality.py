"""The state of a run, and intervals on disturbed machines."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from harness.measuring.records import get_default_path
from harness.metrics.decision import decide_group, format_advice
from harness.metrics.groups import group_run
from harness.metrics.run_quality import (
    DISTURBED,
    MAX_REFERENCE_RATIO,
    MIN_QUIET_ROUNDS,
    QUIET,
    UNTRUSTED,
    assess_records,
    explain_incomparable,
    find_two_modes,
    find_undisturbed,
    get_run_state,
    select_rounds,
)
from scripts.studies import machines
from scripts.studies.machines import ROUNDS, simulate_run
from tests.measuring.test_run import make_plan, measure
from tests.records import make_group, make_run, make_time


@pytest.mark.parametrize("name", ["quiet", "time_slices", "two_speeds"])
def test_best_of_equal_triangulators_is_rarely_significant(name):
    """Of runs with seven equal triangulators, at most 5 % recommend one as faster."""
    rng, machine = np.random.default_rng(3), getattr(machines, name)
    runs = (make_group(simulate_run(rng, machine, (1.0,) * 7)) for _ in range(150))
    false_positives = sum(decide_group(run).reason == "faster" for run in runs)
    assert false_positives / 150 <= 0.05


def test_disturbed_samples_are_excluded_if_enough_remain():
    waited_s = [0.0] * MIN_QUIET_ROUNDS + [0.021] * (20 - MIN_QUIET_ROUNDS)
    time = make_time(samples_s=[1.0] * 20, waited_s=waited_s)
    assert find_undisturbed(time).sum() == MIN_QUIET_ROUNDS
    for waited, rounds in (
        ([0.02] * 20, MIN_QUIET_ROUNDS),
        ([0.02] * 19 + [0.0], MIN_QUIET_ROUNDS),
        ([0.5] + [0.0] * 19, 20),
    ):
        assert select_rounds(time, make_time(samples_s=[1.0] * 20, waited_s=waited)).sum() == rounds
    unknown = make_time(samples_s=[1.0, 2.0])
    assert find_undisturbed(unknown).all()
    with pytest.raises(ValueError, match="not rounds of one group"):
        select_rounds(time, unknown)


def test_threads_that_wait_for_each_other_are_not_disturbed():
    """Threads of Vulkan on the CPU wait for each other without a longer wall clock."""
    rng = np.random.default_rng(11)
    cpu = 1e-3 * np.exp(0.01 * rng.standard_normal(40))
    time = make_time(samples_s=cpu.tolist(), waited_s=(0.95 * cpu).tolist())
    late = np.where(np.arange(40) < 10, 0.5 * cpu, 0.0)  # by another program
    assert not find_undisturbed(time).any()
    assert find_undisturbed(replace(time, wall_s=tuple(1.001 * cpu))).all()
    for usual in (0.5, 1.001):  # parallel and sequential threads
        quiet_samples = find_undisturbed(replace(time, wall_s=tuple(usual * cpu + late)))
        assert quiet_samples.tolist() == (late == 0).tolist()
    assert not find_undisturbed(replace(time, wall_s=tuple(1.5 * cpu))).any()


def test_few_drawings_with_two_modes_do_not_disturb_a_run():
    rng = np.random.default_rng(12)
    kinds = (machines.two_speeds, machines.quiet)
    one, another = (simulate_run(rng, machine, (1.0,))[0] for machine in kinds)
    many = [another.with_id(triangulator=str(number)) for number in range(11)]
    assert assess_records([one, *many[:8]]).state == DISTURBED
    assert assess_records([one, *many]).state == QUIET
    samples = one.time.samples_s
    half = len(samples) // 2
    of_two = with_time(one, processes=(half, len(samples) - half))
    warnings = str(assess_records([of_two]).warnings)
    low, high = re.search(r"\((\S+) and (\S+) ms\)", warnings).groups()
    modes = 1e-3 * float(low), 1e-3 * float(high)
    assert modes == pytest.approx(find_two_modes(samples), rel=0.2)


def with_time(record, **fields):
    return replace(record, time=replace(record.time, **fields))


def test_two_modes_are_distinguished_from_one():
    rng = np.random.default_rng(1)
    for samples in (
        np.exp(0.02 * rng.standard_normal(200)),
        rng.uniform(1, 2, 200),
        1 + rng.exponential(0.2, 200),
        np.r_[np.ones(190), 5 * np.ones(10)],  # a few slow samples
        np.linspace(1.0, 1.3, 60),  # a drift
    ):
        assert find_two_modes(samples) is None
    modes = find_two_modes(np.r_[rng.normal(1, 0.02, 40), rng.normal(2, 0.04, 10)])
    assert modes == pytest.approx((1, 2), rel=0.02)
    assert find_two_modes([1.0] * 9 + [2.0] * 3) == pytest.approx((1, 2))
    assert find_two_modes([1.0] * 8 + [2.0] * 3) is None
    # The distance is at least five standard deviations.
    for scatter, has_two in ((0.03, True), (0.09, False)):
        noise = np.exp(scatter * rng.standard_normal(400))
        assert (find_two_modes(noise * np.repeat([1.0, 1.3], 200)) is not None) == has_two


def test_state_follows_one_rule():
    rng = np.random.default_rng(2)
    assert assess_records(simulate_run(rng, machines.quiet, (1.0, 0.9))).state == QUIET
    sliced_run = assess_records(simulate_run(rng, machines.time_slices, (1.0, 0.9)))
    assert sliced_run.state == DISTURBED
    assert "samples waited for a core" in sliced_run.warnings[0]
    for others_s, state in ((0.05, QUIET), (0.5, DISTURBED)):
        drawings = simulate_run(rng, machines.time_slices, (1.0, 0.9))
        records = [with_time(r, timing_s=1.0, others_s=others_s) for r in drawings]
        assert assess_records(records).state == state
    two = assess_records(simulate_run(rng, machines.two_speeds, (1.0, 0.9)))
    assert two.state == DISTURBED
    assert "two modes" in two.warnings[0]
    record = simulate_run(rng, machines.two_speeds, (1.0,))[0]
    assert assess_records([with_time(record, timer="wall")]).state == UNTRUSTED
    for free, state in ((0, UNTRUSTED), (MIN_QUIET_ROUNDS, DISTURBED)):
        waited = (0.0,) * free + (1.0,) * (ROUNDS - free)
        assert assess_records([with_time(record, waited_s=waited)]).state == state
    draw = {"rasteriser": "opengl", "device": "llvmpipe", "resolution": 64, "reference_s": 1e-3}
    assert assess_records([], [{**draw, "slower": 1.2}]).state == QUIET
    assert assess_records([], [{**draw, "slower": 1.6}]).state == DISTURBED
    stolen = with_time(simulate_run(rng, machines.quiet, (1.0,))[0], stolen_s=1.0, timing_s=10.0)
    assert assess_records([stolen]).state == DISTURBED


@pytest.mark.parametrize("levels", [(1.0, 1.5), (1.0, 1.5, 1.5, 1.0)])
def test_levels_of_processes_are_not_modes(levels):
    rounds = ROUNDS // len(levels)
    rng = np.random.default_rng(8)
    record = simulate_run(rng, machines.quiet, (1.0,))[0]
    samples = tuple(np.array(record.time.samples_s) * np.repeat(levels, rounds))
    record = with_time(record, samples_s=samples)
    assert assess_records([record]).state == DISTURBED
    assert assess_records([with_time(record, processes=(rounds,) * len(levels))]).state == QUIET


def test_stored_state_is_used():
    stored = make_run([], state={"state": DISTURBED, "why": ["a neighbour"], "draws": []})
    warning = get_run_state(stored).warnings[0]
    assert warning.startswith("the run's times are disturbed: a neighbour")
    for damaged in ({}, {"state": "x"}, {"state": {"state": 3}}, {"state": []}):
        assert get_run_state(make_run([], **damaged)).state == QUIET


def test_state_that_is_not_stored_is_computed_from_the_samples():
    record = simulate_run(np.random.default_rng(8), machines.quiet, (1.0,))[0]
    samples = tuple(np.array(record.time.samples_s) * np.repeat((1.0, 1.5), ROUNDS // 2))
    (group,) = group_run(make_run([with_time(record, samples_s=samples)]))
    assert group.state == DISTURBED


def test_counters_decide_in_a_disturbed_run():
    rng = np.random.default_rng(4)
    records = simulate_run(rng, machines.quiet, (1.0, 0.6, 0.8))
    records[2] = replace(records[2], counters={"quads": 50})
    assert decide_group(make_group(records)).choice.name == "rival 1"
    decision = decide_group(make_group(records, state=DISTURBED))
    assert (decision.reason, decision.choice.name) == ("counter", "rival 2")
    names = [standing.name for standing in decision.standings]
    assert names == ["rival 2", "ear-clipping", "rival 1"]
    sentence = format_advice(decision)
    assert "times are disturbed and not used" in sentence
    assert "measure again" in sentence
    equal = [replace(record, counters={"quads": 9}) for record in records]
    decision = decide_group(make_group(equal, state=DISTURBED))
    assert decision.reason == "undecided"
    assert "times are disturbed and not used" in format_advice(decision)


def test_runs_in_different_states_are_not_compared():
    rng = np.random.default_rng(6)
    base, head = (simulate_run(rng, machines.quiet, (1.0,))[0].time for _ in range(2))
    assert explain_incomparable(base, head, machines_differ=False) == ""
    slower = replace(head, reference_s=(1.4,) * ROUNDS)
    assert "two states" in explain_incomparable(base, slower, machines_differ=False)
    assert "--beside" in explain_incomparable(slower, base, machines_differ=False)
    assert explain_incomparable(base, slower, machines_differ=True) == ""
    steps = (1.0, MAX_REFERENCE_RATIO)
    first, last = (replace(head, reference_s=(step,) * ROUNDS) for step in steps)
    assert explain_incomparable(first, last, machines_differ=False) == ""
    waiting = replace(head, waited_s=(1.0,) * ROUNDS)
    reason = explain_incomparable(base, waiting, machines_differ=True)
    assert reason.startswith("HEAD was disturbed (72 of 72 samples waited")


def test_run_stores_its_reference_draws(block, tmp_path):
    measure(make_plan(block), tmp_path / "out")
    facts = json.loads((tmp_path / "out" / "run.json").read_text())
    (entry,) = facts["state"]["draws"]
    assert entry["device"] == "scripted"
    assert 0 < entry["best_s"] <= entry["reference_s"]
    assert math.isclose(entry["slower"], entry["reference_s"] / entry["best_s"])
    assert facts["cpu"]["label"]
    assert get_default_path().exists()
