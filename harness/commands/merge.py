"""`harness merge`: several runs of one scene as one run."""

from pathlib import Path
from typing import Annotated

import typer

from harness.commands.options import Quiet, Several, several
from harness.errors import UsageError
from harness.progress import Reporter


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
    from harness.commands.outcome import make_run
    from harness.results.run_folder import read_latest
    from harness.scaling import merging

    read = [read_latest(run, Reporter().warn) for run in runs]
    if hosts:
        if len(hosts) != len(read):
            raise UsageError(f"--hosts names {len(hosts)} hosts for {len(read)} runs: give as many")
        read = [merging.on_host(run, name) for run, name in zip(read, hosts, strict=True)]
    make_run(out, lambda folder: merging.merge(read, folder), quiet=quiet)
