"""Rounds of timing: interleaving, duration, stopping; selection of the timer."""

import time
from collections.abc import Callable
from dataclasses import replace
from itertools import accumulate, chain, cycle
from typing import Any

import numpy as np
import pytest
from scipy.stats import sem, t

from harness.measuring.timing import (
    EMPTY,
    MIN_ROUNDS,
    REFERENCE,
    TimerTest,
    Times,
    TimingSettings,
    _find_precise,
    _measure_resolution,
    _warm_up,
    select_timer,
    time_together,
)
from harness.metrics.statistics import Ratio, compute_median_interval, compute_paired_ratio
from harness.rasterisers.base import Sample
from tests.mock import Clock, ScriptedDrawing

WALL = TimerTest("wall", 0.01, None, 1e-7, "scripted")
UNTIL_PRECISE = TimingSettings(budget_s=100, min_share=0)


def scripted(costs: dict[str, float], noise: float = 0.0, clock: Clock | None = None, seed=0):
    clock = clock or Clock()
    log: list[str] = []
    options = (clock, noise, log, seed)
    drawings = {name: ScriptedDrawing(name, cost, *options) for name, cost in costs.items()}
    return drawings, clock, log


def time_scripted(costs, settings, timer=WALL, **options) -> tuple[dict[str, Times], Clock]:
    drawings, clock, _ = scripted(costs, **options)
    return time_together(drawings, settings, timer, clock=clock), clock


def test_every_round_times_every_drawing_once_in_changing_order():
    drawings, clock, log = scripted({"a": 2e-3, "b": 3e-3, "c": 4e-3})
    times = time_together(drawings, TimingSettings(), WALL, clock=clock)
    rounds = len(times["a"].samples_s)
    tail = log[-3 * rounds :]
    seen = [tuple(tail[i : i + 3]) for i in range(0, len(tail), 3)]
    assert all(sorted(round_) == ["a", "b", "c"] for round_ in seen)
    assert len(set(seen)) > 1
    assert [len(entry.samples_s) for entry in times.values()] == [rounds] * 3
    assert times["a"].epochs == [rounds]


def test_the_reference_draw_is_warmed_up_before_timing():
    """A drawing that follows a large drawing in a round has cold caches."""

    asked: list[int] = []

    class Cold(ScriptedDrawing):
        def sample(self, repeats: int) -> Sample:
            cold = self.log[-1:] != [self.name]
            asked.extend([repeats] * (cold and self.name == REFERENCE))
            sample = super().sample(repeats)
            return Sample(wall=sample.wall + cold * 1e-3)

    clock, log = Clock(), []
    drawings = {name: Cold(name, 2e-3, clock, 0.0, log, 0) for name in ("a", REFERENCE)}
    times = time_together(drawings, TimingSettings(), WALL, clock=clock)
    assert set(times[REFERENCE].samples_s) == {2e-3}
    assert max(times["a"].samples_s) == pytest.approx(3e-3)
    assert set(asked[1:]) == {1}


def test_the_minimum_share_of_the_budget_is_always_used():
    times, clock = time_scripted({"a": 2e-3, "b": 3e-3}, TimingSettings(budget_s=1))
    assert clock.now == pytest.approx(TimingSettings.min_share * 2, rel=0.05)
    assert all(entry.precision_reached for entry in times.values())


@pytest.mark.parametrize(("share", "reached"), [(0.008, True), (0.012, False)])
def test_precision_is_the_half_width_of_the_interval(share, reached):
    """Draws of 1 ms are alternately longer and shorter by `share`."""
    alternating = ScriptedSeconds(lambda number: 1e-3 * (1 - share * (-1) ** number))
    entry = alternating.time(precision=0.01, budget_s=0.1)
    low, high = entry.ci95_s
    assert (high - low) / 2 == pytest.approx(share * 1e-3)
    assert entry.precision_reached is reached


@pytest.mark.parametrize(("rounds", "precise"), [(1, False), (5, False), (6, True)])
def test_fewer_than_six_samples_are_not_precise(rounds, precise):
    assert Times(1, [1e-3] * rounds).is_precise(0.01) is precise


@pytest.mark.parametrize(("names", "reached"), [("ab", True), ("a", False)])
def test_precise_ratios_suffice_on_a_drifting_machine(names, reached):
    """The speed drops by a tenth per second, so medians never become as narrow as ratios."""
    settings = TimingSettings(precision=0.003, budget_s=3.0, min_share=0.2, warm_up_s=0.0)
    drifting = Clock(speed=lambda now: 1 + now / 10)
    costs = dict.fromkeys(names, 2e-3)
    times, clock = time_scripted(costs, settings, noise=0.002, clock=drifting)
    assert all(entry.precision_reached is reached for entry in times.values())
    assert (clock.now < 0.9 * len(names)) == reached
    for entry in times.values():
        low, high = entry.ci95_s
        assert (high - low) / 2 > 0.003 * entry.median_s


def test_the_empty_draw_needs_no_precision():
    drawings, clock, _ = scripted({"a": 2e-3})
    drawings[EMPTY] = ScriptedDrawing(EMPTY, 1e-6, clock, noise=0.8)
    times = time_together(drawings, UNTIL_PRECISE, WALL, clock=clock)
    assert len(times["a"].samples_s) == MIN_ROUNDS
    assert times["a"].precision_reached


def test_short_draws_are_batched():
    settings = TimingSettings(min_batch_s=1e-3, paired=False)
    times, _ = time_scripted({"short": 1e-6, "long": 5e-3}, settings)
    assert times["short"].repeats >= 1000
    assert times["long"].repeats == 1
    assert times["short"].median_s == pytest.approx(1e-6)


def test_compared_drawings_have_equal_repeats():
    drawings, clock, _ = scripted({"a": 1.1e-4, "b": 0.9e-4, "c": 4e-4}, noise=0.2)
    drawings[REFERENCE] = ScriptedDrawing(REFERENCE, 1e-5, clock)
    times = time_together(drawings, TimingSettings(budget_s=1), WALL, clock=clock)
    assert len({times[name].repeats for name in "abc"}) == 1
    assert times["a"].repeats >= 8
    assert times[REFERENCE].repeats > 2 * times["a"].repeats


def test_tiny_drawings_do_not_lengthen_other_batches():
    settings = TimingSettings(budget_s=1e-3, warm_up_s=0.0)
    times, clock = time_scripted({"tiny": 2e-6, "long": 5e-3, "as long": 5.1e-3}, settings)
    assert times["tiny"].repeats >= 400
    assert times["long"].repeats == 2
    assert clock.now < 3 * MIN_ROUNDS * 10e-3


@pytest.mark.parametrize(("seconds", "min_repeats", "max_repeats"), [(1e-3, 10, 100), (1e-2, 1, 1)])
def test_a_batch_lasts_a_hundred_timer_steps(seconds, min_repeats, max_repeats):
    coarse = TimerTest("wall", 0.01, None, 1e-4, "scripted")
    times, _ = time_scripted({"a": seconds}, TimingSettings(), coarse)
    assert min_repeats <= times["a"].repeats <= max_repeats


def time_pair_on_slowing_machine(truth: float, slower_at: float, seed: int) -> Ratio:
    clock = Clock(speed=lambda now: 1.2 if now > slower_at else 1.0)
    drawings, _, _ = scripted({"a": truth * 2e-3, "b": 2e-3}, 0.01, clock, seed)
    settings = TimingSettings(precision=1e-9, budget_s=0.5)
    times = time_together(drawings, settings, WALL, seed=seed, clock=clock)
    return compute_paired_ratio(times["a"].samples_s, times["b"].samples_s)


@pytest.mark.parametrize("slower_at", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("truth", [0.97, 1.03])
def test_a_machine_that_slows_down_by_a_fifth_does_not_change_a_verdict(slower_at, truth):
    ratio = time_pair_on_slowing_machine(truth, slower_at, seed=0)
    assert ratio.verdict == ("faster" if truth < 1 else "slower")
    assert ratio.value == pytest.approx(truth, abs=0.005)


def test_drift_alone_is_not_significant():
    verdicts = [time_pair_on_slowing_machine(1.0, 0.5, seed).verdict for seed in range(100)]
    assert verdicts.count("not significant") >= 92


class TimedBy:
    """A draw of 1 ms by the wall clock, of `gpu` seconds by the GPU timer."""

    def __init__(self, gpu: float | None) -> None:
        self.gpu = gpu

    def sample(self, repeats: int) -> Sample:
        return Sample(repeats * 1e-3, None if self.gpu is None else repeats * self.gpu)


@pytest.mark.parametrize(
    ("gpu", "timer"),
    [(1.0e-3, "gpu"), (0.8e-3, "gpu"), (7e-6, "wall"), (2e-3, "wall"), (None, "wall")],
)
def test_the_gpu_timer_is_used_only_if_the_wall_clock_agrees(gpu, timer):
    test = select_timer(TimedBy(gpu))
    assert test.timer == timer
    assert test.wall_s == pytest.approx(1e-3)
    assert test.gpu_s == (None if gpu is None else pytest.approx(gpu))
    assert timer != "gpu" or test.resolution_s == 1e-9
    drawings = {name: TimedBy(gpu) for name in (EMPTY, REFERENCE, "a")}
    settings = TimingSettings(budget_s=0.001, warm_up_s=0.0)
    samples = time_together(drawings, settings, test)["a"].samples_s
    assert samples == pytest.approx([gpu if timer == "gpu" else 1e-3] * len(samples))


class Computed:
    """A draw of 1 ms: shares of computing and, in every other draw, of waiting."""

    def __init__(self, cpu: float | None, waited: float | None) -> None:
        self.told = cycle([(cpu, waited), (cpu, waited and 0.0)])

    def sample(self, repeats: int) -> Sample:
        shares = next(self.told)
        cpu, waited = (None if share is None else repeats * 1e-3 * share for share in shares)
        return Sample(repeats * 1e-3, cpu=cpu, waited=waited)


@pytest.mark.parametrize(
    ("cpu", "waited", "timer"),
    [(0.9, 0.0, "cpu"), (0.6, None, "cpu"), (0.4, None, "wall"), (0.25, 0.25, "cpu")]
    + [(0.1, 0.3, "wall"), (None, 0.9, "wall"), (0.0, 0.9, "cpu")],
)
def test_the_cpu_timer_is_used_if_it_accounts_for_the_draw(cpu, waited, timer):
    test = select_timer(Computed(cpu, waited), software=True)
    assert test.timer == timer
    assert test.cpu_s == (None if cpu is None else pytest.approx(1e-3 * cpu))
    assert select_timer(Computed(cpu, waited)).timer == "wall"


def test_cpu_times_include_wall_times():
    by_cpu, by_wall = Times(repeats=2), Times(repeats=2)
    for sample in (Sample(4.0, cpu=2.0, waited=1.0), Sample(6.0)):
        by_cpu.add(sample, "cpu")
        by_wall.add(sample, "wall")
    assert (by_cpu.samples_s, by_cpu.wall_s, by_cpu.waited_s) == ([1.0, 3.0], [2.0, 3.0], [0.5])
    assert (by_wall.samples_s, by_wall.wall_s, by_wall.waited_s) == ([2.0, 3.0], [], [])


@pytest.mark.parametrize("others", [2.0, -2.0])
def test_steal_and_other_load_are_measured_over_the_rounds(monkeypatch, others):
    drawings, clock, _ = scripted({"a": 2e-3})
    clock.now = 7.0
    monkeypatch.setattr("harness.machine.system.read_steal_time_s", lambda: 3.0 + 0.5 * clock())
    monkeypatch.setattr(
        "harness.machine.system.read_other_processes_s", lambda: 7.0 + others * clock()
    )
    times = time_together(drawings, TimingSettings(), WALL, clock=clock)["a"]
    assert times.timing_s == pytest.approx(clock() - 7.0)
    assert times.stolen_s == pytest.approx(0.5 * times.timing_s)
    assert times.others_s == pytest.approx(max(0.0, others * times.timing_s))


class Renewed:
    """Drawings whose cost changes by some tenths of a per cent with each preparation."""

    def __init__(self, costs: dict[str, float], bias: float, noise: float, seed: int) -> None:
        self.orders: list[list[str]] = []
        self.log: list[str] = []
        self.clock = Clock()
        self._costs, self._noise, self._seed = costs, noise, seed
        self._bias = np.random.default_rng(seed).normal(0.0, bias, (1000, len(costs)))

    def __call__(self, order) -> dict[str, ScriptedDrawing]:
        number = len(self.orders)
        self.orders.append(list(order))
        self.log.append("renewed")
        costs = zip(self._costs.items(), 1 + self._bias[number], strict=True)
        options = (self.clock, self._noise, self.log, 1000 * self._seed + number)
        return {name: ScriptedDrawing(name, cost * bias, *options) for (name, cost), bias in costs}

    def time(self, settings: TimingSettings, seed: int = 0):
        drawings = self(list(self._costs))
        return time_together(drawings, settings, WALL, seed=seed, clock=self.clock, renew=self)


def test_drawings_are_prepared_again_in_changing_order():
    renewed = Renewed({"a": 2e-3, "b": 3e-3, "c": 1e-3}, 0.0, 0.01, 1)
    times = renewed.time(TimingSettings(budget_s=0.5, warm_up_s=0.0))
    assert all(sorted(order) == ["a", "b", "c"] for order in renewed.orders)
    assert len({tuple(order) for order in renewed.orders}) > 1
    epochs = times["a"].epochs
    assert len(epochs) == len(renewed.orders) >= 6
    assert min(epochs) >= 2
    assert {sum(epochs)} == {len(entry.samples_s) for entry in times.values()}
    # The first draw after preparing is not a sample.
    pieces = " ".join(renewed.log).split("renewed")[2:]
    assert [len(piece.split()) for piece in pieces] == [3 * (1 + n) for n in epochs[1:]]


@pytest.mark.parametrize("epochs", [1, 2])
def test_drawings_are_prepared_once_per_requested_epoch(epochs):
    renewed = Renewed({"a": 2e-3, "b": 3e-3}, 0.0, 0.01, 1)
    times = renewed.time(TimingSettings(budget_s=0.5, warm_up_s=0, min_share=1, epochs=epochs))
    assert len(renewed.orders) == len(times["a"].epochs) == epochs


@pytest.mark.parametrize(("limit_s", "rounds", "end_s"), [(26.0, 1, 26.0), (45.0, 2, 38.0)])
def test_the_time_limit_bounds_the_epochs(limit_s, rounds, end_s):
    """Warming up takes 9 s, a round 2 s, and a new epoch half a round more."""
    renewed = Renewed({"a": 0.5, "b": 0.5}, 0.0, 0.0, 2)
    renewed.clock.now = 1000.0
    settings = TimingSettings(budget_s=0.5, warm_up_s=0.0, min_batch_s=1.0, limit_s=limit_s)
    assert renewed.time(settings)["a"].epochs == [rounds] * 6
    assert renewed.clock.now == pytest.approx(1000.0 + end_s)
    far = Renewed({"a": 1.0, "b": 1.0}, 0.0, 0.0, 2)
    assert far.time(TimingSettings(budget_s=0.5, warm_up_s=0.0, limit_s=1.0))["a"].epochs == [1]


def test_a_distant_limit_has_no_effect():
    one, other = (Renewed({"a": 2e-3, "b": 3e-3}, 0.0, 0.01, 2) for _ in range(2))
    settings = TimingSettings(budget_s=0.5)
    assert one.time(settings) == other.time(replace(settings, limit_s=60.0))


@pytest.mark.parametrize("budget_s", [0.3, 3.0])
def test_equal_drawings_rarely_differ_significantly(budget_s):
    """The position of buffers causes 0.2 %, which rounds do not average out."""
    settings = TimingSettings(budget_s=budget_s, precision=1e-9, min_share=1.0, warm_up_s=0.0)
    wrong, fooled = 0, 0
    for seed in range(100):
        renewed = Renewed({"a": 5e-3, "b": 5e-3}, 0.002, 0.01, seed)
        times = renewed.time(settings, seed)
        a, b = times["a"], times["b"]
        assert a.epochs[0] < len(a.samples_s)
        ratio = compute_paired_ratio(a.samples_s, b.samples_s, a.epochs)
        wrong += ratio.verdict != "not significant"
        # a single epoch of the same length
        fixed = Renewed({"a": 5e-3, "b": 5e-3}, 0.002, 0.01, seed)
        times = time_together(fixed(["a", "b"]), settings, WALL, seed=seed, clock=fixed.clock)
        ratio = compute_paired_ratio(times["a"].samples_s, times["b"].samples_s)
        fooled += ratio.verdict != "not significant"
    assert wrong <= 10
    assert fooled >= 2 * wrong + (0 if budget_s < 1 else 20)


def test_one_per_cent_is_detected_over_epochs():
    settings = TimingSettings(budget_s=2.0, precision=1e-9, warm_up_s=0.0)
    slower = 0
    for seed in range(40):
        times = Renewed({"a": 5e-3, "b": 5.05e-3}, 0.002, 0.01, seed).time(settings, seed)
        a, b = times["a"], times["b"]
        slower += compute_paired_ratio(b.samples_s, a.samples_s, a.epochs).verdict == "slower"
    assert slower >= 38


def test_intervals_over_epochs_are_students():
    rng = np.random.default_rng(3)
    epochs = [5, 9, 4, 7, 6, 8]
    samples, base = rng.lognormal(0.0, 0.01, sum(epochs)), np.ones(sum(epochs))
    ratio = compute_paired_ratio(samples, base, epochs)
    medians = [np.median(part) for part in np.split(np.log(samples), np.cumsum(epochs)[:-1])]
    expected = t.interval(0.95, len(epochs) - 1, np.mean(medians), sem(medians))
    assert (ratio.low, ratio.high) == pytest.approx(np.exp(expected))
    assert ratio.value == pytest.approx(np.exp(np.mean(medians)))
    assert ratio.rounds == sum(epochs)


@pytest.mark.parametrize("epochs", [None, [], [36], [12, 12, 12], [1, 2, 3, 4]])
def test_few_or_invalid_epochs_fall_back_to_rounds(epochs):
    samples = np.random.default_rng(4).lognormal(0.0, 0.01, 36)
    ratio = compute_paired_ratio(samples, np.ones(36), epochs)
    assert (ratio.low, ratio.high) == compute_median_interval(samples.tolist())


class ScriptedSeconds:
    """A drawing whose seconds per draw are a function of the number; notes the repeats."""

    def __init__(self, seconds: Callable[[int], float]) -> None:
        self.clock = Clock()
        self.repeats: list[int] = []
        self._seconds = seconds

    def sample(self, repeats: int) -> Sample:
        cost = self._seconds(len(self.repeats))
        self.repeats.append(repeats)
        return Sample(wall=self.clock.spend(cost * repeats))

    def time(self, **settings: Any) -> Times:
        timing = TimingSettings(warm_up_s=0.0, **settings)
        return time_together({"a": self}, timing, WALL, clock=self.clock)["a"]


@pytest.mark.parametrize(
    ("seconds", "tried"),
    [(0.02, [1]), (0.009, [1, 2, 4]), (0.0, [2**power for power in range(17)])],
)
def test_the_self_test_draws_for_a_fiftieth_of_a_second(seconds, tried):
    """The test ends after 65,536 draws if these take no time; it is repeated five times."""
    draw = ScriptedSeconds(lambda _: seconds)
    assert select_timer(draw).timer == "wall"
    assert draw.repeats == tried + [tried[-1]] * 5


def test_clock_resolution_is_the_smallest_step(monkeypatch):
    """The clock returns each time thrice, and advances by 3 and 1 in turns."""
    ends = accumulate(cycle([3.0, 1.0]))
    ticks = chain.from_iterable([end] * 3 for end in ends)
    with monkeypatch.context() as patch:
        patch.setattr("harness.measuring.timing.time.perf_counter", lambda: next(ticks))
        assert _measure_resolution(time.perf_counter) == 1.0


@pytest.mark.parametrize(
    ("seconds", "repeats"),
    [
        (2.0**-20, [1, 8, 64, 512] + [1228] * 4),
        (0.0, [8**k for k in range(7)] + [8**7] * 3),
        (0.9 * 2.0**-10, [1] + [2] * 4),
    ],
)
def test_batches_grow_by_a_draw_to_eightfold(seconds, repeats):
    """1.2 batches are the target; a million draws are the maximum if draws take no time."""
    draw = ScriptedSeconds(lambda _: seconds)
    assert _warm_up(draw, 2.0**-10, 0.0, "wall", draw.clock) == (repeats[-1], seconds)
    assert draw.repeats == repeats


@pytest.mark.parametrize(
    ("seconds", "limit_s", "draws"),
    [
        (lambda number: 1.0, 1e9, 1 + 3 + 3),
        (lambda number: 100.0 if number < 4 else 50.0 if number < 7 else 51.0, 1e9, 1 + 3 + 3 + 3),
        (lambda number: 1.0 + (number + 2) // 3 % 2, 10.0, 1 + 3 + 3),
    ],
    ids=["steady", "within two per cent at last", "never"],
)
def test_warm_up_ends_when_times_are_stable(seconds, limit_s, draws):
    draw = ScriptedSeconds(seconds)
    _warm_up(draw, 1.0, limit_s, "wall", draw.clock)
    assert draw.repeats == [1] * draws


def test_rounds_end_when_the_budget_or_its_minimum_share_is_spent():
    """Warming up takes 1 s, a round a quarter; the sixteenth round is not checked, the last is."""
    entry = ScriptedSeconds(lambda _: 0.25).time(precision=-1.0, budget_s=5.25, min_share=0.0)
    assert len(entry.samples_s) == 17
    assert not entry.precision_reached
    entry = ScriptedSeconds(lambda _: 0.25).time(budget_s=8.0, min_share=0.5)
    assert len(entry.samples_s) == MIN_ROUNDS


@pytest.mark.parametrize(("slow", "rounds"), [(3, 15), (4, 18)])
def test_precision_is_checked_after_an_eighth_more_rounds(slow, rounds):
    """3 of 15 and 4 of 17 rounds may be slow; after 16, two more rounds follow."""
    draw = ScriptedSeconds(lambda number: 2.0 if 4 <= number < 4 + slow else 1.0)
    entry = draw.time(precision=0.0, budget_s=100.0, min_share=0.0)
    assert len(entry.samples_s) == rounds
    assert entry.precision_reached


def test_the_noisiest_drawing_determines_the_rounds():
    drawings, clock, _ = scripted({"a": 2e-3})
    drawings["b"] = ScriptedDrawing("b", 2e-3, clock, noise=0.05)
    times = time_together(drawings, UNTIL_PRECISE, WALL, clock=clock)
    assert times["b"].precision_reached
    assert len(times["a"].samples_s) > MIN_ROUNDS


@pytest.mark.parametrize("second", [1.0, 1 / 16])
def test_epochs_divide_the_budget_evenly(second):
    """A round takes a quarter of a second, warming up a second, and preparation a round."""
    renewed = Renewed({"a": 0.25 * second}, 0.0, 0.0, 1)
    settings = TimingSettings(budget_s=7 * second, min_share=1.0, warm_up_s=0.0)
    assert renewed.time(settings)["a"].epochs == [4, 3, 3, 3, 3, 3]


def test_slow_preparation_does_not_reduce_epochs():
    class Slowly(Renewed):
        def __call__(self, order):
            self.clock.spend(4.0)
            return super().__call__(order)

    renewed = Slowly({"a": 1 / 16}, 0.0, 0.0, 1)
    first, *later_epochs = renewed.time(TimingSettings(budget_s=8.0, min_share=1.0))["a"].epochs
    assert first >= MIN_ROUNDS
    assert later_epochs == [2] * 5


def test_times_of_processes_are_concatenated():
    parts = [Times(3, [1.0, 2.0], [1, 1], True), Times(5, [3.0], [1], False)]
    assert Times.concatenate(parts) == Times(3, [1.0, 2.0, 3.0], [1, 1, 1], False, [2, 1])
    assert Times.concatenate(parts[:1]) == parts[0]


def compared_precisely(samples: dict[str, list[float]], precision: float) -> list[str]:
    times = {name: Times(1, drawing_samples) for name, drawing_samples in samples.items()}
    settings = TimingSettings(precision=precision)
    return list(_find_precise(times, list(samples), settings, []))


def test_precision_of_ratios_is_the_half_width():
    """Of three drawings, the ratio of the unsteady one moves twice as far as the others."""
    wide, level = [1.0] * 6 + [1.015**2, 1.015] * 3, [1.0] * 12
    samples = {"wide": wide, "level": level, "as level": level}
    together = np.prod(list(samples.values()), axis=0) ** (1 / 3)
    half = {}
    for name, drawing_samples in samples.items():
        ratio = compute_paired_ratio(drawing_samples, together)
        half[name] = (ratio.high - ratio.low) / 2 / ratio.value
    assert half["wide"] > 1.5 * half["level"] > 0.0
    for precision in half.values():
        for share in (0.99, 1.01):
            names = [name for name in samples if half[name] < share * precision]
            names += [REFERENCE] if len(names) == 3 else []
            assert compared_precisely(samples, share * precision) == names


def test_constant_ratios_are_precise_and_those_of_zero_are_not():
    steady = {"a": [1.0] * 8, "b": [2.0] * 8}
    assert compared_precisely(steady, 0.0) == ["a", "b", REFERENCE]
    with np.errstate(all="raise"):
        assert compared_precisely({"a": [1.0] * 8, "b": [0.0] + [1.0] * 7}, 1e9) == []
