"""Times of the design on a device: each draw in each epoch."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import InconclusiveError, NothingMeasuredError
from harness.measuring.pool import Backend, MeasuringPool
from harness.measuring.records import make_time_without_median
from harness.measuring.timing import EMPTY, Times
from harness.metrics.run_quality import assess_times
from harness.metrics.statistics import MIN_EPOCHS, Ratio, compute_paired_ratio
from harness.profile.placing import Draw
from harness.rasterisers.base import Options
from harness.results.record import Time
from harness.settings import TimingSettings

CONTROL = "(control)"  # name of the second copy of one draw of the design
EPOCHS = 12  # each in a separate process: in some a draw takes 1.5 times as long
MAX_DRIFT = 1.5  # tolerated ratio of the slowest to the fastest epoch

# Tolerated relative difference of the two copies of one draw: memory layout makes them differ.
MAX_CONTROL_DIFFERENCE = 0.03


@dataclass(frozen=True)
class DrawTimes:
    """Seconds of each draw of a design.

    epochs : (e, k) times of k draws in e epochs, normalised by the machine's speed in each round
    drift : mean time of the slowest epoch relative to the fastest
    empty : median time of an empty draw
    control : ratio of one draw to its copy
    disturbed : state of the machine if it was not quiet, or ""
    """

    epochs: NDArray[np.float64]
    drift: float
    empty: float
    control: Ratio
    rounds: list[int]
    disturbed: str = ""

    @property
    def times(self) -> NDArray[np.float64]:
        """Geometric mean time of each draw, (k,)."""
        return np.asarray(np.exp(np.log(self.epochs).mean(axis=0)))

    @property
    def unreliable_reason(self) -> str:
        """Reason why the times are unreliable, or ""."""
        if self.disturbed:
            return self.disturbed
        if self.drift > MAX_DRIFT:
            return f"the machine's speed changed by a factor of {self.drift:.2f} during the rounds"
        apart = min(abs(self.control.low - 1.0), abs(self.control.high - 1.0))
        if not self.control.low <= 1.0 <= self.control.high and apart > MAX_CONTROL_DIFFERENCE:
            factor = f"{self.control.value:.3f}"
            return f"the same draw, timed under two names, differs by a factor of {factor}"
        return ""


MIN_LIMIT_S = 100.0  # of all rounds; the limit is twice the total budget if that is longer


def make_profile_timing(budget_s: float, draws: int) -> TimingSettings:
    """Return the timing of a profile: `budget_s` per draw, in `EPOCHS` epochs."""
    return TimingSettings(
        precision=1e-4,  # never reached, so that the budget alone determines the rounds
        budget_s=budget_s / EPOCHS,
        min_batch_s=2e-3,
        warm_up_s=0.005,
        min_share=1.0,
        paired=False,
        epochs=1,
        processes=EPOCHS,
        limit_s=max(MIN_LIMIT_S, 2 * budget_s * draws),
    )


def measure_draws(
    backend: Backend,
    pool: MeasuringPool,
    draws: Sequence[Draw],
    timing: TimingSettings,
    seed: int,
    tick: Callable[[float], None] | None = None,
) -> DrawTimes:
    """Time all draws in interleaved rounds, with an empty draw and a second copy of one draw.

    Raises NothingMeasuredError if the device fails, InconclusiveError if it is too slow.
    """
    names = [str(number) for number in range(len(draws))]
    candidates = {
        name: (draw.frame, draw.triangles, Options(work=draw.work))
        for name, draw in zip(names, draws, strict=True)
    }
    candidates[CONTROL] = candidates[names[len(names) // 2]]
    groups, failures = pool.time_drawings(backend, candidates, timing, seed, tick)
    if failures:
        raise NothingMeasuredError(f"{backend.label}: {next(iter(failures.values()))}")
    times = next(iter(groups.values()))
    epochs = len(times[EMPTY].epochs)
    if epochs < MIN_EPOCHS:
        raise InconclusiveError(
            f"{backend.label}: too slow ({epochs} of {EPOCHS} epochs in {timing.limit_s:g} s, "
            f"and a fit needs {MIN_EPOCHS}); increase the budget, e.g. --budget 4"
        )
    result = normalise_times(times, names)
    state = assess_times((backend.label, f"draw {name}", _make_time(times[name])) for name in names)
    why = f"the times are {state.state}: {'; '.join(state.why)}"
    return replace(result, disturbed="" if state.is_quiet else why)


def normalise_times(times: Mapping[str, Times], names: Sequence[str]) -> DrawTimes:
    """Return the normalised times of the draws `names`, which were timed together.

    A round's level, the geometric mean of its draws' times, differs by the machine's speed only.
    """
    first: Any = times[names[0]]
    samples = np.array([times[name].samples_s for name in names])
    logs = np.log(np.maximum(samples, 1e-12))
    levels = logs.mean(axis=0)
    ends = np.cumsum(first.epochs)[:-1]
    relative = np.split(logs - levels, ends, axis=1)
    of_epochs = np.array([np.median(part, axis=1) for part in relative])
    speeds = np.array([part.mean() for part in np.split(levels, ends)])
    middle = names[len(names) // 2]
    return DrawTimes(
        epochs=np.exp(of_epochs + speeds.mean()),
        drift=float(np.exp(np.ptp(speeds))),
        empty=float(times[EMPTY].median_s),
        control=compute_paired_ratio(
            times[CONTROL].samples_s, times[middle].samples_s, first.epochs
        ),
        rounds=list(first.epochs),
    )


def _make_time(times: Times) -> Time:
    time = make_time_without_median(times, "cpu" if times.wall_s else "wall")
    return replace(time, stolen_s=times.stolen_s, timing_s=times.timing_s)
