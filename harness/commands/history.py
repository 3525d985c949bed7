"""`harness history`: metrics over many runs, and where they changed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from harness.commands.options import split_names
from harness.errors import NothingMeasured

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harness.history import Series
    from harness.stored.folder import Run


def history(
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Run folders, or folders that hold them.")
    ],
    metrics: Annotated[
        str, typer.Option(help="Comma-separated: time, and names from: harness list metrics.")
    ] = "quads,helper_lanes,bbox_tests,time",
    out: Annotated[Path, typer.Option(help="Folder for the plots and history.csv.")] = Path(
        "results/history"
    ),
) -> None:
    """Draw metrics over runs, in the order in which the runs were made, and mark changes.

    A counter changes wherever it differs from the run before. A time is compared with the times of
    the other cases of its run; it changes if its level changes for three runs or more.
    """
    from harness.history import find_runs, read_series
    from harness.history.figures import plot_history

    runs = find_runs(folders)
    series = read_series(runs, split_names(metrics))
    if not series:
        raise NothingMeasured(f"none of the {len(runs)} runs has any of: {metrics}")
    plot_history(runs, series, out)
    _write_csv(runs, series, out / "history.csv")
    console = Console()
    for run in runs:
        for problem in run.problems:
            console.print(f"warning: {problem}", markup=False, soft_wrap=True)
    for line in changes(runs, series):
        console.print(line, markup=False, soft_wrap=True, highlight=False)
    console.print(f"{len(runs)} runs, {len(series)} series: {out}", markup=False, soft_wrap=True)


def changes(runs: Sequence[Run], series: Sequence[Series]) -> list[str]:
    """Return one line for each change: when, of what, from which level to which."""
    import numpy as np

    from harness.compare.wording import figure, percent
    from harness.history.figures import run_label

    lines = []
    for entry in series:
        cuts = [0, *entry.changes, len(entry.values)]
        for before, place, after in zip(cuts, cuts[1:], cuts[2:], strict=False):
            levels = [
                float(np.nanmedian(entry.values[start:end]))
                for start, end in ((before, place), (place, after))
            ]
            growth = f" ({percent(levels[1] / levels[0] - 1)})" if levels[0] else ""
            where = f"{entry.name.triangulator}, {entry.name.where}"
            label = run_label(runs[place]).replace("\n", ", ")
            lines.append(
                f"{label}: {entry.metric} of {where}: "
                f"{figure(levels[0])} → {figure(levels[1])}{growth}"
            )
    return lines or ["nothing changed"]


def _write_csv(runs: Sequence[Run], series: Sequence[Series], file: Path) -> None:
    """Write one row for each value of each series."""
    import csv

    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["run", "created", "metric", "triangulator", "where", "value", "change"])
        for entry in series:
            for number, (run, value) in enumerate(zip(runs, entry.values, strict=True)):
                created = run.facts.get("created") or ""
                name = entry.name
                cell = "" if value != value else repr(float(value))
                row = [run.path, created, entry.metric, name.triangulator, name.where, cell]
                writer.writerow([*row, int(number in entry.changes)])


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(history)
