"""`harness merge`: one run of several."""

from __future__ import annotations

import os
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.commands.options import Quiet, Several, several
from harness.errors import UsageError


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
    from harness.report import write_report
    from harness.scaling import merging
    from harness.stored import atomic
    from harness.stored.folder import clear_errors, read_run
    from harness.summary import print_summary, write_csv

    read = [latest(read_run(run)) for run in runs]
    for problem in chain.from_iterable(run.problems for run in read):
        Reporter().warn(problem)
    if hosts:
        if len(hosts) != len(read):
            raise UsageError(f"--hosts names {len(hosts)} hosts for {len(read)} runs: give as many")
        read = [merging.on_host(run, name) for run, name in zip(read, hosts, strict=True)]
    with clear_errors(out), atomic.folder(out) as made:
        merging.merge(read, made)
        stored = read_run(made)
        write_csv(stored.records, made / "summary.csv")
        write_report(stored)
    console = Console(quiet=quiet)
    print_summary(stored.records, console)
    console.print(f"results: {os.path.relpath(out)}", markup=False, soft_wrap=True)
