"""A run's state is told by one rule, and intervals hold on machines that are in use."""

import json
import math
import re

import numpy as np
import pytest

from harness.metrics.decision import advice, decide
from harness.stats import run_quality
from harness.stats.run_quality import (
    DISTURBED,
    ENOUGH,
    QUIET,
    SLOWER,
    UNTRUSTED,
    apart,
    judge,
    kept_pairs,
    reference_draws,
    state_of,
    two_modes,
    undisturbed,
)
from scripts.studies.machines import ROUNDS, quiet, sliced, timed, two_speeds
from tests.measuring.test_run import measure, plan_for


@pytest.mark.parametrize("machine", [quiet, sliced, two_speeds], ids=lambda each: each.__name__)
def test_the_best_of_several_is_not_shown_by_chance(machine):
    """Seven that cost the same: of the runs, at most one in twenty says that one saves."""
    rng = np.random.default_rng(3)
    count = 150
    shown = sum(decide(timed(rng, machine, (1.0,) * 7)).ground == "shown" for _ in range(count))
    assert shown / count <= 0.05


def test_samples_that_waited_are_left_out_if_others_are_enough():
    times = {"samples_s": [1.0] * 20, "waited_s": [0.0] * ENOUGH + [0.021] * (20 - ENOUGH)}
    assert undisturbed(times).sum() == ENOUGH
    base = {"samples_s": [1.0] * 20, "waited_s": [0.02] * 20}
    assert kept_pairs(times, base).sum() == ENOUGH
    assert kept_pairs(times, {**base, "waited_s": [0.02] * 19 + [0.0]}).sum() == ENOUGH
    assert kept_pairs(times, {**base, "waited_s": [0.5] + [0.0] * 19}).sum() == 20
    assert undisturbed({"samples_s": [1.0, 2.0]}).all()  # nobody knows
    with pytest.raises(ValueError, match="not rounds of one group"):
        kept_pairs(times, {"samples_s": [1.0]})


def test_threads_that_wait_for_each_other_are_not_disturbed():
    """Vulkan's on the CPU do; what they wait for takes no longer by the wall clock."""
    rng = np.random.default_rng(11)
    cpu = 1e-3 * np.exp(0.01 * rng.standard_normal(40))
    times = {"samples_s": cpu.tolist(), "waited_s": (0.95 * cpu).tolist()}
    late = np.where(np.arange(40) < 10, 0.5 * cpu, 0.0)  # by another program
    assert not undisturbed(times).any()
    assert undisturbed({**times, "wall_s": (1.001 * cpu).tolist()}).all()
    for usual in (0.5, 1.001):  # side by side, one after the other
        found = undisturbed({**times, "wall_s": (usual * cpu + late).tolist()})
        assert found.tolist() == (late == 0).tolist()
    assert not undisturbed({**times, "wall_s": (1.5 * cpu).tolist()}).any()


def test_few_drawings_of_two_modes_disturb_no_run():
    rng = np.random.default_rng(12)
    one, another = (timed(rng, machine, (1.0,))[0] for machine in (two_speeds, quiet))
    many = [{**another, "triangulator": str(number)} for number in range(11)]
    assert judge([one, *many[:8]]).state == DISTURBED
    assert judge([one, *many]).state == QUIET
    samples = one["time"]["samples_s"]
    of_two = {**one["time"], "processes": [len(samples) // 2, len(samples) - len(samples) // 2]}
    low, high = re.search(
        r"\((\S+) and (\S+) ms\)", str(judge([{**one, "time": of_two}]).words)
    ).groups()
    told = 1e-3 * float(low), 1e-3 * float(high)
    assert told == pytest.approx(two_modes(samples), rel=0.2)


def test_two_modes_are_found_and_one_is_one():
    rng = np.random.default_rng(1)
    for samples in (
        np.exp(0.02 * rng.standard_normal(200)),
        rng.uniform(1, 2, 200),
        1 + rng.exponential(0.2, 200),
        np.r_[np.ones(190), 5 * np.ones(10)],  # a few that are slow
        np.linspace(1.0, 1.3, 60),  # a drift
    ):
        assert two_modes(samples) is None
    modes = two_modes(np.r_[rng.normal(1, 0.02, 40), rng.normal(2, 0.04, 10)])
    assert modes == pytest.approx((1, 2), rel=0.02)
    assert two_modes([1.0] * 9 + [2.0] * 3) == pytest.approx((1, 2))
    assert two_modes([1.0] * 8 + [2.0] * 3) is None
    for scatter, found in ((0.03, True), (0.09, False)):  # five of their widths have to fit between
        noise = np.exp(scatter * rng.standard_normal(400))
        assert (two_modes(noise * np.repeat([1.0, 1.3], 200)) is not None) == found


def test_one_rule_tells_the_state():
    rng = np.random.default_rng(2)
    assert judge(timed(rng, quiet, (1.0, 0.9))).state == QUIET
    sliced_run = judge(timed(rng, sliced, (1.0, 0.9)))
    assert sliced_run.state == DISTURBED
    assert "samples waited for a core" in sliced_run.words[0]
    for others_s, state in ((0.05, QUIET), (0.5, DISTURBED)):
        alone = timed(rng, sliced, (1.0, 0.9))
        for record in alone:
            record["time"] |= {"timing_s": 1.0, "others_s": others_s}
        assert judge(alone).state == state
    two = judge(timed(rng, two_speeds, (1.0, 0.9)))
    assert two.state == DISTURBED
    assert "two modes" in two.words[0]
    record = timed(rng, two_speeds, (1.0,))[0]
    assert judge([{**record, "time": {**record["time"], "timer": "wall"}}]).state == UNTRUSTED
    for free, state in ((0, UNTRUSTED), (ENOUGH, DISTURBED)):
        waited = {**record["time"], "waited_s": [0.0] * free + [1.0] * (ROUNDS - free)}
        assert judge([{**record, "time": waited}]).state == state
    draw = {"rasteriser": "opengl", "device": "llvmpipe", "resolution": 64, "reference_s": 1e-3}
    assert judge([], [{**draw, "slower": 1.2}]).state == QUIET
    assert judge([], [{**draw, "slower": 1.6}]).state == DISTURBED
    stolen = {**timed(rng, quiet, (1.0,))[0]["time"], "stolen_s": 1.0, "timing_s": 10.0}
    assert judge([{**record, "time": stolen}]).state == DISTURBED


@pytest.mark.parametrize("levels", [(1.0, 1.5), (1.0, 1.5, 1.5, 1.0)])
def test_processes_that_differ_are_no_two_modes(levels):
    each = ROUNDS // len(levels)
    rng = np.random.default_rng(8)
    record = timed(rng, quiet, (1.0,))[0]
    samples = np.array(record["time"]["samples_s"]) * np.repeat(levels, each)
    times = {**record["time"], "samples_s": samples.tolist()}
    assert judge([{**record, "time": times}]).state == DISTURBED
    times["processes"] = [each] * len(levels)
    assert judge([{**record, "time": times}]).state == QUIET


def test_what_a_run_tells_of_its_state_is_believed():
    told = {"state": {"state": DISTURBED, "why": ["a neighbour"], "draws": []}}
    assert state_of(told, []).words[0].startswith("the run's times are disturbed: a neighbour")
    for damaged in (None, {}, {"state": "x"}, {"state": {"state": 3}}, {"state": []}):
        assert state_of(damaged or {}, []).state == QUIET


def test_in_a_disturbed_run_counters_decide_and_the_sentence_says_so():
    rng = np.random.default_rng(4)
    records = timed(rng, quiet, (1.0, 0.6, 0.8))
    records[2]["counters"] = {"quads": 50}
    assert decide(records).choice.name == "rival 1"
    for record in records:
        record["state"] = DISTURBED
    decision = decide(records)
    assert (decision.ground, decision.choice.name) == ("counted", "rival 2")
    assert [each.name for each in decision.standings] == ["rival 2", "ear-clipping", "rival 1"]
    sentence = advice(decide(records))
    assert "its times are disturbed and show nothing" in sentence
    assert "measure again" in sentence
    for record in records:
        record["counters"] = {"quads": 9}
    assert decide(records).ground == "open"
    assert "its times are disturbed and show nothing" in advice(decide(records))


def test_runs_in_different_states_are_not_compared():
    rng = np.random.default_rng(6)
    base, head = (timed(rng, quiet, (1.0,))[0]["time"] for _ in range(2))
    assert apart(base, head, machines_differ=False) == ""
    slower = {**head, "reference_s": [1.4] * ROUNDS}
    assert "two states" in apart(base, slower, machines_differ=False)
    assert "--beside" in apart(slower, base, machines_differ=False)
    assert apart(base, slower, machines_differ=True) == ""
    first, last = ({**head, "reference_s": [each] * ROUNDS} for each in (1.0, SLOWER))
    assert apart(first, last, machines_differ=False) == ""
    waiting = {**head, "waited_s": [1.0] * ROUNDS}
    assert apart(base, waiting, machines_differ=True).startswith(
        "HEAD was disturbed (72 of 72 samples waited"
    )


def records(reference_s: float, **changes: object) -> list[dict]:
    """Return two cases timed together, so that they share their reference draws."""
    draws = [reference_s * 0.9, reference_s, reference_s * 1.4]
    record = {
        "rasteriser": "opengl",
        "device": "llvmpipe",
        "resolution": 1024,
        "options": {"samples": 1, "work": 0},
        "time": {"timer": "cpu", "reference_s": draws},
        **changes,
    }
    return [record, {**record, "triangulator": "another"}]


def test_the_first_run_is_its_own_best(tmp_path):
    file = tmp_path / "a" / "new" / "draws.json"
    (found,) = reference_draws(records(1e-3), file)
    assert file.is_file()
    assert found == {
        "rasteriser": "opengl",
        "device": "llvmpipe",
        "resolution": 1024,
        "samples": 1,
        "work": 0,
        "timer": "cpu",
        "reference_s": 1e-3,
        "best_s": 1e-3,
        "runs": 1,
        "slower": 1.0,
    }


def test_a_slower_run_is_told_by_how_much(tmp_path):
    file = tmp_path / "draws.json"
    reference_draws(records(1e-3), file)
    (slow,) = reference_draws(records(2e-3), file)
    assert (slow["slower"], slow["runs"]) == (pytest.approx(2.0), 2)
    (faster,) = reference_draws(records(0.5e-3), file)
    assert (faster["best_s"], faster["slower"], faster["runs"]) == (0.5e-3, 1.0, 3)


def test_each_device_view_and_machine_has_its_own(tmp_path, monkeypatch):
    file = tmp_path / "draws.json"
    reference_draws(records(1e-3), file)
    for other in ({"resolution": 256}, {"device": "zink"}, {"options": {"samples": 4, "work": 0}}):
        assert reference_draws(records(5e-3, **other), file)[0]["slower"] == 1.0
    monkeypatch.setattr(run_quality, "processor", lambda: {"label": "another"})
    assert reference_draws(records(5e-3), file)[0]["slower"] == 1.0


@pytest.mark.parametrize("content", ["", "[1]", '{"a": [0, 1]}', '{"a": [1, 0]}', '{"a": 3}', "{"])
def test_a_damaged_file_is_begun_anew(content, tmp_path):
    file = tmp_path / "draws.json"
    file.write_text(content)
    assert reference_draws(records(1e-3), file)[0]["best_s"] == 1e-3
    assert len(json.loads(file.read_text())) == 1


def test_a_place_that_cannot_be_written_stops_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    (found,) = reference_draws(records(1e-3), tmp_path / "file" / "draws.json")
    assert (found["slower"], found["runs"]) == (1.0, 1)


def test_cases_without_times_have_no_state(tmp_path):
    assert reference_draws(records(1e-3, time=None), tmp_path / "draws.json") == []


def test_a_run_keeps_what_it_was_compared_with(block, tmp_path):
    measure(plan_for(block), tmp_path / "out")
    facts = json.loads((tmp_path / "out" / "run.json").read_text())
    (entry,) = facts["state"]["draws"]
    assert entry["device"] == "scripted"
    assert 0 < entry["best_s"] <= entry["reference_s"]
    assert math.isclose(entry["slower"], entry["reference_s"] / entry["best_s"])
    assert facts["cpu"]["label"]
    assert run_quality.default_path().exists()
