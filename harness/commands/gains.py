"""`harness gains`: what the choice of a triangulator buys, over several runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.errors import NothingMeasured
from harness.store import read_run
from harness.study import gains as study


def gains(
    runs: Annotated[list[Path], typer.Argument(help="Run folders.")],
    out: Annotated[Path, typer.Option(help="Folder for gains.csv and plots.")],
) -> None:
    """Set each triangulator's time against ear clipping's and Delaunay's, over all views."""
    records = [record for path in runs for record in read_run(path).records]
    table = study.tabulate(records)
    if table.empty:
        raise NothingMeasured("no two triangulators were timed together on the same polygons")
    files = study.plot(table, out / "plots")
    table.to_csv(out / "gains.csv", index=False, float_format="%.5g")
    Console().print(
        f"{len(table)} ratios in {out}/gains.csv, {len(files)} plots", markup=False, soft_wrap=True
    )


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(gains)
