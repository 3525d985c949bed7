"""`harness study gains`: each triangulator's time relative to base triangulators."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness import atomic
from harness.commands import options
from harness.errors import InconclusiveError, NothingMeasuredError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from harness.results.run_folder import Run

BASES = ("ear-clipping", "delaunay", "optimal:half-perimeter", "optimal:calibrated")

MAX_VIEWS_NAMED = 12  # on the screen, for each base; gains.csv has all views


def study_gains(
    runs: Annotated[list[Path], typer.Argument(help="Run folders.")],
    out: Annotated[Path, typer.Option(help="Folder for gains.csv and plots.")],
    bases: Annotated[
        options.ValueList,
        typer.Option(
            parser=options.make_list_parser(),
            metavar="NAME,...",
            help="Triangulators to compare with.",
        ),
    ] = options.ValueList(BASES),
) -> None:
    """Compare each triangulator's time with the bases' in all views; list the faster ones."""
    from harness.metrics.groups import find_mixed_processors, format_processors
    from harness.progress import Reporter
    from harness.results.run_folder import read_latest
    from harness.triangulating.recipes import parse_all

    stored = [read_latest(path, Reporter().warn) for path in runs]
    names = [str(recipe) for recipe in parse_all(bases)]
    gains = write_gains(stored, names, out)
    if mixed := find_mixed_processors(stored):
        typer.echo(f"several processors, compared separately: {format_processors(mixed)}")
    for line in gains.disturbances:
        typer.echo(f"without times: {line}")
    for name in names:
        _print_faster_views(gains.table, name)
    typer.echo(f"{len(gains.table)} ratios in {out}/gains.csv, {gains.plots} plots")


@dataclass(frozen=True)
class Gains:
    """Time ratios of quiet runs, the number of plots, and why times of other runs are not used."""

    table: pd.DataFrame
    plots: int
    disturbances: list[str]


def write_gains(runs: Sequence[Run], bases: Sequence[str], out: Path) -> Gains:
    """Write gains.csv, orders.csv and plots into `out`; raise an error without time ratios."""
    import pandas as pd

    from harness.metrics.groups import mark_processors
    from harness.results.record import CaseId
    from harness.stats.run_quality import get_run_state
    from harness.study.gains import make_gain_table, plot_gains, split_by_order

    def add_processor(case: CaseId, processor: str) -> CaseId:
        return replace(case, device=f"{case.device_name} ({processor})", host="")

    table = make_gain_table(mark_processors(runs, add_processor), bases)
    disturbances = [line for run in runs for line in get_run_state(run).warnings]
    if table.empty:
        raise NothingMeasuredError(
            "no two triangulators were timed together on the same polygons; measure two in one run"
        )
    timed = table.dropna(subset="time_ratio")
    orders = [rows.assign(base=name) for name in bases if len(rows := split_by_order(timed, name))]
    with atomic.create_folder(out, merge=True) as folder:
        files = plot_gains(timed, folder / "plots")
        table.to_csv(folder / "gains.csv", index=False, float_format="%.5g")
        if orders:
            pd.concat(orders).to_csv(folder / "orders.csv", index=False, float_format="%.4g")
    if timed.empty:
        raise InconclusiveError(disturbances[0])
    return Gains(timed, len(files), disturbances)


def _print_faster_views(table: pd.DataFrame, base: str) -> None:
    from harness.frame import View
    from harness.rasterisers.base import Options
    from harness.results.record import CaseGroup
    from harness.study.gains import list_faster

    views = list_faster(table, base)
    if views.empty:
        return
    faster = views[views["faster"] != ""]
    not_faster = len(views) - len(faster)
    typer.echo(
        f"{base}: no triangulator is significantly faster in {not_faster} of {len(views)} views"
    )
    for row in faster.head(MAX_VIEWS_NAMED).to_dict("records"):
        view = View(int(row["resolution"]), float(row["rotation"]), row["fit"])
        options = Options(int(row["samples"]), int(row["work"]), row["order"])
        group = CaseGroup(row["scene"], row["rasteriser"], row["device"], "", view, options)
        typer.echo(f"  {group}: {row['faster']} faster")
    if len(faster) > MAX_VIEWS_NAMED:
        typer.echo(f"  and {len(faster) - MAX_VIEWS_NAMED} more views")
