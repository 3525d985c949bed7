"""`harness report`, `page`, `import`, `merge`: runs as HTML files, and runs made of other files."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.commands.options import Base, Quiet, Several, several
from harness.errors import UsageError
from harness.progress import Screen
from harness.settings import TIMEOUT_S

if TYPE_CHECKING:
    from harness.page import profile_result
    from harness.results.run_folder import Run


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
    from harness.metrics.groups import with_base
    from harness.report.page import write_report
    from harness.results.run_folder import read_run
    from harness.webpages import is_stream

    found = latest(read_run(run))
    for problem in found.problems:
        typer.echo(f"warning: {problem}", err=True)
    file = write_report(with_base(found, base) if base else found, out)
    if out is None and "plan" in found.facts and not (found.path / "plots").exists():
        from harness.report.plots import plot_run

        plot_run(found)
    typer.echo(f"report: {os.path.relpath(file)}", err=is_stream(file))


def page(
    run: Annotated[Path | None, typer.Argument(help="Folder of a run; none for --profile.")] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write.")] = Path("page.html"),
    profile: Annotated[
        bool,
        typer.Option("--profile", help="Of no run: a page that says what a triangle costs."),
    ] = False,
) -> None:
    """Write a page that measures a run's triangulations in any browser that has WebGPU.

    With --profile it needs no run: it says what a triangle, a pixel and a helper lane cost on the
    device that opens it, as the command profile does. One file, which needs no network and sends
    nothing. Open it on a phone, a Mac or a Windows machine; it counts, times and saves its result
    as a file for `raster-harness import`.
    """
    from harness.compare.matching import latest
    from harness.measuring.processes import Bench
    from harness.measuring.worker import Worker
    from harness.page.page_data import content_of, content_of_profile, write_page
    from harness.results.run_folder import read_run
    from harness.webpages import is_stream

    if profile == (run is not None):
        raise UsageError("a page is of a run, or of none: give its folder, or --profile alone")
    if run is None:
        with closing(Bench(Worker, timeout_s=TIMEOUT_S)) as bench:
            content = content_of_profile(bench)
    else:
        content = content_of(latest(read_run(run)))
    write_page(content, out)
    said = f"page: {os.path.relpath(out)}; open it in a browser with WebGPU"
    typer.echo(said, err=is_stream(out))


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
    gives a file as the command profile does: its draws, counters and law are computed anew, and
    refused if the page's contradict them. Given the folder of a run that was measured here, it
    writes its --summary and nothing else.
    """
    from harness.commands.running import folder_for
    from harness.compare.matching import latest
    from harness.page import profile_result
    from harness.page.device_summaries import write_summary
    from harness.page.result import FORMAT, Result, import_result
    from harness.page.saved import Measured, device_name, read_saved
    from harness.results.run_folder import file_stem, read_run

    if file.is_dir():
        if summary is None:
            raise UsageError(f"{file} is a run already; give --summary FILE for its summary")
        here = latest(read_run(file))
        if device:
            here = replace(here, records=[r for r in here.records if r["device"] == device])
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
    origin = latest(read_run(run)) if run else None
    folder = folder_for(name, out)
    stored = _made(folder, lambda made: import_result(result, made, name, origin), quiet=quiet)
    for warning in stored.facts["warnings"]:
        typer.echo(f"warning: {warning}", err=True)
    if summary is not None:
        write_summary(stored, summary)


def _made(folder: Path, make: Callable[[Path], object], *, quiet: bool) -> Run:
    """Make a run's folder with its table and report, whole or not at all, and print its summary."""
    from harness import atomic
    from harness.report.page import write_report
    from harness.results.run_folder import clear_errors, read_run
    from harness.summary import print_summary, write_csv

    with clear_errors(folder), atomic.folder(folder) as made:
        make(made)
        stored = read_run(made)
        write_csv(stored.records, made / "summary.csv")
        write_report(stored)
    stored = read_run(folder)
    console = Screen(quiet=quiet)
    print_summary(stored.records, console)
    console.print(f"results: {os.path.relpath(folder)}", markup=False, soft_wrap=True)
    return stored


def _import_profile(
    file: Path, result: profile_result.Result, device: str, out: Path | None
) -> None:
    """Write the profile that a page's result tells, with its advice, and print it."""
    from harness.commands.profile import add_advice, tell
    from harness.measuring.processes import Bench
    from harness.measuring.worker import Worker
    from harness.page.profile_result import import_profile

    content, trouble, warnings = import_profile(file, result, device)
    with closing(Bench(Worker, timeout_s=TIMEOUT_S)) as bench:
        add_advice(content, bench, trouble)
    for warning in warnings:
        typer.echo(f"warning: {warning}", err=True)
    tell(content, out, trouble)


def merge(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs of one scene.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the merged run.")],
    hosts: Annotated[
        Several | None,
        typer.Option(
            parser=several(),
            metavar="NAME,...",
            help="One for each run: the host it was measured on. Its devices are "
            "called device@host then, so that one kind of device on several hosts stays apart.",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Merge runs into one, by case; the order in which they are given does not matter.

    Counters of one kind of device must be equal on all hosts.
    """
    from harness.compare.matching import latest
    from harness.progress import Reporter
    from harness.results.run_folder import read_run
    from harness.scaling import merging

    read = [latest(read_run(run)) for run in runs]
    for problem in chain.from_iterable(run.problems for run in read):
        Reporter().warn(problem)
    if hosts:
        if len(hosts) != len(read):
            raise UsageError(f"--hosts names {len(hosts)} hosts for {len(read)} runs: give as many")
        read = [merging.on_host(run, name) for run, name in zip(read, hosts, strict=True)]
    _made(out, lambda made: merging.merge(read, made), quiet=quiet)
