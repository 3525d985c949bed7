"""The design timed on a device: the time of every draw in every epoch."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import Inconclusive, NothingMeasured
from harness.measuring.pool import Backend, MeasuringPool
from harness.measuring.records import waiting_of
from harness.measuring.timing import EMPTY, Times
from harness.profile.design import Draw
from harness.rasterisers.base import Options
from harness.settings import TimingSettings
from harness.stats.intervals import FEWEST_EPOCHS, Ratio, paired_ratio
from harness.stats.run_quality import judge

CONTROL = "(control)"
"""Name under which one draw of the design is drawn a second time."""

EPOCHS = 12
"""Each in a process of its own: in some, a draw takes half as long again as in most others."""

MOST_DRIFT = 1.5
"""Slowest in ratio to fastest epoch beyond which a machine was not in one state."""

MOST_APART = 0.03
"""By which the control's two times may differ; equal drawings differ by where their buffers lie."""


@dataclass(frozen=True)
class Measured:
    """The seconds of each draw of a design.

    epochs : (e, k) times of each of k draws in each of e epochs, with what all draws of a round
        have in common, the machine's speed, made equal
    drift : the slowest epoch's mean time in ratio to the fastest one's
    empty : median time of a draw of nothing
    control : one draw in ratio to itself under another name
    rounds : of each epoch
    disturbed : what the machine's state was, if it was not quiet, else ""
    """

    epochs: NDArray[np.float64]
    drift: float
    empty: float
    control: Ratio
    rounds: list[int]
    disturbed: str = ""

    @property
    def times(self) -> NDArray[np.float64]:
        """The time of each draw, (k,)."""
        return np.asarray(np.exp(np.log(self.epochs).mean(axis=0)))

    @property
    def trouble(self) -> str:
        """Why the times cannot be trusted; "" where nothing is wrong."""
        if self.disturbed:
            return self.disturbed
        if self.drift > MOST_DRIFT:
            return f"the machine's speed changed by a factor of {self.drift:.2f} meanwhile"
        apart = min(abs(self.control.low - 1.0), abs(self.control.high - 1.0))
        if not self.control.low <= 1.0 <= self.control.high and apart > MOST_APART:
            return f"one draw under two names took {self.control.value:.3f} times its own time"
        return ""


LIMIT_S = 100.0
"""Seconds after which a slow device's rounds end, or twice the budget if that is more."""


def settings(budget_s: float, draws: int) -> TimingSettings:
    """Return how a profile of so many draws is timed: `budget_s` a draw, in `EPOCHS` epochs."""
    return TimingSettings(
        precision=1e-4,  # never reached: every profile has the same rounds for its seconds
        budget_s=budget_s / EPOCHS,
        min_batch_s=2e-3,
        warm_up_s=0.005,
        least_share=1.0,
        paired=False,
        epochs=1,
        processes=EPOCHS,
        limit_s=max(LIMIT_S, 2 * budget_s * draws),
    )


def measure(
    backend: Backend,
    pool: MeasuringPool,
    draws: Sequence[Draw],
    timing: TimingSettings,
    seed: int,
    tick: Callable[[float], None] | None = None,
) -> Measured:
    """Time all draws together, in interleaved rounds, with the empty draw and a control.

    Raises
    ------
    NothingMeasured
        if the device fails under one of them
    Inconclusive
        if it is too slow to tell anything in time
    HarnessError
        if it cannot be opened
    """
    names = [str(number) for number in range(len(draws))]
    candidates = {
        name: (draw.frame, draw.triangles, Options(work=draw.work))
        for name, draw in zip(names, draws, strict=True)
    }
    candidates[CONTROL] = candidates[names[len(names) // 2]]
    groups, failures = pool.time(backend, candidates, timing, seed, tick)
    if failures:
        raise NothingMeasured(f"{backend.label}: {next(iter(failures.values()))}")
    times = next(iter(groups.values()))
    epochs = len(times[EMPTY].epochs)
    if epochs < FEWEST_EPOCHS:
        raise Inconclusive(
            f"{backend.label} is too slow: {timing.limit_s:g} s were over after {epochs} of "
            f"{EPOCHS} parts, and {FEWEST_EPOCHS} tell a law; draw longer, e.g. --budget 4"
        )
    found = of_times(times, names)
    state = judge(
        {
            "rasteriser": backend.rasteriser,
            "device": backend.device.name,
            "scene": "the design",
            "triangulator": name,
            "time": {
                "timer": "cpu" if each.wall_s else "wall",
                "samples_s": each.samples_s,
                "processes": each.processes,
                "stolen_s": each.stolen_s,
                "timing_s": each.timing_s,
                **waiting_of(each),
            },
        }
        for name, each in times.items()
        if name in names
    )
    why = f"the times are {state.state}: {'; '.join(state.why)}"
    return replace(found, disturbed="" if state.is_quiet else why)


def of_times(times: Mapping[str, Times], names: Sequence[str]) -> Measured:
    """Return what rounds say of the draws called `names`; all were timed together.

    A round's level is the geometric mean of its draws' times: what it has in common with the next
    round is the design, what differs is the machine's speed.
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
    return Measured(
        epochs=np.exp(of_epochs + speeds.mean()),
        drift=float(np.exp(np.ptp(speeds))),
        empty=float(times[EMPTY].median_s),
        control=paired_ratio(times[CONTROL].samples_s, times[middle].samples_s, first.epochs),
        rounds=list(first.epochs),
    )
