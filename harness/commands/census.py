"""`harness census`, and what else works through data sets of many files, with --dask or without."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.commands.options import Dask, Layer, Quiet, Several, Where, refuse_given, several
from harness.errors import (
    INTERRUPTED,
    Inconclusive,
    NothingMeasured,
    UsageError,
    refuse_failed,
)
from harness.progress import Reporter, Screen

if TYPE_CHECKING:
    from harness.scaling.census import Census, TileCensus
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
    summary = _complete(Dataset(pattern, out, work), out, where, reporter)
    _warn(summary, out, reporter)
    typer.echo(
        f"{out}: {summary.polygons:,} polygons, {summary.triangles:,} triangles in "
        f"{summary.parts_done:,} of {summary.parts:,} parts; {summary.seconds:.1f} s; "
        f"{summary.proven:,} proven optimal"
    )
    if summary.certified:
        typer.echo(f"{out}: {Certified.total(summary.certified)}")
    _refuse_set_aside(out, summary)
    refuse_failed(summary.counts, out)


def count(
    pattern: str,
    out: Path,
    census: Census | TileCensus,
    where: str | None,
    reporter: Reporter,
) -> None:
    """Count the polygons of many files or tiles, write what came out, and show a table.

    Raises
    ------
    UsageError
        if there is no file, or none with a polygon, or the folder is not for that
    NothingMeasured
        if there are polygons, but none that all could do
    Inconclusive
        if parts were set aside
    """
    from harness.results.run_folder import clear_errors
    from harness.scaling import census_report
    from harness.scaling.census import THIN, TileCensus
    from harness.scaling.dataset import Dataset
    from harness.scaling.sums import Counted
    from scenes.spec import suggestion

    dataset = Dataset(pattern, out / "parts", census)
    summary = _complete(dataset, out, where, reporter)
    found = Counted.read(dataset.out / f"{key}{census.suffix}" for key in dataset.keys_done)
    if summary.set_aside and not summary.parts_done and where is None:
        raise UsageError(next(iter(summary.set_aside.values())))
    _warn(summary, dataset.out, reporter)
    counted = summary.polygons
    if not counted:
        asked = census.chosen.layers or () if isinstance(census, TileCensus) else ()
        if missing := [name for name in asked if found.known and name not in found.known]:
            hint = suggestion(missing[0], sorted(found.known), "it has")
            raise UsageError(f"{pattern} has no layer {missing[0]!r}; {hint}")
        if not any(kind == "failed" or why == THIN for kind, why in summary.counts):
            condition = getattr(census, "where", None)
            filtered = f" for where={condition}: widen the filter" if condition else ""
            raise UsageError(f"{pattern} holds no usable polygon{filtered}")
        raise NothingMeasured(
            f"{os.path.relpath(out)}: no {census.noun[:-1]} was done by all triangulators"
        )
    if not found.whole().total("fragments")[0]:
        what = "pixels=" if isinstance(census, TileCensus) else "--units-per-pixel"
        raise NothingMeasured(f"{os.path.relpath(out)}: no pixel is covered: choose another {what}")
    with clear_errors(out, "give the same command again"), reporter.stage("drawing", 1):
        written = census_report.write(out, found, census)
    for name, why in found.damaged[:NAMED]:
        reporter.warn(f"tile {name} {why}")
    Screen(highlight=False).print(census_report.table(found, census))
    typer.echo(
        f"{os.path.relpath(out)}: {counted:,} {census.noun} in {summary.seconds:.1f} s: "
        f"{', '.join(written)}"
    )
    # A polygon that one triangulator cannot do is left out for all: a warning tells how many.
    _refuse_set_aside(out, summary)


def _complete(dataset: Dataset, out: Path, where: str | None, reporter: Reporter) -> Summary:
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


def _refuse_set_aside(out: Path, summary: Summary) -> None:
    """Raise Inconclusive if parts were set aside."""
    if summary.set_aside:
        number = len(summary.set_aside)
        raise Inconclusive(
            f"{number:,} {'parts were' if number > 1 else 'part was'} set aside; the rest is in "
            f"{os.path.relpath(out)}; mend the cause and give the same command again"
        )


def _warn(summary: Summary, folder: Path, reporter: Reporter) -> None:
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


CENSUS = (
    "ear-clipping",
    "refined:half-perimeter",
    "optimal:overdraw",
    "optimal:half-perimeter",
)
"""Triangulators of a census; compiled code does all of them."""

UNITS_PER_PIXEL = 0.25
"""Metres a pixel, unless asked otherwise."""


def census(
    file: Annotated[
        str,
        typer.Argument(
            help="A file of footprints, or many: 'parts/*.parquet', a folder. Or map tiles: "
            "berlin.pmtiles, berlin.pmtiles:zoom=12-16,layers=building,pixels=512."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.")],
    triangulators: Annotated[
        Several,
        typer.Option(
            parser=several(),
            metavar="NAME,...",
            help="Two or more, comma-separated; the others are compared with the first.",
        ),
    ] = Several(CENSUS),
    units_per_pixel: Annotated[
        float | None,
        typer.Option(
            min=1e-6,
            max=1e6,
            help="Scale of the map: metres a pixel, if the file is in degrees; by default 0.25.",
        ),
    ] = None,
    cell: Annotated[
        float | None,
        typer.Option(
            min=1e-9,
            max=1e9,
            help="Edge of a cell of the picture's map, in the file's units; by default 1000, or "
            "0.01 where the first file is in degrees.",
        ),
    ] = None,
    layer: Layer = None,
    where: Where = None,
    dask: Dask = None,
    quiet: Quiet = False,
) -> None:
    """Say what each triangulator gains on every footprint of a data set, by exact counting.

    Footprints are drawn on the pixel grid of a map, each by itself, and counted by the CPU
    reference. Writes census.csv, cells.csv, a plot of the gains and a map of them. Map tiles are
    drawn as maps draw them, each cut at its edge, and have a line for each zoom and layer. The same
    command, given again, does what is missing.
    """
    from harness.scaling.census import Census, TileCensus
    from harness.scaling.dataset import files
    from scenes.slices import chosen, in_degrees
    from triangulators.registry import full_name

    reporter = Reporter(quiet=quiet)
    names = tuple(map(full_name, triangulators))
    if len(set(names)) < 2:
        raise UsageError(f"--triangulators {','.join(triangulators)}: give two or more to compare")
    tiles = chosen(file)
    if tiles is None:
        scale = UNITS_PER_PIXEL if units_per_pixel is None else units_per_pixel
        # A thousand units, or a hundredth of a degree: a kilometre.
        size = cell or (0.01 if in_degrees(files(file)[0]) else 1000.0)
        count(file, out, Census(names, scale, size, layer, where), dask, reporter)
        return
    of_files: dict[str, object] = {
        "--units-per-pixel": units_per_pixel,
        "--cell": cell,
        "--layer": layer,
        "--where": where,
    }
    refuse_given(of_files, "is not for map tiles; write FILE:zoom=12-16,layers=building,pixels=512")
    name, what = tiles
    count(name, out, TileCensus(names, what), dask, reporter)
