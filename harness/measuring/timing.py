"""Timing: clock selection, warm-up, interleaved sampling, stopping rule.

Drawings to compare are timed together, in rounds. Each round times every drawing once, in a new
random order, so that a machine that slows down affects all drawings; comparison within rounds
cancels the drift. Every round also times an empty draw and a reference triangle, which measure the
overhead and the speed of the machine.

The memory layout of a drawing's buffers changes times by some tenths of a per cent, and no number
of rounds averages that out. So the rounds are split into epochs, before which all drawings are
released and prepared again in another random order; the interval of a ratio follows from the
variation between epochs (`harness.metrics.statistics`). Sources: T. Kalibera and R. Jones,
"Rigorous benchmarking in reasonable time", ISMM 2013; T. Mytkowicz et al., "Producing wrong data
without doing anything obviously wrong!", ASPLOS 2009.
"""

import math
import random
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from harness.machine import system
from harness.metrics.run_quality import select_rounds
from harness.metrics.statistics import MIN_VALUES, compute_median_interval, compute_paired_ratio
from harness.rasterisers.base import Drawing, Sample
from harness.results.record import Time
from harness.settings import TimingSettings

Timer = Literal["gpu", "cpu", "wall"]

EMPTY = "(empty)"
REFERENCE = "(reference)"  # every round times these two drawings and the candidates

MIN_CPU_SHARE = 0.5
"""Minimum share of a large draw's wall time that this process spent on computing or on waiting for
a core; if the share is lower, another process draws."""

MAX_CPU_CLOCK_STEP_S = 1e-4  # coarser clocks would require too long batches

MAX_TIMER_DIFFERENCE = 0.30  # tolerated relative difference of GPU timer and wall clock

MAX_BATCHES = 10
"""Maximum duration of a batch, in usual batches: slow drawings get as many draws per batch as the
faster drawings that they are compared with, up to this limit."""

MIN_ROUNDS = 12  # minimum for a 95 % interval of the median narrower than the sample's range

EPOCH_ROUNDS = 2  # minimum number of rounds of an epoch: the 6 epochs by default have `MIN_ROUNDS`

Renew = Callable[[Sequence[str]], Mapping[str, Drawing]]
"""Function that releases all drawings, and prepares them again in the given order."""


@dataclass(frozen=True)
class TimerTest:
    """Result of the self-test: seconds of one large draw, None if a timer does not exist."""

    timer: Timer
    wall_s: float
    gpu_s: float | None
    resolution_s: float
    reason: str
    cpu_s: float | None = None


@dataclass
class Times:
    """Samples of a drawing: seconds per draw, a sample per round of `repeats` draws.

    wall_s, waited_s : per sample, wall time of the same draws, and time of waiting for a core; []
        if the CPU timer is not used or the system does not report waiting
    stolen_s, others_s, timing_s : during the timing, steal time of all cores, CPU time of all other
        processes, and wall time
    epochs, processes : rounds of each epoch, and of each process if there are several
    """

    repeats: int
    samples_s: list[float] = field(default_factory=list)
    epochs: list[int] = field(default_factory=list)
    precision_reached: bool = False
    processes: list[int] = field(default_factory=list)
    wall_s: list[float] = field(default_factory=list)
    waited_s: list[float] = field(default_factory=list)
    stolen_s: float = 0.0
    others_s: float = field(default=0.0, compare=False)
    timing_s: float = 0.0

    def add(self, sample: Sample, timer: Timer) -> None:
        """Add a batch of `repeats` draws as a sample."""
        self.samples_s.append(_get_seconds(sample, timer) / self.repeats)
        if timer == "cpu":
            self.wall_s.append(sample.wall / self.repeats)
            if sample.waited is not None:
                self.waited_s.append(sample.waited / self.repeats)

    @classmethod
    def concatenate(cls, parts: Sequence["Times"]) -> "Times":
        """Concatenate the times of one drawing in several processes."""
        return cls(
            repeats=parts[0].repeats,
            samples_s=[sample for part in parts for sample in part.samples_s],
            wall_s=[sample for part in parts for sample in part.wall_s],
            waited_s=[sample for part in parts for sample in part.waited_s],
            stolen_s=sum(part.stolen_s for part in parts),
            others_s=sum(part.others_s for part in parts),
            timing_s=sum(part.timing_s for part in parts),
            epochs=[rounds for part in parts for rounds in part.epochs],
            precision_reached=all(part.precision_reached for part in parts),
            processes=[len(part.samples_s) for part in parts] if len(parts) > 1 else [],
        )

    @property
    def undisturbed_s(self) -> list[float]:
        """Samples that did not wait for a core, or all samples if these are too few."""
        wall_s, waited_s = tuple(self.wall_s), tuple(self.waited_s)
        time = Time("", tuple(self.samples_s), wall_s, waited_s)
        rounds = select_rounds(time, time)
        return [sample for sample, quiet in zip(self.samples_s, rounds, strict=True) if quiet]

    @property
    def median_s(self) -> float:
        """Median of the undisturbed samples."""
        return statistics.median(self.undisturbed_s)

    @property
    def ci95_s(self) -> tuple[float, float]:
        """Distribution-free 95 % confidence interval of the median."""
        return compute_median_interval(self.undisturbed_s)

    def is_precise(self, precision: float) -> bool:
        """Return whether the interval's half-width is at most `precision` times the median.

        Fewer than `MIN_VALUES` samples have no 95 % interval.
        """
        low, high = self.ci95_s
        return len(self.samples_s) >= MIN_VALUES and (high - low) / 2 <= precision * self.median_s


def select_timer(big_draw: Drawing, *, software: bool = False) -> TimerTest:
    """Select the timer of a device by timing a large draw with all timers.

    Rasterisers on the CPU (`software`) are timed by the CPU time of all threads of the process, as
    the wall clock includes the time in which other programs use the core. A GPU timer is selected
    only if it agrees with the wall clock, as some drivers time only a part of the work.
    """
    repeats = 1
    while big_draw.sample(repeats).wall < 0.02 and repeats < 1 << 16:
        repeats *= 2
    samples = [big_draw.sample(repeats) for _ in range(5)]
    wall = statistics.median(sample.wall for sample in samples) / repeats
    resolution = _measure_resolution(time.perf_counter)
    cpu_samples = [sample.cpu for sample in samples if sample.cpu is not None]
    if software and len(cpu_samples) == len(samples):
        cpu = statistics.median(cpu_samples) / repeats
        step = _measure_resolution(time.process_time)
        detail = f"{cpu * 1e3:.3f} ms of a draw that took {wall * 1e3:.3f} ms"
        if step > MAX_CPU_CLOCK_STEP_S:
            reason = f"the CPU clock's steps of {step * 1e3:.3g} ms are too coarse"
        elif any(
            cpu_s + (sample.waited or 0.0) >= MIN_CPU_SHARE * sample.wall
            for cpu_s, sample in zip(cpu_samples, samples, strict=True)
        ):
            reason = f"the process computed for {detail}"
            return TimerTest("cpu", wall, None, step, reason, cpu)
        else:
            reason = f"the process computed for only {detail}"
        return TimerTest("wall", wall, None, resolution, reason, cpu)
    gpu_samples = [sample.gpu for sample in samples if sample.gpu is not None]
    if not gpu_samples:
        return TimerTest("wall", wall, None, resolution, "the device has no GPU timer")
    gpu = statistics.median(gpu_samples) / repeats
    difference = abs(gpu - wall) / wall
    detail = f"{gpu * 1e3:.3f} ms of a draw that took {wall * 1e3:.3f} ms"
    if difference > MAX_TIMER_DIFFERENCE:
        reason = f"the driver's GPU timer disagrees: {detail}"
        return TimerTest("wall", wall, gpu, resolution, reason)
    return TimerTest("gpu", wall, gpu, 1e-9, f"the GPU timer saw {detail}")


def time_together(
    drawings: Mapping[str, Drawing],
    settings: TimingSettings,
    test: TimerTest,
    *,
    seed: int = 0,
    clock: Callable[[], float] = time.perf_counter,
    renew: Renew | None = None,
) -> dict[str, Times]:
    """Time all `drawings` in shuffled, interleaved rounds.

    The rounds end when each drawing's interval, of the median or of the ratio to the other
    drawings, is narrow enough and the minimum share of the budget is spent; or when the budget,
    `settings.budget_s` per drawing, is spent, but with `renew` not before `settings.epochs` epochs.
    `settings.limit_s` ends the rounds in any case.
    """
    start, stolen_s, others_s = clock(), system.read_steal_time_s(), system.read_other_processes_s()
    batch = max(settings.min_batch_s, 100 * test.resolution_s)
    times: dict[str, Times] = {}
    draw_s: dict[str, float] = {}
    for name, drawing in drawings.items():
        repeats, draw_s[name] = _warm_up(drawing, batch, settings.warm_up_s, test.timer, clock)
        times[name] = Times(repeats)
    compared = [name for name in drawings if name not in (EMPTY, REFERENCE)]
    if settings.paired and compared:
        max_repeats = max(times[name].repeats for name in compared)
        for name in compared:
            fits = int(MAX_BATCHES * batch / max(draw_s[name], 1e-12))
            times[name].repeats = min(max_repeats, max(times[name].repeats, fits))
    order = list(drawings)
    shuffler = random.Random(seed)
    budget_s = settings.budget_s * len(drawings)
    earliest, deadline = start + settings.min_share * budget_s, start + budget_s
    latest = math.inf if settings.limit_s is None else start + settings.limit_s
    # On a slow device, epochs that would not fit before the limit have a single round, as rounds of
    # different epochs are more informative than rounds of one epoch.
    round_s = sum(times[name].repeats * draw_s[name] for name in drawings)
    slow = settings.epochs * (EPOCH_ROUNDS + 1) * round_s > latest - clock()
    min_epochs, warm_at = settings.epochs if renew else 1, clock()
    epoch_s = max(0.0, earliest - warm_at) / min_epochs
    min_rounds = 1 if slow else EPOCH_ROUNDS
    epochs = _Epochs(renew, min_epochs, min_rounds, epoch_s, warm_at + epoch_s, clock)
    check_at = MIN_ROUNDS
    while True:
        if epochs.is_over():
            shuffler.shuffle(order)
            drawings = epochs.begin(order)
        shuffler.shuffle(order)
        for name in order:
            times[name].add(_sample(name, drawings[name], times[name].repeats), test.timer)
        epochs.rounds[-1] += 1
        rounds = len(times[order[0]].samples_s)
        over = clock() >= latest
        if not over and (rounds < MIN_ROUNDS or clock() < earliest or epochs.needs_more()):
            continue
        if over or rounds >= check_at or clock() >= deadline:
            # Intervals are computed at growing steps, as their cost grows with the rounds.
            check_at = rounds + max(1, rounds // 8)
            # The time of the empty draw is mostly noise, so its precision never prolongs timing.
            precise = {EMPTY, *_find_precise(times, compared, settings, epochs.rounds)}
            for name, entry in times.items():
                entry.precision_reached = name in precise or entry.is_precise(settings.precision)
            if (
                over
                or clock() >= deadline
                or all(entry.precision_reached for entry in times.values())
            ):
                for entry in times.values():
                    entry.epochs = list(epochs.rounds)
                    entry.stolen_s = system.read_steal_time_s() - stolen_s
                    entry.others_s = max(0.0, system.read_other_processes_s() - others_s)
                    entry.timing_s = clock() - start
                return times


def _sample(name: str, drawing: Drawing, repeats: int) -> Sample:
    """Time draws; an untimed draw frees the reference of effects of the previous drawing."""
    if name == REFERENCE:
        drawing.sample(1)
    return drawing.sample(repeats)


@dataclass
class _Epochs:
    """Schedule of epochs; at the beginning of each, the drawings are prepared again.

    seconds, until : planned duration of an epoch; time before which the current one does not end
    """

    renew: Renew | None
    min_epochs: int
    min_rounds: int
    seconds: float
    until: float
    clock: Callable[[], float]
    rounds: list[int] = field(default_factory=lambda: [0])

    def is_over(self) -> bool:
        """Return whether the next epoch is due."""
        long_enough = self.rounds[-1] >= self.min_rounds and self.clock() >= self.until
        return self.min_epochs > 1 and long_enough

    def begin(self, order: Sequence[str]) -> Mapping[str, Drawing]:
        """Return the drawings of the next epoch, prepared in the given order."""
        assert self.renew is not None
        drawings = self.renew(order)
        for name in order:
            drawings[name].sample(1)  # the first draw is slower
        self.rounds.append(0)
        self.until = max(self.until + self.seconds, self.clock())
        return drawings

    def needs_more(self) -> bool:
        """Return whether more epochs, or more rounds of the current one, are required."""
        return len(self.rounds) < self.min_epochs or self.rounds[-1] < self.min_rounds


def _find_precise(
    times: Mapping[str, Times],
    compared: Sequence[str],
    settings: TimingSettings,
    epochs: Sequence[int],
) -> Sequence[str]:
    """Return the names of drawings whose ratio to the geometric mean of `compared` is precise.

    Ratios become precise even while the machine drifts. The reference draw shows that drift, so its
    median may never become precise; it counts as precise if all ratios are.
    """
    if not settings.paired or len(compared) < 2:
        return ()
    samples = np.array([times[name].samples_s for name in compared])
    if not (samples > 0.0).all():
        return ()
    mean_samples = np.exp(np.log(samples).mean(axis=0))
    ratios = [
        compute_paired_ratio(drawing_samples, mean_samples, epochs) for drawing_samples in samples
    ]
    precise = [ratio.high - ratio.low <= 2 * settings.precision * ratio.value for ratio in ratios]
    names = [name for name, is_precise in zip(compared, precise, strict=True) if is_precise]
    return [*names, REFERENCE] if all(precise) else names


def _warm_up(
    drawing: Drawing, batch_s: float, limit_s: float, timer: Timer, clock: Callable[[], float]
) -> tuple[int, float]:
    """Draw until times are stable or time is up; return draws per batch, and seconds per draw."""
    deadline = clock() + limit_s
    repeats = 1
    while (seconds := _get_seconds(drawing.sample(repeats), timer)) < batch_s:
        # Aim at 1.2 times `batch_s`, but do not extrapolate a short sample more than eightfold.
        factor = 1.2 * batch_s / seconds if seconds > 0 else math.inf
        repeats = max(repeats + 1, int(repeats * min(factor, 8.0)))
        if repeats > 1 << 20:
            break
    recent = [_get_seconds(drawing.sample(repeats), timer) for _ in range(3)]
    while clock() < deadline:
        newer = [_get_seconds(drawing.sample(repeats), timer) for _ in range(3)]
        before, after = statistics.median(recent), statistics.median(newer)
        if abs(after - before) <= 0.02 * before:
            break
        recent = newer
    return repeats, statistics.median(recent) / repeats


def _get_seconds(sample: Sample, timer: Timer) -> float:
    """Return the sample's seconds by `timer`, or by the wall clock if there are none."""
    if timer == "gpu" and sample.gpu is not None:
        return sample.gpu
    if timer == "cpu" and sample.cpu is not None:
        return sample.cpu
    return sample.wall


def _measure_resolution(clock: Callable[[], float]) -> float:
    steps = []
    for _ in range(20):
        first = clock()
        while (second := clock()) <= first:
            pass
        steps.append(second - first)
    return min(steps)
