"""Gives commands what is hostile, and prints what became of each: exit codes, and the slowest.

    PYTHONPATH=. .venv/bin/python scripts/hostile.py stored --inputs 500 --out FILE
    PYTHONPATH=. .venv/bin/python scripts/hostile.py options --out FILE

`stored` damages stored results and gives them to each command that reads them. `options` gives each
option of each command its bad values, all of them. Both are targets of `make fuzz`, too, which
searches on. Everything is in this process, so a crash of the interpreter ends it.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz.target import Target, targets

SLOW_S = 10.0
"""Seconds that a command may take."""


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


def table(values: Iterable[Any], check: Callable[[Any], Any]) -> tuple[list[str], int]:
    """Check all values; return the lines of a table, and how many broke a promise."""
    outcomes: dict[str, Counter[str]] = defaultdict(Counter)
    slowest: dict[str, float] = defaultdict(float)
    broken: list[str] = []
    for value in values:
        begun = time.perf_counter()
        try:
            what = str(check(value))
        except Exception as error:
            what = f"{value.get('command')}: BROKEN"
            broken.append(f"{value!r:.300}: {type(error).__name__}: {str(error)[-600:]}")
        took = time.perf_counter() - begun
        name, _, outcome = what.rpartition(": ")
        outcomes[name][outcome] += 1
        slowest[name] = max(slowest[name], took)
        if took > SLOW_S:
            broken.append(f"{value!r:.300}: took {took:.1f} s")
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

        values: Iterable[Any] = every()
    else:
        values = drawn(target, chosen.inputs, chosen.seed)
    lines, broken = table(values, target.check)
    print("\n".join(lines))
    if chosen.out:
        chosen.out.write_text("\n".join(lines) + "\n")
    raise SystemExit(bool(broken))


if __name__ == "__main__":
    main()
