"""Gives commands what is hostile, and prints what became of each: exit codes, and the slowest.

    PYTHONPATH=. .venv/bin/python scripts/hostile.py stored --inputs 500 --out FILE
    PYTHONPATH=. .venv/bin/python scripts/hostile.py options --out FILE

`stored` damages stored results and gives them to each command that reads them. `options` gives each
option of each command its bad values, all of them. Both are targets of `make fuzz`, too, which
searches on. Inputs are checked in processes that are forked off this one, which has loaded
everything: so a crash is one input's, and one that says nothing for ten seconds is found. One value
of an option in fifty is given to the program as a user starts it, too.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import pkgutil
import select
import signal
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings

import harness
import scenes
import triangulators
from tests.fuzz.target import Target, targets
from tests.fuzz.targets.runs import sound

TOLD_S = 3.0
"""What takes longer is printed."""

TOGETHER = 50
"""Inputs that one process checks, as long as none ends it."""

HANG_S = 120.0
"""Seconds that a command may take, whatever it says meanwhile."""


def drawn(target: Target, inputs: int, number: int) -> Iterator[Any]:
    """Yield so many inputs of a target, the same for the same number."""
    found: list[Any] = []

    @seed(number)
    @settings(
        max_examples=inputs,
        database=None,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
        deadline=None,
    )
    @given(target.inputs)
    def draw(value: Any) -> None:
        found.append(value)

    draw()
    yield from found[:inputs]


def load_everything() -> None:
    """Import what commands need, once for all processes that are forked off."""
    for package in (harness, scenes, triangulators):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if module.name != "harness.__main__":
                with suppress(ImportError):  # what an extra would bring
                    importlib.import_module(module.name)
    for name in ("matplotlib.figure", "matplotlib.backends.backend_agg", "scipy.stats"):
        importlib.import_module(name)


def apart(check: Callable[[Any], Any], values: list[Any]) -> Iterator[tuple[bool, str, float]]:
    """Check values in processes that are forked off, one after the other.

    Yields for each whether the promise held, what the check returned or raised, or which signal
    ended the process, or that it went on for too long, and the seconds it took. What comes after
    one that ended its process is checked in a new one.
    """
    done = 0
    while done < len(values):
        reading, writing = os.pipe()
        child = os.fork()
        if not child:
            os.setsid()
            os.close(reading)
            for value in values[done:]:
                os.write(writing, (json.dumps(_checked(check, value)) + "\n").encode())
            os._exit(0)
        os.close(writing)
        with os.fdopen(reading, "rb", buffering=0) as pipe:
            while done < len(values):
                begun = time.perf_counter()
                ready, _, _ = select.select([pipe], [], [], HANG_S)
                line = pipe.readline() if ready else b""
                if not line:
                    break
                done += 1
                yield (*json.loads(line), time.perf_counter() - begun)
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if not line:
            done += 1
            code = os.waitstatus_to_exitcode(status)
            ended = f"ended by {code}" if ready else f"hang: more than {HANG_S:.0f} s"
            yield False, ended, time.perf_counter() - begun


def _checked(check: Callable[[Any], Any], value: Any) -> tuple[bool, str]:
    try:
        return True, str(check(value))
    except BaseException as error:
        return False, f"{type(error).__name__}: {str(error)[-600:]}"


def table(values: Iterable[Any], check: Callable[[Any], Any]) -> tuple[list[str], int]:
    """Check all values; return the lines of a table, and how many broke a promise."""
    outcomes: dict[str, Counter[str]] = defaultdict(Counter)
    slowest: dict[str, float] = defaultdict(float)
    broken: list[str] = []
    given = list(values)
    for start in range(0, len(given), TOGETHER):
        some = given[start : start + TOGETHER]
        for value, (kept, what, took) in zip(some, apart(check, some), strict=True):
            name, _, outcome = what.rpartition(": ") if kept else (value["command"], "", "BROKEN")
            if not kept:
                broken.append(f"{value!r:.300}: {what}")
                print(broken[-1], flush=True)
            if took > TOLD_S:
                print(f"{took:.1f} s: {value!r:.200}: {what:.200}", flush=True)
            outcomes[name][outcome] += 1
            slowest[name] = max(slowest[name], took)
    ends = sorted({outcome for counts in outcomes.values() for outcome in counts})
    lines = ["| command | inputs | " + " | ".join(ends) + " | slowest |"]
    lines.append("|---|" + "---:|" * (len(ends) + 2))
    for name, counts in sorted(outcomes.items()):
        cells = [f"{counts[end] or ''}" for end in ends]
        row = [name, str(counts.total()), *cells, f"{slowest[name]:.1f} s"]
        lines.append("| " + " | ".join(row) + " |")
    total = sum(counts.total() for counts in outcomes.values())
    lines += ["", f"{total:,} inputs; {len(broken)} broke a promise.", *broken]
    return lines, len(broken)


def main() -> None:
    """Read the command line, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("target", choices=("stored", "options"))
    parser.add_argument("--inputs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    target = targets()[chosen.target]
    if chosen.target == "options":
        from tests.fuzz.targets.options import every

        values: Iterable[Any] = [
            each | started
            for number, each in enumerate(every())
            for started in ([{}, {"started": True}] if number % 50 == 7 else [{}])
        ]
    else:
        values = drawn(target, chosen.inputs, chosen.seed)
    load_everything()
    sound()
    lines, broken = table(values, target.check)
    print("\n".join(lines))
    if chosen.out:
        chosen.out.write_text("\n".join(lines) + "\n")
    raise SystemExit(bool(broken))


if __name__ == "__main__":
    main()
