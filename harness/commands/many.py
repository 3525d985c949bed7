"""What commands over data sets of many files say, and how they end."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console

from harness.errors import (
    INTERRUPTED,
    Inconclusive,
    NothingMeasured,
    UsageError,
    refuse_failed,
)
from harness.export.certified import Certified
from harness.export.export import FORMATS, chosen
from harness.progress import Reporter
from harness.scaling import census_report, tile_report
from harness.scaling.census import COUNTING
from harness.scaling.census import Options as CensusOptions
from harness.scaling.cluster import DaskCrew
from harness.scaling.dataset import Dataset, Summary
from harness.scaling.parts import files
from harness.scaling.sums import total, whole
from harness.scaling.task_queue import Alone, Crew
from harness.scaling.tile_census import TILE_COUNTING, TileOptions, also_found
from harness.scaling.triangulated import Options
from harness.stored.folder import clear_errors
from scenes.slices import in_degrees

SAID_AFTER_S = 20.0
COMPILING = "still busy with the first parts; a first run also compiles the triangulator ..."

NAMED = 10
"""Parts set aside that are named one by one."""


@contextmanager
def crew_of(where: str | None, reporter: Reporter) -> Iterator[Crew]:
    """Give those who do the work; `where` is what --dask says, None for this process alone."""
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
    pattern: str, out: Path, options: Options, where: str | None, reporter: Reporter
) -> None:
    """Triangulate the parts of many files into a folder, and say what is in it.

    Raises
    ------
    UsageError
        if there is no file, or the folder is not for that
    Inconclusive
        if parts were set aside, or polygons failed
    """
    if out.suffix.lower() in FORMATS and not out.is_dir():
        raise UsageError(f"-o {out}: give a folder, for a file of each part")
    summary = _complete(Dataset(pattern, out, options), out, where, reporter)
    _say(out, summary, reporter)
    _refuse_set_aside(out, summary)
    refuse_failed(summary.counts, out)


def count_many_files(
    pattern: str,
    out: Path,
    options: CensusOptions,
    where: str | None,
    reporter: Reporter,
) -> None:
    """Count the footprints of many files, write what came out, and show a table.

    Raises
    ------
    UsageError
        if there is no file, or the folder is not for that
    NothingMeasured
        if there is no footprint that all could do
    Inconclusive
        if parts were set aside
    """
    names = options.triangulators
    dataset = Dataset(pattern, out / "parts", options, COUNTING)
    summary = _complete(dataset, out, where, reporter)
    sums = whole(total(dataset.out, dataset.keys_done), len(names))
    if not sums.footprints:
        _warn(summary, reporter)
        raise NothingMeasured(f"{os.path.relpath(out)}: no footprint was done by all triangulators")
    with clear_errors(out, "give the same command again"), reporter.stage("drawing", 1):
        census_report.write(out, sums, options)
    _warn(summary, reporter)
    Console(highlight=False).print(census_report.table(sums, names))
    typer.echo(
        f"{os.path.relpath(out)}: {sums.footprints:,} footprints in {summary.seconds:.1f} s: "
        "census.csv, cells.csv, plots/"
    )
    # A footprint that one triangulator cannot do is left out for all: a warning tells how many.
    _refuse_set_aside(out, summary)


def count_tiles(
    pattern: str, out: Path, options: TileOptions, where: str | None, reporter: Reporter
) -> None:
    """Count the polygons of map tiles, write what came out, and show a table.

    Raises as `count_many_files` does.
    """
    names = options.triangulators
    dataset = Dataset(pattern, out / "parts", options, TILE_COUNTING)
    summary = _complete(dataset, out, where, reporter)
    groups = total(dataset.out, dataset.keys_done)
    damaged, known = also_found(dataset.out, dataset.keys_done)
    polygons = whole(groups, len(names)).footprints
    if not polygons:
        _warn(summary, reporter)
        asked = options.chosen.layers or ()
        missing = next((f" {name!r}; it has {', '.join(known)}" for name in asked if known), "")
        why = f"there is no layer{missing}" if missing else "no polygon was done by all"
        raise NothingMeasured(f"{os.path.relpath(out)}: {why}")
    with clear_errors(out, "give the same command again"), reporter.stage("drawing", 1):
        tile_report.write(out, groups, names, damaged)
    _warn(summary, reporter)
    for name, why in damaged[:NAMED]:
        reporter.warn(f"tile {name} {why}")
    console = Console(highlight=False)
    console.print(tile_report.table(groups, names, console))
    typer.echo(
        f"{os.path.relpath(out)}: {polygons:,} polygons in {summary.seconds:.1f} s: census.csv, "
        "plots/" + ", damaged.csv" * bool(damaged)
    )
    _refuse_set_aside(out, summary)


def census_options(
    pattern: str,
    triangulators: Sequence[str],
    units_per_pixel: float,
    cell: float | None,
    layer: str | None,
    where: str | None,
) -> CensusOptions:
    """Return what a census counts; raises UsageError for fewer than two triangulators.

    cell : None for a thousand units, or a hundredth of a degree
    """
    names = several_names(triangulators)
    size = cell or (0.01 if in_degrees(files(pattern)[0]) else 1000.0)
    return CensusOptions(names, units_per_pixel, size, layer, where)


def several_names(triangulators: Sequence[str]) -> tuple[str, ...]:
    """Return full names; raises UsageError for fewer than two triangulators."""
    names = tuple(chosen(name, None) for name in triangulators)
    if len(set(names)) < 2:
        raise UsageError(f"--triangulators {','.join(triangulators)}: give two or more to compare")
    return names


def _complete(dataset: Dataset, out: Path, where: str | None, reporter: Reporter) -> Summary:
    """Do what is missing of a data set; if it is stopped, say how to go on and end the process."""
    for file, earlier in dataset.cut.repeated.items():
        reporter.warn(f"{file} has the content of {earlier}: its polygons count twice")
    there = len(dataset.done)
    if there:
        reporter.say(f"{out}: {there:,} of {len(dataset.cut.parts):,} parts are there already")
    try:
        with (
            crew_of(where if dataset.missing else "", reporter) as crew,
            reporter.if_long(COMPILING, SAID_AFTER_S) as needless,
        ):
            return dataset.complete(crew, reporter, needless)
    except KeyboardInterrupt:
        typer.echo(
            f"stopped; {len(dataset.done):,} of {len(dataset.cut.parts):,} parts are in {out}; "
            "to go on, give the same command again",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None


def _refuse_set_aside(out: Path, summary: Summary) -> None:
    """Raise Inconclusive if parts were set aside."""
    if summary.set_aside:
        number = len(summary.set_aside)
        raise Inconclusive(
            f"{number:,} {'parts were' if number > 1 else 'part was'} set aside; the rest is in "
            f"{os.path.relpath(out)}; mend the cause and give the same command again"
        )


def _warn(summary: Summary, reporter: Reporter) -> None:
    """Say what was left out, and why."""
    for (kind, reason), count in sorted(summary.counts.items()):
        reporter.warn(f"{kind} {count:,}: {reason}")
    if summary.pruned:
        reporter.say(f"left out {summary.pruned:,} rows unread: their row groups exclude --where")
    for number, (which, reason) in enumerate(summary.set_aside.items()):
        if number == NAMED:
            reporter.warn(f"and {len(summary.set_aside) - NAMED:,} more parts, all in the manifest")
            break
        reporter.warn(f"set aside {which}: {reason}")


def _say(out: Path, summary: Summary, reporter: Reporter) -> None:
    _warn(summary, reporter)
    rate = f" ({summary.worker_rate:,.0f} a second and worker)" if summary.worker_rate else ""
    typer.echo(
        f"{out}: {summary.polygons:,} polygons, {summary.triangles:,} triangles in "
        f"{summary.parts_done:,} of {summary.parts:,} parts; {summary.seconds:.1f} s{rate}; "
        f"{summary.proven:,} proven optimal"
    )
    if summary.certified:
        typer.echo(f"{out}: {Certified.total(summary.certified)}")
