"""How fast the machine was while it was measured: its reference draw against the best it has done.

Neighbours on the host of a virtual machine, or a slower clock, change how long every draw takes,
and ratios of times with it, by some per cent: draws that wait for memory lose more than others. The
load average does not show it; the reference draw of the same rounds does. No number of rounds
averages it out. So the best reference draw of each machine and device is kept, beside the model
database, and a run says how it compares.
"""

from __future__ import annotations

import json
import math
import os
import statistics
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from harness.machine import system
from harness.machine.processor import processor

FILE = "reference-draws.json"

QUIET = 1.45
"""Reference draw over the best up to which runs of a quiet machine scatter: 0.68 to 0.95 ms in ten
runs of five scenes on a virtual machine. It shares rounds, and so caches, with other draws."""

SENSITIVITY = 0.12
"""How much a ratio's logarithm may move for one of the reference draw's, at the most that was
measured: the best for H against ear clipping, city at 1024 px on llvmpipe, moves from 0.842 to
0.890 where a program that copies memory lengthens the reference draw from 0.8 to 1.31 ms."""

OF = ("rasteriser", "device", "resolution", "samples", "work")
"""What a reference draw's time depends on, besides the machine."""


def default_path() -> Path:
    """Return the file of this machine's best draws, beside the model database."""
    return system.cache_file(FILE)


def state_of(records: Iterable[Mapping[str, Any]], path: Path) -> list[dict[str, Any]]:
    """Return how each device did in a run's records, and keep the best in the file at `path`.

    One entry for each of `OF`: `reference_s`, the median of the run's reference draws; `best_s`,
    the least that the machine has reached, this run included; `runs`, how many it was compared
    with; `slower`, their ratio; `ratios_off`, by what share ratios of times may differ from those
    of a quiet machine, 0 where the ratio is within what quiet runs scatter.
    """
    found: dict[tuple[Any, ...], dict[str, list[float]]] = {}
    for record in records:
        reference = (record.get("time") or {}).get("reference_s")
        if reference:
            options = record.get("options") or {}
            values = {**record, **options}
            groups = found.setdefault(tuple(values.get(name) for name in OF), {})
            groups[str(reference)] = reference  # cases that were timed together share it
    draws = {
        key: statistics.median(second for group in groups.values() for second in group)
        for key, groups in found.items()
    }
    known = _keep(draws, path)
    return [_entry(key, second, *known[key]) for key, second in draws.items()]


def _entry(key: tuple[Any, ...], second: float, best: float, runs: int) -> dict[str, Any]:
    slower = second / best
    return {
        **dict(zip(OF, key, strict=True)),
        "reference_s": second,
        "best_s": best,
        "runs": runs,
        "slower": slower,
        "ratios_off": math.expm1(SENSITIVITY * math.log(slower)) if slower > QUIET else 0.0,
    }


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
            system.lock(stream)
            stored = _read(path)
            for key, second in draws.items():
                best, runs = stored.get(names[key], (second, 0))
                stored[names[key]] = (min(best, second), runs + 1)
            new = path.with_suffix(".new")
            new.write_text(json.dumps(stored, indent=1), encoding="utf-8")
            new.replace(path)
    except OSError:
        stored = _read(path)
    return {key: stored.get(names[key], (second, 1)) for key, second in draws.items()}


def _read(path: Path) -> dict[str, tuple[float, int]]:
    """Return what the file holds, without what is no draw."""
    try:
        content = json.loads(path.read_bytes())
        return {str(name): _checked(*value) for name, value in content.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def _checked(best: float, runs: int) -> tuple[float, int]:
    if not (0 < best < math.inf and runs >= 1):
        raise ValueError("no draw")
    return float(best), int(runs)


def words(state: object) -> list[str]:
    """Say, a line each, which devices were slower than a quiet machine's, of a run's `state`.

    What is no entry of `state_of`, in a file that was changed, is passed over.
    """
    lines = []
    for entry in state if isinstance(state, list) else []:
        try:
            off, now, best = (
                float(entry[name]) for name in ("ratios_off", "reference_s", "best_s")
            )
            where = f"{entry['rasteriser']} on {entry['device']}, {entry['resolution']} px"
        except (KeyError, TypeError, ValueError):
            continue
        if off > 0:
            lines.append(
                f"{where}: the machine was slower than it can be: {now * 1e3:.3g} ms for the "
                f"reference draw in place of {best * 1e3:.3g} ms. Ratios of times may be off by "
                f"about {off:.1%}, most of them towards 1; measure again when it is quiet"
            )
    return lines
