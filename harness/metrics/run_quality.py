"""Decide whether a run's timings were disturbed.

A CPU rasteriser is timed by the CPU time of its process. Waiting for a core does not add to that
time, but the program that used the core meanwhile has replaced the content of the caches. Programs
that share the core or its caches also lengthen all draws and change their ratios without any
waiting. Only the reference draw of the same rounds, compared with the fastest on this machine
(`harness.measuring.records`), reveals this disturbance; the load average does not, and no
number of rounds averages the disturbance out.

Times of a disturbed run are not used, except for two versions timed in the same rounds, which are
affected equally.
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
STATES: tuple[State, ...] = get_args(State)  # from the best to the worst

MAX_WAITED_SHARE = 0.02  # of an undisturbed sample's time spent waiting for a core
UNDISTURBED_QUANTILE = 0.1  # of the samples' wall time per CPU time, taken as undisturbed
MIN_QUIET_ROUNDS = 12  # if there are fewer undisturbed rounds, disturbed ones are used as well

MAX_DISTURBED_SHARE = 0.10
"""Maximum of three shares on a quiet machine: the share of disturbed samples (the operating system
disturbs some), of drawings whose times have two modes, and of a core that other programs use."""

MAX_STOLEN_SHARE = 0.05  # of a core's time that the host takes from a quiet virtual machine

MAX_REFERENCE_RATIO = 1.35
"""Maximum, on a quiet machine, of the reference draw's time relative to the fastest one on this
machine. Up to there the ratios of other drawings are constant: H-optimal triangulations took 0.837
to 0.847 of the time of ear clipping (city at 1024 px on llvmpipe) in runs whose reference draw took
0.70 to 0.92 ms, and 0.862 or more from 1.06 ms on."""

MODE_SHARE, MODE_GAP, MODE_WIDTHS = 0.2, 1.1, 5.0
"""Criteria for two modes: minimum share of the samples in each, minimum ratio of the higher to the
lower median, and minimum distance of the medians in standard deviations of a mode. The halves of a
single normal distribution are 2.7 apart, those of a uniform distribution 3.5 (Ashman, Bird and
Zepf, Astronomical Journal 108, 1994)."""

REMEDY = (
    "results use exact counters; measure again on an idle machine, or compare two versions with "
    "--beside"
)


@dataclass(frozen=True)
class RunState:
    """State of the machine during a run; `why` has a clause for each disturbance."""

    state: State
    why: tuple[str, ...] = ()

    @property
    def is_quiet(self) -> bool:
        """Whether the run's times may be used."""
        return self.state == QUIET

    @property
    def warnings(self) -> list[str]:
        """A line about the state, or [] if the machine was quiet."""
        if self.is_quiet:
            return []
        return [f"the run's times are {self.state}: {'; '.join(self.why)}. Therefore {REMEDY}"]


def find_undisturbed(time: Time) -> NDArray[np.bool_]:
    """Return the (r,) mask of samples that waited at most `MAX_WAITED_SHARE`; all, if unknown.

    Threads of one process that wait for each other, as in Vulkan on the CPU, are not a disturbance.
    So waiting counts only up to the excess of the sample's wall time over that of an undisturbed
    sample with the same CPU time, which with parallel threads may be less than the CPU time.
    """
    samples, waited, wall = map(np.array, (time.samples_s, time.waited_s, time.wall_s))
    if len(waited) != len(samples):
        return np.ones(len(samples), np.bool_)
    if len(wall) == len(samples) > 0 and samples.all():
        shortest = min(1.0, float(np.quantile(wall / samples, UNDISTURBED_QUANTILE)))
        waited = np.minimum(waited, wall - shortest * samples)
    quiet: NDArray[np.bool_] = waited <= MAX_WAITED_SHARE * samples
    return quiet


def select_rounds(time: Time, base: Time) -> NDArray[np.bool_]:
    """Return the (r,) mask of rounds with both samples undisturbed, or of all if few are."""
    first, second = find_undisturbed(time), find_undisturbed(base)
    if len(first) != len(second):
        raise ValueError(f"{len(first)} and {len(second)} samples are not rounds of one group")
    quiet: NDArray[np.bool_] = first & second
    return quiet if quiet.sum() >= MIN_QUIET_ROUNDS else np.ones(len(quiet), np.bool_)


def find_two_modes(samples: Sequence[float] | NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the medians of the two modes of the samples, or None for a single mode.

    The sorted logarithms are split in two where the sum of the squared deviations within the parts
    is minimal (N. Otsu, IEEE Transactions on Systems, Man and Cybernetics 9, 1979).
    """
    values = np.asarray(samples, np.float64)
    logs = np.sort(np.log(values[values > 0]))
    count = len(logs)
    if count < MIN_QUIET_ROUNDS:
        return None
    minimum = int(np.ceil(MODE_SHARE * count))
    splits = np.arange(minimum, count - minimum + 1)
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


def assess_times(
    times: Iterable[tuple[str, str, Time]], draws: Sequence[Mapping[str, Any]] = ()
) -> RunState:
    """Return the state of the machine during a run.

    times : (label of the device, label of the drawing, its times) of each drawing
    draws : the run's reference draws, as in `run.json` (`reference_draws`)
    """
    problems: dict[str, State] = {}
    devices: dict[str, dict[str, Time]] = {}
    for device, drawing, time in times:
        devices.setdefault(device, {})[drawing] = time
    for device, drawings in devices.items():
        disturbances = _find_disturbances(drawings).items()
        problems |= {f"{device}: {why}": state for why, state in disturbances}
    for draw in draws:
        if draw["slower"] > MAX_REFERENCE_RATIO:
            device = f"{draw['rasteriser']} on {draw['device']}, {draw['resolution']} px"
            text = f"{draw['reference_s'] * 1e3:.3g} ms, {draw['slower']:.2g} times the fastest"
            problems[f"{device}: the reference draw took {text} on this machine"] = DISTURBED
    return RunState(max(problems.values(), key=STATES.index, default=QUIET), tuple(problems))


def assess_records(records: Iterable[Record], draws: Sequence[Mapping[str, Any]] = ()) -> RunState:
    """Return the state of the machine while `records` were timed; see `assess_times`."""
    times = (
        (
            f"{record.id.rasteriser} on {record.id.device_name}",
            f"{record.name} of {record.id.scene}, {record.id.view.resolution} px",
            record.time,
        )
        for record in records
        if record.time is not None
    )
    return assess_times(times, draws)


def _find_disturbances(drawings: Mapping[str, Time]) -> dict[str, State]:
    """Return a clause for each disturbance of a device's samples, with the implied state."""
    problems: dict[str, State] = {}
    masks = {name: find_undisturbed(time) for name, time in drawings.items()}
    count = sum(len(quiet) for quiet in masks.values())
    waited = count - sum(int(quiet.sum()) for quiet in masks.values())
    other_shares = [
        time.others_s / time.timing_s
        for time in drawings.values()
        if time.others_s is not None and time.timing_s
    ]
    # If other programs used little CPU time, threads of this process waited for each other, which
    # is no disturbance.
    is_busy = max(other_shares, default=math.inf) > MAX_DISTURBED_SHARE
    if is_busy and waited > MAX_DISTURBED_SHARE * count:
        has_few = any(quiet.sum() < min(MIN_QUIET_ROUNDS, len(quiet)) for quiet in masks.values())
        share = f"{waited} of {count} samples waited for a core"
        problems[share] = UNTRUSTED if has_few else DISTURBED
    bimodal: dict[str, State] = {}
    for name, time in drawings.items():
        samples, quiet = _equalise_process_medians(time), masks[name]
        if modes := find_two_modes(samples[quiet] if quiet.sum() >= MIN_QUIET_ROUNDS else samples):
            low, high = (f"{second * 1e3:.3g}" for second in modes)
            # Other clocks include the time slices of other programs, so their times are untrusted.
            state: State = DISTURBED if time.timer == "cpu" else UNTRUSTED
            bimodal[f"{name} ({low} and {high} ms)"] = state
    if len(bimodal) > MAX_DISTURBED_SHARE * len(drawings):
        first = next(iter(bimodal))
        more = f", and {len(bimodal) - 1} more" if len(bimodal) > 1 else ""
        worst = max(bimodal.values(), key=STATES.index)
        problems[f"times have two modes: {first}{more}"] = worst
    for time in drawings.values():
        stolen, wall = time.stolen_s or 0.0, time.timing_s or 0.0
        if stolen > MAX_STOLEN_SHARE * wall > 0:
            problems[f"the host took {stolen / wall:.0%} of a core"] = DISTURBED
    return problems


def _equalise_process_medians(time: Time) -> NDArray[np.float64]:
    """Scale each process's samples (r,) to one median, as processes differ in memory layout."""
    samples = np.array(time.samples_s, np.float64)
    if len(time.processes) < 2 or sum(time.processes) != len(samples):
        return samples
    parts = np.split(samples, np.cumsum(time.processes)[:-1])
    return np.concatenate([part * np.median(samples) / np.median(part) for part in parts])


def get_run_state(run: Run) -> RunState:
    """Return the state stored in a run's `run.json`, or else computed from the samples."""
    stored = run.facts.get("state")
    if isinstance(stored, Mapping) and stored.get("state") in STATES:
        why = stored.get("why")
        reasons = why if isinstance(why, list | tuple) else ()
        return RunState(stored["state"], tuple(map(str, reasons)))
    return assess_records(run.records)


def explain_incomparable(base: Time, head: Time, *, machines_differ: bool) -> str:
    """Return why a case's times in two separate runs are incomparable, or "" if comparable."""
    for name, time in (("BASE", base), ("HEAD", head)):
        if problems := _find_disturbances({"the case": time}):
            return f"{name} was disturbed ({next(iter(problems))}); use run --beside"
    medians = [np.median(time.reference_s or [np.nan]) for time in (base, head)]
    for slow, fast in pairwise([*medians, medians[0]]):
        if slow > MAX_REFERENCE_RATIO * fast and not machines_differ:
            return (
                f"two states of the machine (reference draw {medians[0] * 1e3:.3g} ms in BASE, "
                f"{medians[1] * 1e3:.3g} ms in HEAD); use run --beside"
            )
    return ""
