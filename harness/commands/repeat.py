"""`harness repeat`: does a second run say the same as the first?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.errors import UsageError


def repeat(
    first: Annotated[Path, typer.Argument(help="Folder of the first run.")],
    second: Annotated[Path, typer.Argument(help="Folder of the second run, of the same plan.")],
) -> None:
    """Check that two runs of one plan have equal counters, and say how often verdicts agree.

    Two triangulations of the same polygons that were timed together are a pair. Each run has a
    verdict on the pair: faster, slower, or no difference shown, which means that the two are too
    close for the time spent. Exits with 1 if a counter differs.
    """
    from harness.stored.folder import read_run
    from harness.study.repeat import repeat as compare

    found = compare(read_run(first).records, read_run(second).records)
    if not found.cases:
        raise UsageError(f"{first} and {second} have no case in common: run the same plan twice")
    console = Console()

    def say(text: str) -> None:
        console.print(text, markup=False, soft_wrap=True, highlight=False)

    same = found.cases - len(found.unequal)
    say(f"counters: equal in {same:,} of {found.cases:,} cases")
    for key in found.unequal[:5]:
        say(f"  differ: {key}")
    for verdicts in found.verdicts:
        where = f"{verdicts.rasteriser} on {verdicts.device}, {verdicts.pairs:,} pairs"
        which = f"both runs say which is faster for {verdicts.decided:,}"
        if verdicts.decided:
            which += f", and agree on {verdicts.agreeing / verdicts.decided:.2%} of these"
        alike = f"{verdicts.same / verdicts.pairs:.1%}"
        say(f"{where}: {which}; all three verdicts counted, they agree on {alike}")
    raise typer.Exit(1 if found.unequal else 0)
