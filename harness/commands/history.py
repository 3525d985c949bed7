"""`harness history`: metrics over many runs, with changes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.commands.options import ValueList, make_list_parser
from harness.errors import NothingMeasuredError
from harness.settings import HISTORY_METRICS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harness.history import Series
    from harness.results.run_folder import Run


def _make_filter_option(kind: str) -> Any:
    return typer.Option(parser=make_list_parser(), metavar="NAME,...", help=f"Only these {kind}.")


def history(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Runs, or folders that contain runs."),
    ],
    metrics: Annotated[
        ValueList,
        typer.Option(
            "--metrics",
            "--metric",
            parser=make_list_parser(),
            metavar="NAME,...",
            help="Metrics: time, or a name of: raster-harness list metrics. By default time and "
            "the counters that represent the cost.",
        ),
    ] = ValueList(HISTORY_METRICS),
    scene: Annotated[ValueList | None, _make_filter_option("scenes")] = None,
    triangulator: Annotated[ValueList | None, _make_filter_option("triangulators")] = None,
    rasteriser: Annotated[ValueList | None, _make_filter_option("rasterisers")] = None,
    everything: Annotated[
        bool,
        typer.Option("--all", help="Include studies, and cases that only one run measured."),
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder for the plots and history.csv.")] = Path(
        "results/history"
    ),
) -> None:
    """Show changes over runs, in the order of their creation.

    A counter changed if its value differs from the previous run's. Times are relative to the other
    cases of the same run, if it has any; a time changed if its level shifts for three runs or more.
    At most a dozen series are shown, those with the largest changes: select by --scene,
    --triangulator, --rasteriser, --metric, or --all. Studies are skipped, as they measure each case
    once.
    """
    from harness import atomic
    from harness.history import filter_series, find_runs, plot_history, read_series, select_series
    from harness.metrics.groups import find_mixed_processors, format_processors
    from harness.style import format_count

    runs, studies = find_runs(folders, studies=everything)
    if studies:
        typer.echo(f"skipped: {format_count(studies, 'study', 'studies')}; see --all")
    if not runs:
        raise NothingMeasuredError("all runs are studies; give --all to include studies")
    filters = {"scene": scene, "triangulator": triangulator, "rasteriser": rasteriser}
    series = filter_series(read_series(runs, metrics), {k: v for k, v in filters.items() if v})
    if not series:
        raise NothingMeasuredError(
            f"no selected case of {len(runs)} runs has a value of {metrics}; give other --metrics, "
            "or fewer filters"
        )
    shown_series = series if everything else select_series(series)
    if shown_series:
        with atomic.create_folder(out, merge=True) as folder:
            plot_history(runs, shown_series, folder)
            _write_csv(runs, shown_series, folder / "history.csv")
    for run in runs:
        for problem in run.problems:
            typer.echo(f"warning: {problem}")
    if mixed := find_mixed_processors(runs):
        typer.echo(f"several processors, compared separately: {format_processors(mixed)}")
    for line in format_changes(runs, shown_series):
        typer.echo(line)
    hidden = len(series) - len(shown_series)
    hint = f"; {hidden:,} more series: --all, or choose by --scene, --triangulator ..." * bool(
        hidden
    )
    destination = str(out) if shown_series else "no case was measured by two runs"
    typer.echo(f"{format_count(len(runs), 'run')}, {len(shown_series)} series: {destination}{hint}")


def format_changes(runs: Sequence[Run], series: Sequence[Series]) -> list[str]:
    """Return a line for each change: the run, the metric and case, and both levels."""
    from harness.history import format_run_label
    from harness.style import format_step

    lines = []
    for entry in series:
        subject = f"{entry.metric} of {entry.id.name}, {entry.id.group}"
        for position, (before, after) in zip(entry.changes, entry.steps, strict=True):
            label = format_run_label(runs[position]).replace("\n", ", ")
            lines.append(f"{label}: {subject}: {format_step(before, after)}")
    return lines or ["nothing changed"]


def _write_csv(runs: Sequence[Run], series: Sequence[Series], file: Path) -> None:
    import pandas as pd

    rows = []
    for entry in series:
        case = (entry.metric, entry.id.name, str(entry.id.group))
        for number, (run, value) in enumerate(zip(runs, entry.values, strict=True)):
            created = run.facts.get("created") or ""
            rows.append((run.path, created, *case, value, int(number in entry.changes)))
    names = ["run", "created", "metric", "triangulator", "where", "value", "change"]
    pd.DataFrame(rows, columns=names).to_csv(file, index=False, lineterminator="\r\n")
