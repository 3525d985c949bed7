"""Decide whether a run's timings were disturbed.

A CPU rasteriser is timed by the CPU time of its process, so a sample that waited for a core is not
longer for that, but its caches were lost meanwhile. Neighbours on the core or in its cache make all
draws longer and change their ratios, and nothing waits: only the reference draw of the same rounds
shows it, compared with the best of this machine (`harness.measuring.reference_draws`). The load
average does not show it, and no number of rounds averages it out.

If a run is not quiet, its times show nothing. Two versions that were timed in the same rounds are
exempt: the machine did the same to both.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from harness.results.record import Record, Time
from harness.results.run_folder import Run

State = Literal["quiet", "disturbed", "not to be trusted"]
QUIET: Final = "quiet"
DISTURBED: Final = "disturbed"
UNTRUSTED: Final = "not to be trusted"
STATES: tuple[State, ...] = get_args(State)
"""From the best to the worst."""

WAITED = 0.02
"""Share of its time that a sample may wait for a core and still count as undisturbed."""

SHORTEST = 0.1
"""Quantile of a drawing's samples whose wall clock, for its CPU time, is that of no disturbance."""

MIN_QUIET_ROUNDS = 12
"""Undisturbed rounds that are enough to leave the others out."""

FEW = 0.10
"""Share of samples that are disturbed on a quiet machine, too: the system has work of its own; of
drawings whose samples sit in two modes there; and of a core that other programs take."""

STOLEN = 0.05
"""The same of the time of a core that the host takes."""

SLOWER = 1.35
"""Reference draw over the best one up to which a machine is quiet, and ratios of times do not move:
the best for H against ear clipping, city at 1024 px on llvmpipe, 0.837 to 0.847 where the
reference draw took 0.70 to 0.92 ms, 0.862 and more from 1.06 ms on."""

MODE_SHARE, MODE_GAP, MODE_WIDTHS = 0.2, 1.1, 5.0
"""Two modes: each has so many of the samples; the upper is so many times the lower; and they are so
many standard deviations of their own apart. Halves of one normal distribution are 2.7 apart, of a
uniform one 3.5 (Ashman, Bird and Zepf, Astronomical Journal 108, 1994)."""

REMEDY = (
    "what is said rests on exact counters; measure again when nothing else runs, or let --beside "
    "compare two versions"
)


@dataclass(frozen=True)
class RunState:
    """State of the machine during a run, and the reasons, a clause each."""

    state: State
    why: tuple[str, ...] = ()

    @property
    def is_quiet(self) -> bool:
        """Whether the run's times can show anything."""
        return self.state == QUIET

    @property
    def words(self) -> list[str]:
        """A line about the state, or none if it is quiet."""
        if self.is_quiet:
            return []
        return [f"the run's times are {self.state}: {'; '.join(self.why)}. So {REMEDY}"]


def undisturbed(time: Time) -> NDArray[np.bool_]:
    """Return which (r,) samples waited for a core for at most `WAITED` of their time.

    All, if that is unknown. A thread that waits for another one of its process, as Vulkan's on the
    CPU do, lengthens nothing: the wait of a sample is limited to its wall clock beyond the shortest
    for its CPU time. Threads that run side by side need less wall clock.
    """
    samples, waited, wall = map(np.array, (time.samples_s, time.waited_s, time.wall_s))
    if len(waited) != len(samples):
        return np.ones(len(samples), np.bool_)
    if len(wall) == len(samples) > 0 and samples.all():
        shortest = min(1.0, float(np.quantile(wall / samples, SHORTEST)))
        waited = np.minimum(waited, wall - shortest * samples)
    quiet: NDArray[np.bool_] = waited <= WAITED * samples
    return quiet


def select_rounds(time: Time, base: Time) -> NDArray[np.bool_]:
    """Return which (r,) rounds a ratio rests on: those that disturbed neither, if enough are left.

    Raises
    ------
    ValueError
        if both are not of as many rounds
    """
    first, second = undisturbed(time), undisturbed(base)
    if len(first) != len(second):
        raise ValueError(f"{len(first)} and {len(second)} samples are not rounds of one group")
    quiet: NDArray[np.bool_] = first & second
    return quiet if quiet.sum() >= MIN_QUIET_ROUNDS else np.ones(len(quiet), np.bool_)


def two_modes(samples: Sequence[float] | NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the middles of the two modes that samples sit in, None where they have one.

    They are split where that leaves the least variance within (N. Otsu, IEEE Transactions on
    Systems, Man and Cybernetics 9, 1979), by logarithm.
    """
    values = np.asarray(samples, np.float64)
    logs = np.sort(np.log(values[values > 0]))
    count = len(logs)
    if count < MIN_QUIET_ROUNDS:
        return None
    least = int(np.ceil(MODE_SHARE * count))
    splits = np.arange(least, count - least + 1)
    sums, squares = np.cumsum(logs), np.cumsum(logs**2)
    below, above = sums[splits - 1] / splits, (sums[-1] - sums[splits - 1]) / (count - splits)
    within = squares[-1] - splits * below**2 - (count - splits) * above**2
    split = int(splits[np.argmin(within)])
    halves = logs[:split], logs[split:]
    low, high = (float(np.median(half)) for half in halves)
    width = np.sqrt((halves[0].var() + halves[1].var()) / 2)
    if high - low < max(np.log(MODE_GAP), MODE_WIDTHS * width):
        return None
    return float(np.exp(low)), float(np.exp(high))


def judge(
    times: Iterable[tuple[str, str, Time]], draws: Sequence[Mapping[str, Any]] = ()
) -> RunState:
    """Return the state of the machine during a run.

    times : label of the device, label of the drawing, and its times
    draws : the run's reference draws, as `run.json` has them (`reference_draws`)
    """
    problems: dict[str, State] = {}
    devices: dict[str, dict[str, Time]] = {}
    for device, drawing, time in times:
        devices.setdefault(device, {})[drawing] = time
    for device, drawings in devices.items():
        problems |= {f"{device}: {why}": state for why, state in _of_samples(drawings).items()}
    for draw in draws:
        if draw["slower"] > SLOWER:
            where = f"{draw['rasteriser']} on {draw['device']}, {draw['resolution']} px"
            took = f"{draw['reference_s'] * 1e3:.3g} ms, {draw['slower']:.2g} times the best"
            problems[f"{where}: the reference draw took {took} of this machine"] = DISTURBED
    return RunState(max(problems.values(), key=STATES.index, default=QUIET), tuple(problems))


def judge_records(records: Iterable[Record], draws: Sequence[Mapping[str, Any]] = ()) -> RunState:
    """Return the state of the machine while `records` were timed; see `judge`."""
    times = (
        (
            f"{record.id.rasteriser} on {record.id.device_name}",
            f"{record.name} of {record.id.scene}, {record.id.view.resolution} px",
            record.time,
        )
        for record in records
        if record.time is not None
    )
    return judge(times, draws)


def _of_samples(drawings: Mapping[str, Time]) -> dict[str, State]:
    """Return what disturbed the samples of a device's drawings: clause -> state."""
    problems: dict[str, State] = {}
    masks = {name: undisturbed(time) for name, time in drawings.items()}
    count = sum(len(quiet) for quiet in masks.values())
    waited = count - sum(int(quiet.sum()) for quiet in masks.values())
    others = [
        time.others_s / time.timing_s
        for time in drawings.values()
        if time.others_s is not None and time.timing_s
    ]
    # If nobody else computed, threads waited for those of their own process.
    if waited > FEW * count and max(others, default=math.inf) > FEW:
        few = any(quiet.sum() < min(MIN_QUIET_ROUNDS, len(quiet)) for quiet in masks.values())
        share = f"{waited} of {count} samples waited for a core"
        problems[share] = UNTRUSTED if few else DISTURBED
    bimodal: dict[str, State] = {}
    for name, time in drawings.items():
        samples, quiet = _level_processes(time), masks[name]
        if modes := two_modes(samples[quiet] if quiet.sum() >= MIN_QUIET_ROUNDS else samples):
            low, high = (f"{second * 1e3:.3g}" for second in modes)
            # CPU time has no mode of the scheduler's; other clocks take its slices for the draw's.
            state: State = DISTURBED if time.timer == "cpu" else UNTRUSTED
            bimodal[f"{name} ({low} and {high} ms)"] = state
    if len(bimodal) > FEW * len(drawings):
        first, *rest = bimodal
        more = f", and {len(rest)} more" if rest else ""
        worst = max(bimodal.values(), key=STATES.index)
        problems[f"times sit in two modes: {first}{more}"] = worst
    for time in drawings.values():
        stolen, wall = time.stolen_s or 0.0, time.timing_s or 0.0
        if stolen > STOLEN * wall > 0:
            problems[f"the host took {stolen / wall:.0%} of a core"] = DISTURBED
    return problems


def _level_processes(time: Time) -> NDArray[np.float64]:
    """Return (r,) samples with one median for all processes: a memory layout is not a mode."""
    samples = np.array(time.samples_s, np.float64)
    if len(time.processes) < 2 or sum(time.processes) != len(samples):
        return samples
    parts = np.split(samples, np.cumsum(time.processes)[:-1])
    return np.concatenate([part * np.median(samples) / np.median(part) for part in parts])


def state_of(run: Run) -> RunState:
    """Return the state that a run's `run.json` has, or else what its samples show."""
    stored = run.facts.get("state")
    if isinstance(stored, Mapping) and stored.get("state") in STATES:
        why = stored.get("why")
        reasons = why if isinstance(why, list | tuple) else ()
        return RunState(stored["state"], tuple(map(str, reasons)))
    return judge_records(run.records)


def explain_apart(base: Time, head: Time, *, machines_differ: bool) -> str:
    """Return why times of a case in two runs made apart cannot be compared; "" if they can.

    machines_differ : then reference draws differ for that
    """
    for name, time in (("BASE", base), ("HEAD", head)):
        if problems := _of_samples({"it": time}):
            return f"{name} was disturbed ({next(iter(problems))}); use run --beside"
    medians = [np.median(time.reference_s or [np.nan]) for time in (base, head)]
    for slow, fast in pairwise([*medians, medians[0]]):
        if slow > SLOWER * fast and not machines_differ:
            return (
                f"two states of the machine (reference draw {medians[0] * 1e3:.3g} ms in BASE, "
                f"{medians[1] * 1e3:.3g} ms in HEAD); use run --beside"
            )
    return ""
