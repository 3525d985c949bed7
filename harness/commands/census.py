"""`harness census`: exact counts of every polygon or map tile of a data set."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.commands.many_files import complete_dataset, raise_if_set_aside, warn_of_skipped
from harness.commands.options import (
    Condition,
    Dask,
    Layer,
    Quiet,
    ValueList,
    Verbose,
    make_list_parser,
    refuse_given,
)
from harness.errors import InputError, NothingMeasuredError, UsageError
from harness.progress import Reporter, Screen

if TYPE_CHECKING:
    from harness.scaling.census import Census, TileCensus

MAX_DAMAGED_NAMED = 10  # unreadable tiles named on the screen

DEFAULT_TRIANGULATORS = (  # all run in compiled code
    "ear-clipping",
    "refined:half-perimeter",
    "optimal:overdraw",
    "optimal:half-perimeter",
)

UNITS_PER_PIXEL = 0.25  # in the file's units, or in metres if the file is in degrees


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
        ValueList,
        typer.Option(
            parser=make_list_parser(),
            metavar="NAME,...",
            help="Two or more triangulators; the others are compared with the first.",
        ),
    ] = ValueList(DEFAULT_TRIANGULATORS),
    units_per_pixel: Annotated[
        float | None,
        typer.Option(
            min=1e-6,
            max=1e6,
            help="Scale of the map: the file's units per pixel, or metres per pixel if the file "
            "is in degrees; by default 0.25.",
        ),
    ] = None,
    cell: Annotated[
        float | None,
        typer.Option(
            min=1e-9,
            max=1e9,
            help="Side of the cells in the map of gains, in the file's units; by default 1000, or "
            "0.01 if the first file is in degrees.",
        ),
    ] = None,
    layer: Layer = None,
    condition: Condition = None,
    dask: Dask = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Report the gain of each triangulator on every footprint of a data set, by exact counting.

    Each footprint is drawn alone on the pixel grid of a map, and counted by the CPU reference.
    Writes census.csv, cells.csv, and a plot and a map of the gains. Map tiles are drawn as maps
    draw them, cut at the tile's edge, and reported by zoom and layer. The same command, run again,
    processes the missing parts.
    """
    from harness.scaling.census import Census, TileCensus
    from harness.scaling.dataset import list_files
    from scenes.slices import has_degrees, parse_tile_selection
    from triangulators.registry import full_name

    reporter = Reporter(quiet=quiet, verbose=verbose)
    names = tuple(dict.fromkeys(map(full_name, triangulators)))
    if len(names) < 2:
        raise UsageError(f"--triangulators {','.join(triangulators)}: give two or more to compare")
    tiles = parse_tile_selection(file)
    if tiles is None:
        scale = UNITS_PER_PIXEL if units_per_pixel is None else units_per_pixel
        # About a kilometre, if the file's units are metres.
        size = cell or (0.01 if has_degrees(list_files(file)[0], layer) else 1000.0)
        _count_dataset(file, out, Census(names, scale, size, layer, condition), dask, reporter)
        return
    footprint_options: dict[str, object] = {
        "--units-per-pixel": units_per_pixel,
        "--cell": cell,
        "--layer": layer,
        "--where": condition,
    }
    reason = "is not for map tiles; write FILE:zoom=12-16,layers=building,pixels=512"
    refuse_given(footprint_options, reason)
    name, selection = tiles
    _count_dataset(name, out, TileCensus(names, selection), dask, reporter)


def _count_dataset(
    pattern: str,
    out: Path,
    census: Census | TileCensus,
    dask: str | None,
    reporter: Reporter,
) -> None:
    """Count the shading of many files' polygons or tiles; write the results, and print a table."""
    from harness.results.run_folder import translate_errors
    from harness.scaling.census import TileCensus, make_table, write_census
    from harness.scaling.counts import TOO_LARGE, TOO_THIN, CensusCounts
    from harness.scaling.dataset import Dataset
    from scenes.spec import format_suggestion

    dataset = Dataset(pattern, out / "parts", census)
    summary = complete_dataset(dataset, out, dask, reporter)
    totals = CensusCounts.read(dataset.out / f"{key}{census.suffix}" for key in dataset.keys_done)
    if summary.set_aside and not summary.parts_done and dask is None:
        raise InputError(next(iter(summary.set_aside.values())))
    warn_of_skipped(summary, dataset.out, reporter)
    counted = summary.polygons
    if not counted:
        asked = census.selection.layers or () if isinstance(census, TileCensus) else ()
        if missing := [name for name in asked if totals.layers and name not in totals.layers]:
            hint = format_suggestion(missing[0], sorted(totals.layers), "it has")
            raise UsageError(f"{pattern} has no layer {missing[0]!r}; {hint}")
        off_grid = (TOO_LARGE, TOO_THIN)
        if not any(kind == "failed" or reason in off_grid for kind, reason in summary.counts):
            condition = None if isinstance(census, TileCensus) else census.where
            filtered = f" for --where {condition}: widen the filter" if condition else ""
            raise InputError(f"{pattern} holds no usable polygon{filtered}")
        raise NothingMeasuredError(
            f"{os.path.relpath(out)}: no {census.noun[:-1]} was completed by all triangulators"
        )
    if not totals.sum_groups().get_total("fragments")[0]:
        is_tile = isinstance(census, TileCensus)
        remedy = "a larger pixels=" if is_tile else "a smaller --units-per-pixel"
        raise NothingMeasuredError(f"{os.path.relpath(out)}: no pixel is covered: give {remedy}")
    with translate_errors(out, "run the same command again"), reporter.stage("drawing", 1):
        written = write_census(out, totals, census)
    for name, reason in totals.damaged[:MAX_DAMAGED_NAMED]:
        reporter.warn(f"tile {name} {reason}")
    Screen(highlight=False).print(make_table(totals, census))
    typer.echo(
        f"{os.path.relpath(out)}: {counted:,} {census.noun} in {summary.seconds:.1f} s: "
        f"{', '.join(written)}"
    )
    # Failed polygons do not change the exit code: if one triangulator fails on a polygon, the
    # polygon is skipped for all, and a warning has given the number.
    raise_if_set_aside(out, summary)
