"""`harness census`: what each triangulator gains on every footprint of a data set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.commands.options import Dask, Layer, Quiet, Several, Where, several
from harness.progress import Reporter

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
    from harness.commands.many import count
    from harness.errors import UsageError
    from harness.scaling.census import Options, TileOptions
    from harness.scaling.parts import files
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
        count(file, out, Options(names, scale, size, layer, where), dask, reporter)
        return
    if any(given is not None for given in (units_per_pixel, cell, layer, where)):
        raise UsageError(
            f"{file} is map tiles: --units-per-pixel, --cell, --layer and --where are not for "
            "these; write FILE:zoom=12-16,layers=building,pixels=512"
        )
    name, what = tiles
    count(name, out, TileOptions(names, what), dask, reporter)
