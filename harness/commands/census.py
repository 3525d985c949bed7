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


def census(
    file: Annotated[
        str, typer.Argument(help="A file of footprints, or many: 'parts/*.parquet', a folder.")
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
        float,
        typer.Option(
            min=1e-6,
            max=1e6,
            help="Scale of the map: metres a pixel, if the file is in degrees.",
        ),
    ] = 0.25,
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
    reference. Writes census.csv, cells.csv, a plot of the gains and a map of them. The same
    command, given again, does what is missing.
    """
    from harness.commands.many import census_options, count_many_files

    options = census_options(file, triangulators, units_per_pixel, cell, layer, where)
    count_many_files(file, out, options, dask, Reporter(quiet=quiet))
