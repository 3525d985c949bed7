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
    file: Annotated[Path, typer.Argument(help="File saved by a page, or a run's folder.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for the run, by default results/<device>-<time>; for a profile, its file, "
            "by default in results/profiles.",
        ),
    ] = None,
    run: Annotated[
        Path | None,
        typer.Option(
            help="The run from which the page was made; its frames and predictions are copied, so "
            "that the report also shows single polygons."
        ),
    ] = None,
    device: Annotated[
        str,
        typer.Option(
            help="Name of the device, by default the browser's name for it; for a run's folder, "
            "the device to summarise."
        ),
    ] = "",
    summary: Annotated[
        Path | None,
        typer.Option(help="Also write a small summary of the device, for results/devices/."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Make a run folder, or a profile, from a file that a measuring page saved.

    `report`, `compare`, `gains` and `history` read the run like any other. The result of a page
    made with --profile becomes a profile, as the command profile writes: the draws, the counters
    and the fitted cost model (law) are computed again, and a result that differs from these is
    refused. Given the folder of a run, the command writes only the --summary of the run's device.
    """
    from harness.commands.runs import choose_folder, make_run
    from harness.page import profile_result
    from harness.page.device_summaries import write_summary
    from harness.page.result import FORMAT, Result, import_result
    from harness.page.saved import Measured, make_device_name, read_saved
    from harness.results.run_folder import make_file_stem, read_latest

    if file.is_dir():
        if summary is None:
            raise UsageError(f"{file} is a run already; give --summary FILE for its summary")
        if out or run:
            raise UsageError(f"{file} is a run; --out and --run are only for files of a page")
        measured_run = read_latest(file, Reporter().warn)
        if device:
            measured_run = replace(
                measured_run,
                records=[r for r in measured_run.records if r.id.device_name == device],
            )
        typer.echo(f"summary: {os.path.relpath(write_summary(measured_run, summary))}")
        return
    kinds: dict[str, type[Measured]] = {
        FORMAT: Result,
        profile_result.FORMAT: profile_result.Result,
    }
    result = read_saved(file, kinds)
    name = make_file_stem(device) or make_device_name(result)
    if isinstance(result, profile_result.Result):
        if run or summary:
            raise UsageError(f"{file} is a profile; --run and --summary are only for runs")
        _import_profile(file, result, name, out)
        return
    assert isinstance(result, Result)
    origin = read_latest(run, Reporter().warn) if run else None
    folder = choose_folder(name, out)
    stored = make_run(
        folder, lambda folder: import_result(result, folder, name, origin), quiet=quiet
    )
    for warning in stored.facts["warnings"]:
        typer.echo(f"warning: {warning}", err=True)
    if summary is not None:
        write_summary(stored, summary)


def _import_profile(
    file: Path, result: profile_result.Result, device: str, out: Path | None
) -> None:
    from harness.commands.profile import add_advice, write_profile
    from harness.measuring.pool import MeasuringPool
    from harness.page.profile_result import import_profile
    from harness.worker import Worker

    content, trouble, warnings = import_profile(file, result, device)
    with closing(MeasuringPool(Worker, timeout_s=TIMEOUT_S)) as pool:
        add_advice(content, pool, trouble)
    for warning in warnings:
        typer.echo(f"warning: {warning}", err=True)
    write_profile(content, out, trouble)
