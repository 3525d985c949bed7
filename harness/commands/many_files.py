"""Process data sets of many files, with or without Dask: shared by `census` and `triangulate`."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from harness.errors import INTERRUPTED, Inconclusive, UsageError, refuse_failed
from harness.progress import Reporter

if TYPE_CHECKING:
    from harness.scaling.crew import Crew
    from harness.scaling.dataset import Dataset, Summary
    from harness.scaling.triangulated import Triangulating

SAID_AFTER_S = 20.0
COMPILING = "still busy with the first parts; a first run also compiles the triangulator ..."

SHOWN = 3
"""Polygons left out for one reason that are named on the screen."""

NAMED = 10
"""Parts set aside that are named one by one."""


@contextmanager
def crew_of(where: str | None, reporter: Reporter) -> Iterator[Crew]:
    """Give those who do the work; `where` is what --dask says, None for this process alone."""
    from harness.scaling.crew import Crew, DaskCrew

    if not where:
        yield Crew()
        return
    crew = DaskCrew(where)
    try:
        reporter.say(f"{crew.threads} workers; dashboard: {crew.dashboard}")
        yield crew
    finally:
        crew.close()


def triangulate_many_files(
    pattern: str, out: Path, work: Triangulating, where: str | None, reporter: Reporter
) -> None:
    """Triangulate the parts of many files into a folder, and say what is in it.

    Raises
    ------
    UsageError
        if there is no file, or the folder is not for that
    Inconclusive
        if parts were set aside, or polygons failed
    """
    from harness.export.export import FORMATS, Certified
    from harness.scaling.dataset import Dataset

    if out.suffix.lower() in FORMATS and not out.is_dir():
        raise UsageError(f"-o {out}: give a folder, for a file of each part")
    summary = complete(Dataset(pattern, out, work), out, where, reporter)
    warn_of_skipped(summary, out, reporter)
    typer.echo(
        f"{out}: {summary.polygons:,} polygons, {summary.triangles:,} triangles in "
        f"{summary.parts_done:,} of {summary.parts:,} parts; {summary.seconds:.1f} s; "
        f"{summary.proven:,} proven optimal"
    )
    if summary.certified:
        typer.echo(f"{out}: {Certified.total(summary.certified)}")
    refuse_set_aside(out, summary)
    refuse_failed(summary.counts, out)


def complete(dataset: Dataset, out: Path, where: str | None, reporter: Reporter) -> Summary:
    """Do what is missing of a data set; if it is stopped, say how to go on and end the process."""
    there = len(dataset.done)
    if there:
        reporter.say(f"{out}: {there:,} of {len(dataset.parts):,} parts are there already")
    try:
        with (
            crew_of(where if dataset.missing else "", reporter) as crew,
            reporter.if_long(COMPILING, SAID_AFTER_S) as needless,
        ):
            return dataset.complete(crew, reporter, needless)
    except KeyboardInterrupt:
        typer.echo(
            f"stopped; {len(dataset.done):,} of {len(dataset.parts):,} parts are in {out}; "
            "to go on, give the same command again",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None


def lines_of_notes(
    counts: Mapping[tuple[str, str], int], told: Iterable[tuple[str, str, str]]
) -> Iterator[str]:
    """Yield a line for each reason: how many were left out or changed, and the first of them.

    counts : by kind and reason; told : (kind, which, reason)
    """
    from scenes.cleaning.notes import general_reason

    named = defaultdict(list)
    for kind, which, why in told:
        named[kind, general_reason(why)].append(which)
    for (kind, reason), count in sorted(counts.items()):
        more = f" and {count - SHOWN:,} more" if count > SHOWN else ""
        first = named[kind, reason][:SHOWN]
        names = f" ({', '.join(first)}{more})" if first else ""
        yield f"{kind} {count:,}: {reason}{names}"


def refuse_set_aside(out: Path, summary: Summary) -> None:
    """Raise Inconclusive if parts were set aside."""
    if summary.set_aside:
        number = len(summary.set_aside)
        raise Inconclusive(
            f"{number:,} {'parts were' if number > 1 else 'part was'} set aside; the rest is in "
            f"{os.path.relpath(out)}; mend the cause and give the same command again"
        )


def warn_of_skipped(summary: Summary, folder: Path, reporter: Reporter) -> None:
    """Say what was left out, and why."""
    from harness.scaling.dataset import LEFT_OUT

    told = (
        (kind, which if summary.parts == 1 else f"{which} of {file}", why)
        for file, kind, which, why in summary.left_out
    )
    for line in lines_of_notes(summary.counts, told):
        reporter.warn(line)
    if len(summary.left_out) > SHOWN:
        reporter.say(f"each that was left out: {os.path.relpath(folder / LEFT_OUT)}")
    if summary.pruned:
        reporter.say(f"left out {summary.pruned:,} rows unread: their row groups exclude --where")
    for which, reason in islice(summary.set_aside.items(), NAMED):
        reporter.warn(f"set aside {which}: {reason}")
