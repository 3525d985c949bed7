"""How fast the machine was while it was measured: its reference draw against the best it has done.

Neighbours on the host of a virtual machine, or a slower clock, change how long every draw takes,
and ratios of times with it, by some per cent: draws that wait for memory lose more than others. The
load average does not show it; the reference draw of the same rounds does. No number of rounds
averages it out. So the best reference draw of each machine and device is kept, beside the model
database, and `harness.figures.run_state` judges a run by how its own compare.
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
from harness.machine.environment import processor

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
    return [_entry(key, second, *known[key]) for key, second in draws.items()]


def _entry(key: tuple[Any, ...], second: float, best: float, runs: int) -> dict[str, Any]:
    return {
        **dict(zip(OF, key, strict=True)),
        "reference_s": second,
        "best_s": best,
        "runs": runs,
        "slower": second / best,
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
