"""`harness import`: a run, or a profile, from a file that a measuring page saved."""

from __future__ import annotations

import os
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.commands.options import Quiet
from harness.errors import UsageError
from harness.progress import Reporter
from harness.settings import TIMEOUT_S

if TYPE_CHECKING:
    from harness.page import profile_result


def import_(
    file: Annotated[Path, typer.Argument(help="What a page saved, or a run's folder.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for the run, results/<device>-<time> if absent; file for the profile.",
        ),
    ] = None,
    run: Annotated[
        Path | None,
        typer.Option(
            help="The run that the page was made of: its frames and predictions come along, so "
            "that the report shows single polygons, too."
        ),
    ] = None,
    device: Annotated[
        str,
        typer.Option(
            help="Name of the device, by default what the browser calls it; of a run's folder, "
            "the device to summarise."
        ),
    ] = "",
    summary: Annotated[
        Path | None,
        typer.Option(help="Write a small summary of the device, too, for results/devices/."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Make a run folder, or a profile, of what a measuring page saved.

    `report`, `compare`, `gains` and `history` read the run like any other. A page of --profile
    gives a file as the command profile does: its draws, counters and law are computed again, and
    refused if the page's contradict them. Given the folder of a run that was measured here, it
    writes its --summary and nothing else.
    """
    from harness.commands.outcome import folder_for, make_run
    from harness.page import profile_result
    from harness.page.device_summaries import write_summary
    from harness.page.result import FORMAT, Result, import_result
    from harness.page.saved import Measured, device_name, read_saved
    from harness.results.run_folder import file_stem, read_latest

    if file.is_dir():
        if summary is None:
            raise UsageError(f"{file} is a run already; give --summary FILE for its summary")
        here = read_latest(file, Reporter().warn)
        if device:
            here = replace(here, records=[r for r in here.records if r.id.device_name == device])
        typer.echo(f"summary: {os.path.relpath(write_summary(here, summary))}")
        return
    kinds: dict[str, type[Measured]] = {
        FORMAT: Result,
        profile_result.FORMAT: profile_result.Result,
    }
    result = read_saved(file, kinds)
    name = file_stem(device) or device_name(result)
    if isinstance(result, profile_result.Result):
        if run or summary:
            raise UsageError(f"{file} is a profile, which has neither --run nor --summary")
        _import_profile(file, result, name, out)
        return
    assert isinstance(result, Result)
    origin = read_latest(run, Reporter().warn) if run else None
    folder = folder_for(name, out)
    stored = make_run(folder, lambda made: import_result(result, made, name, origin), quiet=quiet)
    for warning in stored.facts["warnings"]:
        typer.echo(f"warning: {warning}", err=True)
    if summary is not None:
        write_summary(stored, summary)


def _import_profile(
    file: Path, result: profile_result.Result, device: str, out: Path | None
) -> None:
    """Write and print the profile of a page's result, with its recommendations."""
    from harness.commands.profile import add_advice, write_profile
    from harness.measuring.pool import MeasuringPool
    from harness.page.profile_result import import_profile
    from harness.workers.worker import Worker

    content, trouble, warnings = import_profile(file, result, device)
    with closing(MeasuringPool(Worker, timeout_s=TIMEOUT_S)) as pool:
        add_advice(content, pool, trouble)
    for warning in warnings:
        typer.echo(f"warning: {warning}", err=True)
    write_profile(content, out, trouble)
