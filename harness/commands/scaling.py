"""Commands over data sets of many files: what they say, and how they end."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console

from harness.errors import INTERRUPTED, Inconclusive, UsageError
from harness.export.certified import Certified
from harness.export.export import FORMATS
from harness.progress import Reporter
from harness.scaling.crew import DaskCrew
from harness.scaling.dataset import Dataset, Summary
from harness.scaling.triangulated import Options
from harness.scaling.working import Alone, Crew

NAMED = 10
"""Parts set aside that are named one by one."""


@contextmanager
def crew_of(where: str, reporter: Reporter) -> Iterator[Crew]:
    """Give those who do the work; `where` is what --dask says, "" for this process alone."""
    if not where:
        yield Alone()
        return
    crew = DaskCrew(where, reporter)
    try:
        reporter.say(f"{crew.threads} workers; dashboard: {crew.dashboard}")
        yield crew
    finally:
        crew.close()


def triangulate_many_files(
    pattern: str, out: Path, options: Options, where: str, reporter: Reporter
) -> None:
    """Triangulate the parts of many files into a folder, and say what is in it.

    Raises
    ------
    UsageError
        if there is no file, or the folder is not for that
    Inconclusive
        if parts were set aside
    """
    if out.suffix.lower() in FORMATS and not out.is_dir():
        raise UsageError(f"-o {out}: give a folder, for a file of each part")
    dataset = Dataset(pattern, out, options)
    there = len(dataset.done)
    if there:
        reporter.say(f"{out}: {there:,} of {len(dataset.cut.parts):,} parts are there already")
    try:
        if dataset.missing:
            with crew_of(where, reporter) as crew:
                summary = dataset.complete(crew, reporter)
        else:
            summary = dataset.complete(Alone(), reporter)
    except KeyboardInterrupt:
        typer.echo(
            f"stopped; {len(dataset.done):,} of {len(dataset.cut.parts):,} parts are in {out}; "
            "to go on, give the same command again",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None
    _say(out, summary, reporter)
    if summary.set_aside:
        number = len(summary.set_aside)
        raise Inconclusive(
            f"{number:,} {'parts were' if number > 1 else 'part was'} set aside; the rest is in "
            f"{os.path.relpath(out)}; mend the cause and give the same command again"
        )


def _say(out: Path, summary: Summary, reporter: Reporter) -> None:
    for (kind, reason), count in sorted(summary.counts.items()):
        reporter.warn(f"{kind} {count:,}: {reason}")
    if summary.pruned:
        reporter.say(f"left out {summary.pruned:,} rows unread: their row groups exclude --where")
    for number, (which, reason) in enumerate(summary.set_aside.items()):
        if number == NAMED:
            reporter.warn(f"and {len(summary.set_aside) - NAMED:,} more parts, all in the manifest")
            break
        reporter.warn(f"set aside {which}: {reason}")
    rate = f" ({summary.worker_rate:,.0f} a second and worker)" if summary.worker_rate else ""
    console = Console(highlight=False)
    console.print(
        f"{out}: {summary.polygons:,} polygons, {summary.triangles:,} triangles in "
        f"{summary.parts_done:,} of {summary.parts:,} parts; {summary.seconds:.1f} s{rate}; "
        f"{summary.proven:,} proven optimal",
        markup=False,
        soft_wrap=True,
    )
    if summary.certified:
        console.print(f"{out}: {Certified.total(summary.certified)}", markup=False, soft_wrap=True)
