"""`harness merge`: several runs of one scene as one run."""

from pathlib import Path
from typing import Annotated

import typer

from harness.commands.options import Quiet, ValueList, make_list_parser
from harness.errors import UsageError
from harness.progress import Reporter


def merge(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs of one scene.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the merged run.")],
    hosts: Annotated[
        ValueList | None,
        typer.Option(
            parser=make_list_parser(),
            metavar="NAME,...",
            help="Names of the hosts that measured the runs, in the same order. Devices are then "
            "named device@host, so that devices with the same name on several hosts are not "
            "merged.",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Merge runs of one scene into one run; the order of the runs does not matter.

    The merged run has one record for each case (scene, view, triangulator, device and options).
    Measured records of the same case must be equal, unless --hosts distinguishes their devices.
    With --hosts, counters of devices with the same name must agree on all hosts.
    """
    from harness.commands.runs import make_run
    from harness.results.run_folder import read_latest
    from harness.scaling import merging

    stored = [read_latest(run, Reporter().warn) for run in runs]
    if hosts:
        if len(hosts) != len(stored):
            raise UsageError(
                f"--hosts: {len(hosts)} hosts for {len(stored)} runs; name one host for each run"
            )
        stored = [merging.set_host(run, name) for run, name in zip(stored, hosts, strict=True)]
    make_run(out, lambda folder: merging.merge_runs(stored, folder), quiet=quiet)
