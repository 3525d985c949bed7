"""Tells the state a machine was in while it measured: one rule, for all who speak of times.

A CPU rasteriser is timed by its process's CPU time, so a sample that waited for a core is not
longer for that, but it lost its caches meanwhile. Neighbours on the core or in its cache make all
draws longer and ratios of them other ones, and nothing waits: the reference draw of the same rounds
tells that, set against the best that this machine has done, which is kept in a file beside the
model database. The load average does not show it, and no number of rounds averages it out.

Where a run's state is not quiet, nothing is shown by its times. Two versions that were timed in
the same rounds are exempt, for what the machine did, it did to both.
"""

import json
import math
import os
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from harness import atomic
from harness.machine import system
from harness.machine.environment import processor

State = Literal["quiet", "disturbed", "not to be trusted"]
QUIET: Final = "quiet"
DISTURBED: Final = "disturbed"
UNTRUSTED: Final = "not to be trusted"
_ORDER: tuple[State, ...] = get_args(State)

WAITED = 0.02
"""Share of its time that a sample may wait for a core and still count as undisturbed."""

SHORTEST = 0.1
"""Quantile of a drawing's samples whose wall clock, for its CPU time, is that of no disturbance."""

ENOUGH = 12
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
    """What state a run was in, and why, a clause each."""

    state: State
    why: tuple[str, ...] = ()

    @property
    def is_quiet(self) -> bool:
        """Whether its times can show anything."""
        return self.state == QUIET

    @property
    def words(self) -> list[str]:
        """Say it in a line, none of a quiet run."""
        if self.is_quiet:
            return []
        return [f"the run's times are {self.state}: {'; '.join(self.why)}. So {REMEDY}"]


def undisturbed(times: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Return which (r,) samples of a record's `time` waited for a core for no more than `WAITED`.

    All, where it is not known. A thread that waits for another of its own process, as Vulkan's on
    the CPU do, lengthens nothing: a sample has waited for no longer than the wall clock shows it to
    be beyond the shortest for its CPU time. Threads side by side take less by the wall clock.
    """
    samples = np.asarray(times.get("samples_s") or (), np.float64)
    waited = np.asarray(times.get("waited_s") or (), np.float64)
    wall = np.asarray(times.get("wall_s") or (), np.float64)
    if len(waited) != len(samples):
        return np.ones(len(samples), np.bool_)
    if len(wall) == len(samples) > 0 and samples.all():
        shortest = min(1.0, float(np.quantile(wall / samples, SHORTEST)))
        waited = np.minimum(waited, wall - shortest * samples)
    kept: NDArray[np.bool_] = waited <= WAITED * samples
    return kept


def kept_pairs(times: Mapping[str, Any], base: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Return which (r,) rounds a ratio rests on: those that disturbed neither, if there are enough.

    Raises
    ------
    ValueError
        if both are not of as many rounds
    """
    own, other = undisturbed(times), undisturbed(base)
    if len(own) != len(other):
        raise ValueError(f"{len(own)} and {len(other)} samples are not rounds of one group")
    kept: NDArray[np.bool_] = own & other
    return kept if kept.sum() >= ENOUGH else np.ones(len(kept), np.bool_)


def two_modes(samples: Sequence[float] | NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the middles of the two modes that samples sit in, None where they have one.

    They are split where that leaves the least variance within (N. Otsu, IEEE Transactions on
    Systems, Man and Cybernetics 9, 1979), by logarithm.
    """
    values = np.asarray(samples, np.float64)
    logs = np.sort(np.log(values[values > 0]))
    count = len(logs)
    if count < ENOUGH:
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
    records: Iterable[Mapping[str, Any]], draws: Sequence[Mapping[str, Any]] = ()
) -> RunState:
    """Tell the state from the records of a run and its reference draws (`machine.state`)."""
    found: dict[str, State] = {}
    devices: dict[str, dict[str, Mapping[str, Any]]] = {}
    for record in records:
        if times := record.get("time"):
            where = f"{record.get('rasteriser')} on {record.get('device')}"
            name = f"{record.get('triangulator')} of {record.get('scene')}"
            devices.setdefault(where, {})[f"{name}, {record.get('resolution')} px"] = times
    for where, drawings in devices.items():
        found |= {f"{where}: {why}": state for why, state in _of_samples(drawings).items()}
    for draw in draws:
        if draw["slower"] > SLOWER:
            own = f"{draw['rasteriser']} on {draw['device']}, {draw['resolution']} px"
            took = f"{draw['reference_s'] * 1e3:.3g} ms, {draw['slower']:.2g} times the best"
            found[f"{own}: the reference draw took {took} of this machine"] = DISTURBED
    return RunState(max(found.values(), key=_ORDER.index, default=QUIET), tuple(found))


def _of_samples(drawings: Mapping[str, Mapping[str, Any]]) -> dict[str, State]:
    """Say what disturbed the samples of a device's drawings, whose `time` it is."""
    found: dict[str, State] = {}
    masks = {name: undisturbed(times) for name, times in drawings.items()}
    count = sum(len(good) for good in masks.values())
    waited = count - sum(int(good.sum()) for good in masks.values())
    others = [
        times["others_s"] / times["timing_s"]
        for times in drawings.values()
        if times.get("others_s") is not None and times.get("timing_s")
    ]
    # Where nobody else computed, threads waited for their own process's.
    if waited > FEW * count and max(others, default=math.inf) > FEW:
        few = any(good.sum() < min(ENOUGH, len(good)) for good in masks.values())
        share = f"{waited} of {count} samples waited for a core"
        found[share] = UNTRUSTED if few else DISTURBED
    sit: dict[str, State] = {}
    for name, times in drawings.items():
        samples, good = _of_one_process(times), masks[name]
        if modes := two_modes(samples[good] if good.sum() >= ENOUGH else samples):
            low, high = (f"{second * 1e3:.3g}" for second in modes)
            # CPU time has no mode of the scheduler's; other clocks take its slices for the draw's.
            state: State = DISTURBED if times.get("timer") == "cpu" else UNTRUSTED
            sit[f"{name} ({low} and {high} ms)"] = state
    if len(sit) > FEW * len(drawings):
        first, *rest = sit
        more = f", and {len(rest)} more" if rest else ""
        found[f"times sit in two modes: {first}{more}"] = max(sit.values(), key=_ORDER.index)
    for times in drawings.values():
        stolen, wall = times.get("stolen_s") or 0.0, times.get("timing_s") or 0.0
        if stolen > STOLEN * wall > 0:
            found[f"the host took {stolen / wall:.0%} of a core"] = DISTURBED
    return found


def _of_one_process(times: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return (r,) samples without what processes differ by: where their memory lies is no mode."""
    samples = np.asarray(times.get("samples_s") or (), np.float64)
    processes = times.get("processes") or []
    if len(processes) < 2 or sum(processes) != len(samples):
        return samples
    parts = np.split(samples, np.cumsum(processes)[:-1])
    return np.concatenate([part * np.median(samples) / np.median(part) for part in parts])


def state_of(facts: Mapping[str, Any], records: Iterable[Mapping[str, Any]]) -> RunState:
    """Return the state that a run's `run.json` tells; where it tells none, what its samples do."""
    told = facts.get("state")
    if isinstance(told, Mapping) and told.get("state") in get_args(State):
        why = told.get("why")
        return RunState(
            told["state"], tuple(map(str, why if isinstance(why, list | tuple) else ()))
        )
    return judge(records)


def apart(base: Mapping[str, Any], head: Mapping[str, Any], *, machines_differ: bool) -> str:
    """Say why the times of two runs that were made apart cannot be compared; "" if they can.

    base, head : `time` of the same case in both
    machines_differ : then reference draws differ for that
    """
    for name, times in (("BASE", base), ("HEAD", head)):
        if problems := _of_samples({"it": times}):
            return f"{name} was disturbed ({next(iter(problems))}); use run --beside"
    medians = [np.median(times.get("reference_s") or [np.nan]) for times in (base, head)]
    for slow, fast in pairwise([*medians, medians[0]]):
        if slow > SLOWER * fast and not machines_differ:
            return (
                f"two states of the machine (reference draw {medians[0] * 1e3:.3g} ms in BASE, "
                f"{medians[1] * 1e3:.3g} ms in HEAD); use run --beside"
            )
    return ""


FILE = "reference-draws.json"

OF = ("rasteriser", "device", "resolution", "samples", "work", "timer")
"""What a reference draw's time depends on, besides the machine."""


def default_path() -> Path:
    """Return the file of this machine's best draws, beside the model database."""
    return system.cache_file(FILE)


def reference_draws(records: Iterable[Mapping[str, Any]], path: Path) -> list[dict[str, Any]]:
    """Return how long each device's reference draw took, and keep the best in the file at `path`.

    One entry for each of `OF`: `reference_s`, the median of the run's reference draws; `best_s`,
    the least that the machine has reached, this run included; `runs`, how many it was compared
    with; `slower`, their ratio.
    """
    found: dict[tuple[Any, ...], dict[str, list[float]]] = {}
    for record in records:
        times = record.get("time") or {}
        if reference := times.get("reference_s"):
            values = {**record, **(record.get("options") or {}), "timer": times.get("timer")}
            groups = found.setdefault(tuple(values.get(name) for name in OF), {})
            groups[str(reference)] = reference  # cases that were timed together share it
    draws = {
        key: statistics.median(second for group in groups.values() for second in group)
        for key, groups in found.items()
    }
    known = _keep(draws, path)
    entries = []
    for key, second in draws.items():
        best, runs = known[key]
        told = {"reference_s": second, "best_s": best, "runs": runs, "slower": second / best}
        entries.append(dict(zip(OF, key, strict=True)) | told)
    return entries


def _keep(
    draws: Mapping[tuple[Any, ...], float], path: Path
) -> dict[tuple[Any, ...], tuple[float, int]]:
    """Return the best draw of each key and of how many runs, with those of now taken in.

    A file that cannot be read is begun anew, and one that cannot be written is left alone: what is
    measured does not depend on it.
    """
    machine = f"{processor()['label']}, {os.cpu_count()} threads"
    names = {key: json.dumps([machine, *key]) for key in draws}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.with_suffix(".lock").open("a") as stream:
            system.lock(stream.fileno())
            stored = _read(path)
            for key, second in draws.items():
                best, runs = stored.get(names[key], (second, 0))
                stored[names[key]] = (min(best, second), runs + 1)
            atomic.write(path, json.dumps(stored, indent=1).encode())
    except OSError:
        stored = _read(path)
    return {key: stored.get(names[key], (second, 1)) for key, second in draws.items()}


def _read(path: Path) -> dict[str, tuple[float, int]]:
    """Return what the file holds, without what is no draw."""
    try:
        content = json.loads(path.read_bytes())
        return {
            name: (float(best), int(runs))
            for name, (best, runs) in content.items()
            if 0 < best < math.inf and runs >= 1
        }
    except (OSError, ValueError, TypeError, AttributeError):
        return {}
