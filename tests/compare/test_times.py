"""What the judge of times promises, on times of which the truth is known."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.compare.model import Settings, TimeChange
from harness.compare.times import (
    Q_VALUE,
    Pair,
    correct,
    decide,
    drift_of_rounds,
    judge_group,
    read_pair,
)
from tests.records import make_record

SETTINGS = Settings()


def pairs(
    rng, growths, *, noise=0.01, rounds=30, drift=1.0, reference_drift=None, same_work=True
) -> list[Pair]:
    """Return cases that grew by `growths` on a machine that changed its speed by `drift`."""

    def times(seconds: float):
        # Other programs lengthen a sample, nothing shortens it.
        return seconds * (1 + np.abs(rng.normal(0, noise, rounds)))

    reference = times(1e-3), times(1e-3 * (drift if reference_drift is None else reference_drift))
    return [
        Pair(times(3e-3), times(3e-3 * drift * (1 + growth)), reference, same_work)
        for growth in growths
    ]


def judge(found, settings=SETTINGS, machines_differ=False):
    changes, drift = judge_group("here", found, settings, machines_differ=machines_differ)
    return correct(changes, settings), drift


@pytest.mark.parametrize("drift", [0.8, 1.0, 1.25])
def test_a_slower_case_is_found_whatever_the_machine_does(drift):
    changes, together = judge(pairs(np.random.default_rng(1), [0, 0, 0.1, 0, 0], drift=drift))
    assert [c.outcome for c in changes] == [*["unchanged"] * 2, "regressed", *["unchanged"] * 2]
    assert changes[2].low < 1.1 < changes[2].high
    assert together.outcome != "regressed"


def test_a_cheaper_case_is_found():
    changes, _ = judge(pairs(np.random.default_rng(2), [0, -0.1, 0, 0]))
    assert [c.outcome for c in changes] == ["unchanged", "improved", "unchanged", "unchanged"]


@pytest.mark.parametrize("noise", [0.005, 0.02, 0.1, 0.5])
def test_equal_runs_hardly_ever_regress(noise):
    rng, outcomes = np.random.default_rng(3), Counter()
    for _ in range(20):
        drift = math.exp(rng.normal(0, 0.05))
        changes, together = judge(pairs(rng, rng.normal(0, 0.005, 5), noise=noise, drift=drift))
        outcomes.update(change.outcome for change in changes)
        outcomes[f"together {together.outcome}"] += 1
    assert outcomes["regressed"] + outcomes["together regressed"] <= 1
    if noise >= 0.5:
        assert outcomes["inconclusive"] >= 95
    if noise <= 0.02:
        assert outcomes["unchanged"] >= 95


def test_noise_never_passes_for_unchanged():
    changes, _ = judge(pairs(np.random.default_rng(4), [0] * 4, noise=0.6, rounds=12))
    assert {change.outcome for change in changes} == {"inconclusive"}
    assert all("somewhere in" in change.reason for change in changes)


def test_all_cases_together_regress_only_beyond_the_reference_draw():
    rng = np.random.default_rng(5)
    _, machine = judge(pairs(rng, [0] * 5, drift=1.15))
    assert machine.outcome == "inconclusive"
    changes, code = judge(pairs(rng, [0] * 5, drift=1.15, reference_drift=1.0))
    assert code.outcome == "regressed"
    assert {change.outcome for change in changes} == {"unchanged"}
    _, elsewhere = judge(pairs(rng, [0] * 5, drift=3, reference_drift=2), machines_differ=True)
    assert elsewhere.outcome == "inconclusive"


def test_a_changed_majority_does_not_make_the_rest_look_improved():
    """Counters tell which cases drew the same; these are the peers."""
    rng = np.random.default_rng(6)
    dear = pairs(rng, [0.2, 0.2, 0.2], same_work=False)
    changes, _ = judge([*dear, *pairs(rng, [0, 0, 0])])
    assert [c.outcome for c in changes] == ["regressed"] * 3 + ["unchanged"] * 3


@pytest.mark.parametrize("machines_differ", [False, True])
def test_a_single_case_is_judged_beside_the_reference_draw(machines_differ):
    rng = np.random.default_rng(7)
    (change,), drift = judge(pairs(rng, [0.15]), machines_differ=machines_differ)
    assert change.outcome == "regressed"
    assert change.against == "reference"
    assert not drift.gated
    (same,), _ = judge(pairs(rng, [0], drift=1.3), machines_differ=machines_differ)
    # On one machine it cannot be known whether the reference draw tells all of the drift.
    assert same.outcome == ("unchanged" if machines_differ else "inconclusive")


def test_a_single_case_without_reference_on_another_machine_is_inconclusive():
    (pair,) = pairs(np.random.default_rng(8), [0])
    (change,), _ = judge([Pair(pair.base, pair.head, None, True)], machines_differ=True)
    assert change.outcome == "inconclusive"
    assert "reference" in change.reason


def test_many_cases_are_corrected_for():
    """With a hundred equal cases, chance differences beyond a threshold of 0 stay inconclusive."""
    rng = np.random.default_rng(9)
    settings = Settings(thresholds={"time": 0.0})
    changes, _ = judge(pairs(rng, [0] * 100, noise=0.05), settings)
    assert sum(change.outcome == "regressed" for change in changes) <= 1
    assert all(change.q_value >= change.p_value - 1e-12 for change in changes)


@pytest.mark.parametrize(
    ("against", "q_value", "outcome"),
    [
        ("rounds", 0.01, "inconclusive"),
        ("rounds", 0.0005, "regressed"),
        ("rounds", Q_VALUE, "regressed"),
        ("peers", 0.01, "regressed"),
        ("peers", 1 - SETTINGS.confidence, "regressed"),
        ("peers", 0.06, "inconclusive"),
        ("reference", 0.01, "regressed"),
    ],
)
def test_an_alarm_of_rounds_needs_more_evidence_than_one_of_peers(against, q_value, outcome):
    change = TimeChange("regressed", "", against=against, p_value=q_value, q_value=q_value)
    (settled,) = correct([change], SETTINGS)
    assert settled.outcome == outcome
    assert ("may be chance" in settled.reason) == (outcome == "inconclusive")


def test_processes_that_differ_are_no_regression_of_their_rounds():
    """Two fresh processes of one code, 3 % apart: sixty rounds are sure of it, two values not."""
    level = np.repeat([0.0, 0.03], 30)
    rng = np.random.default_rng(11)
    base = np.exp(0.001 * rng.standard_normal(60))
    times = {"timer": "wall", "reference_s": [1e-3] * 60, "epochs": [5] * 12, "processes": [30, 30]}
    records = [
        make_record(time={**times, "samples_s": samples.tolist()})
        for samples in (base, base * np.exp(level))
    ]
    pair = read_pair(*records, same_work=True)
    assert isinstance(pair, Pair)
    (change,), drift = judge([pair])
    assert (change.outcome, drift.outcome) == ("inconclusive", "inconclusive")
    assert change.low < 1 < change.high
    one_process = replace(records[1], time=replace(records[1].time, processes=()))
    alone = read_pair(records[0], one_process, same_work=True)
    assert isinstance(alone, Pair)
    (change,), _ = judge([alone])
    assert change.low > 1


@pytest.mark.parametrize(("rounds", "outcome"), [(9, "inconclusive"), (12, "regressed")])
def test_what_all_cases_did_needs_rounds_enough_to_be_an_alarm(rounds, outcome):
    """Nine rounds that are all slower happen by chance once in 256 times, twelve in 2048."""
    rng = np.random.default_rng(10)
    base = np.exp(0.001 * rng.standard_normal((3, rounds)))
    drift = drift_of_rounds("here", [(each, each * 1.1) for each in base], SETTINGS)
    assert drift.outcome == outcome
    assert drift.reason == ("too few rounds" if outcome == "inconclusive" else "")


@given(
    least=st.floats(-1, 1),
    spread=st.floats(0, 0.5),
    below=st.floats(0, 1),
    above=st.floats(0, 1),
    threshold=st.floats(0, 0.5),
)
def test_an_outcome_needs_its_evidence(least, spread, below, above, threshold):
    most = least + spread
    low, high = least - below, most + above
    bound = math.log1p(threshold)
    outcome, reason = decide(least, most, low, high, threshold)
    mirrored, _ = decide(-most, -least, -high, -low, threshold)
    swap = {"regressed": "improved", "improved": "regressed"}
    assert mirrored == swap.get(outcome, outcome)
    assert bool(reason) == (outcome == "inconclusive")
    if outcome == "regressed":
        assert low > 0
        assert least > bound
    if outcome == "unchanged":
        assert -bound <= low <= high <= bound


@pytest.mark.parametrize(
    ("base", "head", "reason"),
    [
        ({"samples_s": [1e-3] * 20}, {}, "HEAD was not timed"),
        ({}, {"samples_s": [1e-3] * 20}, "BASE was not timed"),
        ({"samples_s": [1e-3] * 20}, {"samples_s": [1e-3] * 7}, "too few"),
        ({"samples_s": [1e-3] * 20}, {"samples_s": [0.0, -1.0]}, "not timed"),
        (
            {"samples_s": [1e-3] * 20, "timer": "gpu"},
            {"samples_s": [1e-3] * 20, "timer": "wall"},
            "timed by gpu clock in BASE, by wall in HEAD",
        ),
    ],
)
def test_times_that_cannot_be_compared_are_inconclusive_with_the_reason(base, head, reason):
    change = read_pair(*(make_record(time=each or None) for each in (base, head)), same_work=True)
    assert change.outcome == "inconclusive"
    assert reason in change.reason


def test_cases_that_were_never_timed_have_no_verdict_and_eight_samples_may_have_one():
    assert read_pair(make_record(), make_record(), same_work=True) is None
    enough = make_record(time={"samples_s": [1e-3] * 8})
    assert isinstance(read_pair(enough, enough, same_work=True), Pair)


@pytest.mark.parametrize("lacking", [0, 1])
def test_without_a_reference_in_both_there_is_none(lacking):
    times = [{"samples_s": [1e-3] * 20, "reference_s": [1e-3] * 20} for _ in range(2)]
    del times[lacking]["reference_s"]
    pair = read_pair(*(make_record(time=each) for each in times), same_work=True)
    assert pair.reference is None
    assert not pair.same_rounds


def test_rounds_are_no_pairs_where_a_sample_is_left_out():
    """Of either run one is left out, in another round each: the rest is as long, but shifted."""
    times = {"timer": "wall", "reference_s": [1e-3] * 20}
    whole, first, last = ([1e-3] * 20 for _ in range(3))
    first[0], last[19] = 0.0, 0.0
    for base, head, same in ((whole, whole, True), (first, last, False), (whole, last, False)):
        pair = read_pair(
            *(make_record(time={**times, "samples_s": each}) for each in (base, head)),
            same_work=True,
        )
        assert isinstance(pair, Pair)
        assert pair.same_rounds == same


@pytest.mark.parametrize(("drift", "outcome"), [(1.0, "unchanged"), (2.5, "regressed")])
def test_without_a_reference_draw_all_of_the_drift_is_told(drift, outcome):
    rng = np.random.default_rng(11)
    found = [replace(pair, reference=None) for pair in pairs(rng, [0] * 5, drift=drift)]
    _, together = judge(found)
    assert (together.outcome, together.reference, together.gated) == (outcome, None, False)
    assert together.low < drift < together.high


def test_two_cases_that_draw_the_same_are_peers_enough():
    """By these the third one grew, and by the reference draw, which drifts otherwise, it shrank."""
    rng = np.random.default_rng(12)
    dear = pairs(rng, [0.2], drift=1.0, reference_drift=1.6, same_work=False)
    same = pairs(rng, [0, 0], drift=1.0, reference_drift=1.6)
    (change, *_), _ = judge([*dear, *same])
    assert (change.outcome, change.against) == ("regressed", "peers")
    (change, *_), _ = judge([*dear, *same[:1]])
    assert change.against == "reference"


@pytest.mark.parametrize("normalise", ["reference", "none"])
def test_peers_are_asked_only_where_they_may_be(normalise):
    changes, _ = judge(pairs(np.random.default_rng(14), [0] * 5), Settings(normalise=normalise))
    assert {change.against for change in changes} == {normalise}


def test_cases_of_the_same_rounds_are_judged_so_only_together():
    found = pairs(np.random.default_rng(15), [0] * 4)
    paired = [replace(pair, same_rounds=True) for pair in found]
    for chosen, against in ((paired, "rounds"), ([paired[0], *found[1:]], "peers")):
        changes, _ = judge(chosen)
        assert {change.against for change in changes} == {against}
