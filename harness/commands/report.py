"""`harness report`: a run as one HTML file."""

import os
from pathlib import Path
from typing import Annotated

import typer

from harness import atomic
from harness.commands.options import PROFILES, Base
from harness.progress import Reporter


def report(
    run: Annotated[Path, typer.Argument(help="Folder of a run or a study, or its cases.jsonl.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File to write; report.html in the folder if absent. With the suffix .md, .tex or "
            ".json: only the table, in Markdown, LaTeX or Bencher's JSON format.",
        ),
    ] = None,
    base: Base = None,
    profile: Annotated[
        str | None,
        typer.Option(
            help="Profile of the device for which the report predicts draw times: a file, or the "
            "name of a contributed profile, e.g. opengl-h200; by default that of run --profile.",
        ),
    ] = None,
) -> None:
    """Write the report of a run: one HTML file, which needs no network.

    If the run has no plots, as after `run --quick`, they are added to its folder.
    """
    from harness.metrics.decision import decide_run
    from harness.metrics.groups import replace_base
    from harness.profile.device_costs import find_profile, read_costs
    from harness.report.page import write_report
    from harness.results.run_folder import read_latest
    from harness.summary import FORMATS, write_table

    stored = read_latest(run, Reporter().warn)
    run_with_base = replace_base(stored, base) if base else stored
    if out is not None and out.suffix.lower() in FORMATS:
        write_table(decide_run(run_with_base), out)
        return
    device = read_costs(find_profile(profile, PROFILES)) if profile else None
    file = write_report(run_with_base, out, device=device)
    if out is None and "plan" in stored.facts and not (stored.folder / "plots").exists():
        from harness.report.plots import plot_run

        plot_run(stored)
    typer.echo(f"report: {os.path.relpath(file)}", err=atomic.is_stream(file))
