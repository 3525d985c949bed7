"""Process data sets of many files, with or without Dask: shared by `census` and `triangulate`."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from harness.errors import INTERRUPTED, InconclusiveError, UsageError, raise_if_failed
from harness.progress import Reporter

if TYPE_CHECKING:
    from harness.scaling.dataset import Dataset, Summary
    from harness.scaling.executors import Executor
    from harness.scaling.triangulated import Triangulating

NOTE_AFTER_S = 20.0
COMPILING = "still busy with the first parts; a first run also compiles the triangulator ..."

MAX_POLYGONS_NAMED = 3  # on the screen, for each reason
MAX_PARTS_NAMED = 10  # set-aside parts, on the screen


@contextmanager
def open_executor(dask: str | None, reporter: Reporter) -> Iterator[Executor]:
    """Yield the executor for the value of --dask; None or "" means this process."""
    from harness.scaling.executors import DaskExecutor, Executor

    with closing(DaskExecutor(dask) if dask else Executor()) as executor:
        if isinstance(executor, DaskExecutor):
            reporter.say(f"{executor.threads} workers; dashboard: {executor.dashboard}")
        yield executor


def triangulate_many_files(
    pattern: str, out: Path, work: Triangulating, dask: str | None, reporter: Reporter
) -> None:
    """Triangulate the parts of many files into a folder, and print a summary."""
    from harness.export.export import FORMATS, Certified
    from harness.scaling.dataset import Dataset

    if out.suffix.lower() in FORMATS and not out.is_dir():
        raise UsageError(f"-o {out}: not a folder; give a folder, to store a file for each part")
    summary = complete_dataset(Dataset(pattern, out, work), out, dask, reporter)
    warn_of_skipped(summary, out, reporter)
    typer.echo(
        f"{out}: {summary.polygons:,} polygons, {summary.triangles:,} triangles in "
        f"{summary.parts_done:,} of {summary.parts:,} parts; {summary.seconds:.1f} s; "
        f"{summary.proven:,} proven optimal"
    )
    if summary.certified:
        typer.echo(f"{out}: {Certified.sum_parts(summary.certified)}")
    raise_if_set_aside(out, summary)
    raise_if_failed(summary.counts, out)


def complete_dataset(dataset: Dataset, out: Path, dask: str | None, reporter: Reporter) -> Summary:
    """Process the missing parts and return the summary; if stopped, print a remedy and exit."""
    done = len(dataset.done)
    if done:
        reporter.say(f"{out}: {done:,} of {len(dataset.parts):,} parts exist already")
    try:
        with (
            open_executor(dask if dataset.missing else "", reporter) as executor,
            reporter.say_if_long(COMPILING, NOTE_AFTER_S) as cancel_note,
        ):
            return dataset.complete(executor, reporter, cancel_note)
    except KeyboardInterrupt:
        typer.echo(
            f"stopped; {len(dataset.done):,} of {len(dataset.parts):,} parts are in {out}; "
            "to continue, run the same command again",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None


def format_notes(
    counts: Mapping[tuple[str, str], int], notes: Iterable[tuple[str, str, str]]
) -> Iterator[str]:
    """Yield a line for each (kind, reason); `notes` has rows of (kind, polygon's name, reason)."""
    from scenes.scene import remove_location

    named = defaultdict(list)
    for kind, polygon, detail in notes:
        named[kind, remove_location(detail)].append(polygon)
    for (kind, reason), count in sorted(counts.items()):
        first = named[kind, reason][:MAX_POLYGONS_NAMED]
        more = f" and {count - len(first):,} more" if count > len(first) else ""
        names = f" ({', '.join(first)}{more})" if first else ""
        yield f"{kind} {count:,}: {reason}{names}"


def raise_if_set_aside(out: Path, summary: Summary) -> None:
    """Raise InconclusiveError if parts were set aside."""
    if summary.set_aside:
        number = len(summary.set_aside)
        raise InconclusiveError(
            f"{os.path.relpath(out)}: {number:,} {'parts were' if number > 1 else 'part was'} set "
            "aside; fix the cause and run the same command again"
        )


def warn_of_skipped(summary: Summary, folder: Path, reporter: Reporter) -> None:
    """Warn of skipped polygons and rows, and of parts that were set aside after failures."""
    from harness.scaling.dataset import LEFT_OUT

    notes = (
        (kind, polygon if summary.parts == 1 else f"{polygon} of {file}", reason)
        for file, kind, polygon, reason in summary.left_out
    )
    for line in format_notes(summary.counts, notes):
        reporter.warn(line)
    if len(summary.left_out) > MAX_POLYGONS_NAMED:
        reporter.say(f"all skipped polygons: {os.path.relpath(folder / LEFT_OUT)}")
    if summary.pruned:
        reporter.say(f"skipped {summary.pruned:,} rows unread: --where excludes their row groups")
    for name, reason in islice(summary.set_aside.items(), MAX_PARTS_NAMED):
        reporter.warn(f"set aside {name}: {reason}")
