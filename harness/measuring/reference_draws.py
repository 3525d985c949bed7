"""File of this machine's fastest reference draw in all runs, for each device and condition.

A run whose reference draw took much longer was disturbed: see `harness.stats.run_quality`.
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
from harness.machine.environment import describe_processor
from harness.results.record import Record

FILE = "reference-draws.json"


class DrawId(NamedTuple):
    """Conditions, other than the machine, that determine a reference draw's time."""

    rasteriser: str
    device: str
    resolution: int
    samples: int
    work: int
    timer: str


def get_default_path() -> Path:
    """Return the path of the file, next to the cache of triangulations."""
    return system.get_cache_file(FILE)


def update_reference_draws(records: Iterable[Record], path: Path) -> list[dict[str, Any]]:
    """Add a run's reference draws (of a half-viewport triangle) to a file; compare earlier runs.

    Returns a dictionary for each `DrawId` with its fields and: `reference_s`, the median of the
    run's reference draws; `best_s`, the minimum of such medians on this machine, including this
    run; `runs`, the number of runs; `slower`, the ratio of `reference_s` to `best_s`.
    """
    times: dict[DrawId, dict[str, tuple[float, ...]]] = {}
    for record in records:
        case, options = record.id, record.id.options
        # With a texture the reference draw is slower, and a `DrawId` does not have this condition.
        if (time := record.time) is not None and time.reference_s and not options.texture:
            conditions = (case.view.resolution, options.samples, options.work, time.timer)
            draw = DrawId(case.rasteriser, case.device_name, *conditions)
            times.setdefault(draw, {})[time.round_group] = time.reference_s
    draws = {
        draw: statistics.median(second for group in groups.values() for second in group)
        for draw, groups in times.items()
    }
    best = _update_file(draws, path)
    return [
        {
            **draw._asdict(),
            "reference_s": second,
            "best_s": best[draw][0],
            "runs": best[draw][1],
            "slower": second / best[draw][0],
        }
        for draw, second in draws.items()
    ]


def _update_file(draws: Mapping[DrawId, float], path: Path) -> dict[DrawId, tuple[float, int]]:
    """Add the median times (s) to the file; return each draw's minimum (s) and number of runs.

    An unreadable file is replaced, and an unwritable file is ignored, as counters and times do not
    depend on this file.
    """
    machine = f"{describe_processor()['label']}, {os.cpu_count()} threads"
    names = {draw: json.dumps([machine, *draw]) for draw in draws}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.with_suffix(".lock").open("a") as stream:
            system.lock_file(stream.fileno())
            stored = _read(path)
            for draw, second in draws.items():
                best, runs = stored.get(names[draw], (second, 0))
                stored[names[draw]] = (min(best, second), runs + 1)
            atomic.write(path, json.dumps(stored, indent=1).encode())
    except OSError:
        stored = _read(path)
    return {draw: stored.get(names[draw], (second, 1)) for draw, second in draws.items()}


def _read(path: Path) -> dict[str, tuple[float, int]]:
    """Return the file's valid entries: (minimum in s, number of runs) by machine and draw."""
    try:
        content = json.loads(path.read_bytes())
        return {
            name: (float(best), int(runs))
            for name, (best, runs) in content.items()
            if 0 < best < math.inf and runs >= 1
        }
    except (OSError, ValueError, TypeError, AttributeError):
        return {}
