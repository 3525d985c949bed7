"""The best reference draw of this machine in each condition, in a file that outlives runs.

A run whose reference draw took longer was disturbed: see `harness.stats.run_quality`.
"""

import json
import math
import os
import statistics
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from harness import atomic
from harness.machine import system
from harness.machine.environment import processor
from harness.results.record import Record

FILE = "reference-draws.json"


class DrawId(NamedTuple):
    """Conditions that a reference draw's time depends on, besides the machine."""

    rasteriser: str
    device: str
    resolution: int
    samples: int
    work: int
    timer: str


def default_path() -> Path:
    """Return the file of this machine's best draws, next to the cache of triangulations."""
    return system.cache_file(FILE)


def reference_draws(records: Iterable[Record], path: Path) -> list[dict[str, Any]]:
    """Return how long each device's reference draw took, and update the best in the file `path`.

    One entry for each `DrawId`: `reference_s`, the median of the run's reference draws; `best_s`,
    the least of this machine, this run included; `runs`, how many runs that is; `slower`, their
    ratio.
    """
    times: dict[DrawId, dict[str, tuple[float, ...]]] = {}
    for record in records:
        if (time := record.time) is not None and time.reference_s:
            case, options = record.id, record.id.options
            conditions = (case.view.resolution, options.samples, options.work, time.timer)
            draw = DrawId(case.rasteriser, case.device_name, *conditions)
            times.setdefault(draw, {})[time.round_group] = time.reference_s
    draws = {
        draw: statistics.median(second for group in groups.values() for second in group)
        for draw, groups in times.items()
    }
    known = _update(draws, path)
    return [
        {
            **draw._asdict(),
            "reference_s": second,
            "best_s": known[draw][0],
            "runs": known[draw][1],
            "slower": second / known[draw][0],
        }
        for draw, second in draws.items()
    ]


def _update(draws: Mapping[DrawId, float], path: Path) -> dict[DrawId, tuple[float, int]]:
    """Return the best time in s of each draw and of how many runs, those of this run included.

    A file that cannot be read is replaced, and one that cannot be written is left alone: results do
    not depend on it.
    """
    machine = f"{processor()['label']}, {os.cpu_count()} threads"
    names = {draw: json.dumps([machine, *draw]) for draw in draws}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.with_suffix(".lock").open("a") as stream:
            system.lock(stream.fileno())
            stored = _read(path)
            for draw, second in draws.items():
                best, runs = stored.get(names[draw], (second, 0))
                stored[names[draw]] = (min(best, second), runs + 1)
            atomic.write(path, json.dumps(stored, indent=1).encode())
    except OSError:
        stored = _read(path)
    return {draw: stored.get(names[draw], (second, 1)) for draw, second in draws.items()}


def _read(path: Path) -> dict[str, tuple[float, int]]:
    """Return the usable entries of the file."""
    try:
        content = json.loads(path.read_bytes())
        return {
            name: (float(best), int(runs))
            for name, (best, runs) in content.items()
            if 0 < best < math.inf and runs >= 1
        }
    except (OSError, ValueError, TypeError, AttributeError):
        return {}
