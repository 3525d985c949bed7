"""Verdicts on times, tested with simulated times whose true change is known."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.stats import t as student

from harness.compare.comparison import correct_q_values
from harness.compare.matching import Pair, read_pair
from harness.compare.model import Settings, TimeChange
from harness.compare.times import (
    MAX_ROUNDS_Q,
    classify_change,
    compare_group,
    estimate_peer_shift,
    measure_round_drift,
)
from tests.records import make_record

SETTINGS = Settings()


def pairs(
    rng,
    growths,
    *,
    noise=0.01,
    rounds=30,
    drift=1.0,
    reference_drift=None,
    same_work=True,
    scatter=0.0,
) -> list[Pair]:
    """Return cases that grew by `growths` on a machine that changed its speed by `drift`.

    scatter : standard deviation of a case's log time between processes
    """

    def times(seconds: float, scatter: float = 0.0):
        # Other programs lengthen a sample, nothing shortens it.
        level = seconds * math.exp(rng.normal(0, scatter)) if scatter else seconds
        return level * (1 + np.abs(rng.normal(0, noise, rounds)))

    reference = times(1e-3), times(1e-3 * (drift if reference_drift is None else reference_drift))
    return [
        Pair(times(3e-3, scatter), times(head_s, scatter), reference, same_work, polygons=500)
        for head_s in (3e-3 * drift * (1 + growth) for growth in growths)
    ]


def compare(cases, settings=SETTINGS, machines_differ=False):
    changes, drift = compare_group("here", cases, settings, machines_differ=machines_differ)
    return correct_q_values(changes, settings), drift


@pytest.mark.parametrize("drift", [0.8, 1.0, 1.25])
@pytest.mark.parametrize(("growth", "outcome"), [(0.1, "regressed"), (-0.1, "improved")])
def test_one_changed_case_is_detected_at_any_machine_drift(drift, growth, outcome):
    changes, together = compare(pairs(np.random.default_rng(1), [0, 0, growth, 0, 0], drift=drift))
    assert [c.outcome for c in changes] == [*["unchanged"] * 2, outcome, *["unchanged"] * 2]
    assert changes[2].low < 1 + growth < changes[2].high
    assert together.outcome != "regressed"


@pytest.mark.parametrize("noise", [0.005, 0.02, 0.1, 0.5])
def test_equal_runs_rarely_regress(noise):
    rng, outcomes = np.random.default_rng(3), Counter()
    for _ in range(20):
        drift = math.exp(rng.normal(0, 0.05))
        changes, together = compare(pairs(rng, rng.normal(0, 0.005, 5), noise=noise, drift=drift))
        outcomes.update(change.outcome for change in changes)
        outcomes[f"together {together.outcome}"] += 1
    assert outcomes["regressed"] + outcomes["together regressed"] <= 1
    if noise >= 0.5:
        assert outcomes["inconclusive"] >= 95
    if noise <= 0.02:
        assert outcomes["unchanged"] >= 95


def test_drift_regresses_only_beyond_the_reference_draw():
    rng = np.random.default_rng(5)
    _, machine = compare(pairs(rng, [0] * 5, drift=1.15))
    assert machine.outcome == "inconclusive"
    changes, code = compare(pairs(rng, [0] * 5, drift=1.15, reference_drift=1.0))
    assert code.outcome == "regressed"
    assert {change.outcome for change in changes} == {"unchanged"}
    _, elsewhere = compare(pairs(rng, [0] * 5, drift=3, reference_drift=2), machines_differ=True)
    assert elsewhere.outcome == "inconclusive"


def test_unchanged_cases_stay_unchanged_when_most_cases_slow_down():
    """Only cases with equal counters are peers, so slower drawings do not hide as drift."""
    rng = np.random.default_rng(6)
    dear = pairs(rng, [0.2, 0.2, 0.2], same_work=False)
    changes, _ = compare([*dear, *pairs(rng, [0, 0, 0])])
    assert [c.outcome for c in changes] == ["regressed"] * 3 + ["unchanged"] * 3


@pytest.mark.parametrize("machines_differ", [False, True])
def test_single_case_is_compared_with_the_reference_draw(machines_differ):
    rng = np.random.default_rng(7)
    (change,), drift = compare(pairs(rng, [0.15]), machines_differ=machines_differ)
    assert change.outcome == "regressed"
    assert change.against == "reference"
    assert not drift.gated
    (same,), _ = compare(pairs(rng, [0], drift=1.3), machines_differ=machines_differ)
    # On one machine the reference draw may show only a part of the drift.
    assert same.outcome == ("unchanged" if machines_differ else "inconclusive")


def test_single_case_without_reference_draw_on_another_machine_is_inconclusive():
    (pair,) = pairs(np.random.default_rng(8), [0])
    (change,), _ = compare([Pair(pair.base, pair.head, None, True)], machines_differ=True)
    assert change.outcome == "inconclusive"
    assert "reference" in change.reason


def test_q_values_are_corrected_for_many_cases():
    """With a hundred equal cases, chance differences beyond a threshold of 0 stay inconclusive."""
    rng = np.random.default_rng(9)
    settings = Settings(thresholds={"time": 0.0})
    changes, _ = compare(pairs(rng, [0] * 100, noise=0.05), settings)
    assert sum(change.outcome == "regressed" for change in changes) <= 1
    assert all(change.q_value >= change.p_value - 1e-12 for change in changes)


@pytest.mark.parametrize(
    ("against", "q_value", "outcome"),
    [
        *(("rounds", 0.01, "inconclusive"), ("rounds", 0.0005, "regressed")),
        *(("peers", 0.01, "regressed"), ("peers", 0.06, "inconclusive")),
        *(("rounds", MAX_ROUNDS_Q, "regressed"), ("reference", 0.01, "regressed")),
        ("peers", 1 - SETTINGS.confidence, "regressed"),
    ],
)
def test_rounds_need_a_smaller_q_value_than_peers(against, q_value, outcome):
    change = TimeChange("regressed", "", against=against, p_value=q_value, q_value=q_value)
    (settled,) = correct_q_values([change], SETTINGS)
    assert settled.outcome == outcome
    assert ("not significant" in settled.reason) == (outcome == "inconclusive")


def test_difference_between_processes_is_inconclusive():
    """60 rounds of two processes that differ by 3 % are significant, two processes are not."""
    level = np.repeat([0.0, 0.03], 30)
    rng = np.random.default_rng(11)
    base = np.exp(0.001 * rng.standard_normal(60))
    times = {"timer": "wall", "reference_s": [1e-3] * 60, "epochs": [5] * 12, "processes": [30, 30]}
    samples = (base.tolist(), (base * np.exp(level)).tolist())
    records = [make_record(time={**times, "samples_s": samples_s}) for samples_s in samples]
    pair = read_pair(*records, same_work=True)
    changes, drift = compare([pair, pair])
    change = changes[0]
    assert (change.outcome, drift.outcome) == ("inconclusive", "inconclusive")
    assert change.low < 1 < change.high
    one_process = replace(records[1], time=replace(records[1].time, processes=()))
    single = read_pair(records[0], one_process, same_work=True)
    (change,), _ = compare([single])
    assert change.low > 1


@pytest.mark.parametrize(("rounds", "outcome"), [(9, "inconclusive"), (12, "regressed")])
def test_drift_of_few_rounds_is_inconclusive(rounds, outcome):
    """Nine slower rounds in a row happen by chance once in 256 times, twelve once in 2048."""
    rng = np.random.default_rng(10)
    base = np.exp(0.001 * rng.standard_normal((3, rounds)))
    drift = measure_round_drift("here", [(samples, samples * 1.1) for samples in base], SETTINGS)
    assert drift.outcome == outcome
    assert drift.reason == ("too few rounds" if outcome == "inconclusive" else "")


@given(
    lowest=st.floats(-1, 1),
    spread=st.floats(0, 0.5),
    below=st.floats(0, 1),
    above=st.floats(0, 1),
    threshold=st.floats(0, 0.5),
)
@example(lowest=math.log1p(0.25), spread=0, below=0, above=0, threshold=0.25)  # exactly equal
def test_outcome_follows_threshold_and_interval(lowest, spread, below, above, threshold):
    highest = lowest + spread
    low, high = lowest - below, highest + above
    bound = math.log1p(threshold)
    outcome, reason = classify_change(lowest, highest, low, high, threshold)
    mirrored, _ = classify_change(-highest, -lowest, -high, -low, threshold)
    swap = {"regressed": "improved", "improved": "regressed"}
    assert mirrored == swap.get(outcome, outcome)
    assert bool(reason) == (outcome == "inconclusive")
    if outcome == "regressed":
        assert low > 0
        assert lowest > bound
    if outcome == "unchanged":
        assert -bound <= low <= high <= bound


TIMED = {"samples_s": [1e-3] * 20, "timer": "wall"}


@pytest.mark.parametrize(
    ("base", "head", "reason"),
    [
        (TIMED, {}, "HEAD was not timed"),
        ({}, TIMED, "BASE was not timed"),
        (TIMED, {**TIMED, "samples_s": [1e-3] * 7}, "too few"),
        (TIMED, {**TIMED, "samples_s": [0.0, -1.0]}, "not timed"),
        ({**TIMED, "timer": "gpu"}, TIMED, "timed by gpu clock in BASE, by wall in HEAD"),
    ],
)
def test_incomparable_times_are_inconclusive_with_a_reason(base, head, reason):
    change = read_pair(*(make_record(time=time or None) for time in (base, head)), same_work=True)
    assert change.outcome == "inconclusive"
    assert reason in change.reason


def test_untimed_cases_have_no_outcome_and_eight_samples_suffice():
    assert read_pair(make_record(), make_record(), same_work=True) is None
    enough = make_record(time={"samples_s": [1e-3] * 8})
    assert isinstance(read_pair(enough, enough, same_work=True), Pair)


@pytest.mark.parametrize("lacking", [0, 1])
@pytest.mark.parametrize("reference_s", [[], [0.0] * 19 + [1e-3]])
def test_pair_lacks_the_reference_draw_if_one_run_does(lacking, reference_s):
    times = [{**TIMED, "reference_s": [1e-3] * 20} for _ in range(2)]
    times[lacking]["reference_s"] = reference_s
    pair = read_pair(*(make_record(time=time) for time in times), same_work=True)
    assert pair.reference is None
    assert not pair.same_rounds


def test_rounds_with_an_invalid_sample_are_not_paired():
    """Runs without different rounds have equal numbers of samples, which are shifted."""
    times = {"timer": "wall", "reference_s": [1e-3] * 20}
    complete, first, last = ([1e-3] * 20 for _ in range(3))
    first[0], last[19] = 0.0, 0.0
    of_pairs = ((complete, complete, True), (first, last, False), (complete, last, False))
    for *samples, same in of_pairs:
        records = (make_record(time={**times, "samples_s": samples_s}) for samples_s in samples)
        pair = read_pair(*records, same_work=True)
        assert pair.same_rounds == same


@pytest.mark.parametrize(("drift", "outcome"), [(1.0, "unchanged"), (2.5, "regressed")])
def test_drift_without_reference_draw_is_reported_in_full(drift, outcome):
    rng = np.random.default_rng(11)
    unreferenced = [replace(pair, reference=None) for pair in pairs(rng, [0] * 5, drift=drift)]
    _, together = compare(unreferenced)
    assert (together.outcome, together.reference, together.gated) == (outcome, None, False)
    assert together.low < drift < together.high


def test_two_peers_of_equal_counters_suffice():
    """The third case grew relative to two peers, but shrank relative to the reference draw."""
    rng = np.random.default_rng(12)
    dear = pairs(rng, [0.2], drift=1.0, reference_drift=1.6, same_work=False)
    same = pairs(rng, [0, 0], drift=1.0, reference_drift=1.6)
    (change, *_), _ = compare([*dear, *same])
    assert (change.outcome, change.against) == ("regressed", "peers")
    (change, *_), _ = compare([*dear, *same[:1]])
    assert change.against == "reference"


@pytest.mark.parametrize("normalise", ["reference", "none"])
def test_normalise_setting_selects_the_correction(normalise):
    changes, _ = compare(pairs(np.random.default_rng(14), [0] * 5), Settings(normalise=normalise))
    assert {change.against for change in changes} == {normalise}


def test_one_separate_case_makes_a_group_use_peers():
    separate = pairs(np.random.default_rng(15), [0] * 4)
    paired = [replace(pair, same_rounds=True) for pair in separate]
    for cases, against in ((paired, "rounds"), ([paired[0], *separate[1:]], "peers")):
        changes, _ = compare(cases)
        assert {change.against for change in changes} == {against}


@pytest.mark.parametrize("peers", [2, 5])
@pytest.mark.parametrize("scatter", [0.0075, 0.028])
def test_interval_of_a_case_among_its_peers_covers_95_percent(peers, scatter):
    """A normal quantile in place of Student's covers 70 % with two peers and 88 % with five."""
    rng = np.random.default_rng(16)
    covered = 0
    for case, *logs in rng.normal(0, scatter, (2000, peers + 1)):
        shift = estimate_peer_shift(np.array(logs), 0.95)
        reach = student.ppf(0.975, shift.degrees) * shift.sd
        covered += abs(case - shift.low) <= reach
    assert covered >= 0.94 * 2000
    assert scatter == 0.0075 or covered <= 0.97 * 2000


def test_equal_separate_runs_rarely_regress_when_processes_differ():
    """Six cases that differ by 2 % between processes: at most 5 % of comparisons regress."""
    rng, alarms = np.random.default_rng(17), 0
    for _ in range(100):
        changes, _ = compare(pairs(rng, [0] * 6, scatter=0.02))
        alarms += any(change.outcome == "regressed" for change in changes)
    assert alarms <= 5


def test_common_rounds_detect_8_percent_when_epochs_differ():
    """Six cases whose epochs differ by 2 %: common rounds detect 8 %, separate runs do not."""
    rng, outcomes = np.random.default_rng(18), Counter()
    for _ in range(20):
        cases = []
        for pair in pairs(rng, [0.08, *[0] * 5], rounds=60):
            head = pair.head * np.repeat(np.exp(rng.normal(0, 0.02, 12)), 5)
            epochs = ([5] * 12, None)
            cases.append(replace(pair, head=head, same_rounds=True, parts=epochs))
        changes, _ = compare(cases)
        outcomes["detected"] += changes[0].outcome == "regressed"
        outcomes["false"] += sum(change.outcome == "regressed" for change in changes[1:])
    assert outcomes["detected"] >= 18
    assert outcomes["false"] <= 2


def test_case_of_other_polygons_has_no_peers():
    """`fan` draws 229 of 500 polygons and drifts differently; peers and reference do not fit."""
    rng = np.random.default_rng(19)
    (fan,) = pairs(rng, [0.15], same_work=True)
    cases = [replace(fan, polygons=229), *pairs(rng, [0] * 5)]
    changes, _ = compare(cases)
    assert [change.outcome for change in changes] == ["inconclusive", *["unchanged"] * 5]
    assert changes[0].reason == "too few cases drew the same 229 polygons; use run --beside"
    changes, _ = compare([replace(case, same_rounds=True) for case in cases])
    assert changes[0].outcome == "regressed"
    # A pair of peers with other polygons does not count for the three that are needed.
    other_cases = [replace(case, polygons=229) for case in pairs(rng, [0] * 2)]
    changes, _ = compare([*pairs(rng, [0] * 2), *other_cases])
    assert {change.outcome for change in changes} == {"inconclusive"}


def test_drift_is_that_of_the_largest_group_of_common_rounds():
    rng = np.random.default_rng(21)
    groups = ((pairs(rng, [0.1], rounds=40), "resumed"), (pairs(rng, [0] * 3), "first"))
    cases = [
        replace(pair, same_rounds=True, round_group=name)
        for group, name in groups
        for pair in group
    ]
    _, drift = compare(cases)
    assert (drift.cases, drift.outcome) == (3, "unchanged")


def test_equal_drawings_are_not_tested():
    """A drawing shared by both versions has no ratio or p-value and does not affect correction."""
    rng = np.random.default_rng(20)
    cases = [replace(pair, same_rounds=True) for pair in pairs(rng, [0.03, *[0] * 9], noise=0.02)]
    single, _ = compare(cases[:1])
    equal = [replace(case, head=case.base, same_drawing=True) for case in cases[1:]]
    changes, drift = compare([cases[0], *equal])
    assert changes[0].q_value == changes[0].p_value == single[0].p_value
    shared = {(c.outcome, c.against, c.ratio, c.q_value) for c in changes[1:]}
    assert shared == {("unchanged", "same-triangles", None, None)}
    assert drift is None
    _, drift = compare([*cases[:2], *equal])
    assert drift.cases == 2
    times = {**TIMED, "reference_s": [1e-3] * 20}
    record = make_record(time=times)
    assert read_pair(record, record, same_work=True).same_drawing
    other = make_record(time={**times, "samples_s": [1e-3] * 19 + [1.001e-3]})
    assert not read_pair(record, other, same_work=True).same_drawing
