"""`harness report`: one HTML file that shows a run or a study."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from harness.commands.options import Base


def report(
    run: Annotated[Path, typer.Argument(help="Folder of a run or a study, or its cases.jsonl.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="File to write; report.html in the folder if absent."),
    ] = None,
    base: Base = None,
) -> None:
    """Write the report of a run: one HTML file, which needs no network.

    Where the plots of a run are missing, as after `run --quick`, they are drawn into its folder.
    """
    from harness.compare.matching import latest
    from harness.figures.groups import with_base
    from harness.report import write_report
    from harness.stored.folder import read_run
    from harness.webpages.single_file import is_stream

    found = latest(read_run(run))
    file = write_report(with_base(found, base) if base else found, out)
    if out is None and "plan" in found.facts and not (found.path / "plots").exists():
        from harness.report.plots import plot_run

        plot_run(found)
    typer.echo(f"report: {os.path.relpath(file)}", err=is_stream(file))
