"""`harness study gains`: time relative to base triangulators, for each view and shading."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness import atomic
from harness.commands import options
from harness.errors import InconclusiveError, NothingMeasuredError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd
    from matplotlib.figure import Figure

    from harness.metrics.groups import RecordGroup
    from harness.results.record import CaseGroup, Record
    from harness.results.run_folder import Run

BASES = ("ear-clipping", "delaunay", "optimal:half-perimeter", "optimal:calibrated")

MAX_VIEWS_NAMED = 12  # on the screen, for each base; gains.csv has all views

AXES = {  # conditions that a study of gains may vary, with labels for plots
    "resolution": "viewport (px)",
    "rotation": "rotation of the view (degrees)",
    "work": "work per fragment (iterations)",
    "samples": "samples per pixel",
}

SCENE_KEYS = ("scene", "rasteriser", "device")
KEYS = (*AXES, "fit", "order")  # columns that identify a view, in addition to `SCENE_KEYS`
TIME_RATIOS = ("time_ratio", "time_ratio_low", "time_ratio_high")


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
    from harness.metrics.run_quality import get_run_state
    from harness.results.record import CaseId

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


def make_gain_table(runs: Sequence[Run], bases: Sequence[str]) -> pd.DataFrame:
    """Return one row per case and base: the paired ratio of times, and the ratio of helper lanes.

    Of runs with the same view the first is used, because times of different runs are not paired.
    Cases that skipped polygons have no row; textured cases are omitted. If the times of a run are
    disturbed, their ratios are NaN.
    """
    import pandas as pd

    from harness.metrics.groups import group_run

    rows = []
    seen: set[CaseGroup] = set()
    for run in runs:
        groups = group_run(run)
        for group in groups:
            if group.id in seen or group.id.options.texture:
                continue
            by_name = {record.name: record for record in group.measured}
            pairs = (
                _make_row(group, record, by_name.get(name), name)
                for record in group.measured
                for name in bases
            )
            rows += [row for row in pairs if row is not None]
        seen |= {group.id for group in groups}
    return pd.DataFrame(rows)


def _make_row(
    group: RecordGroup, record: Record, base: Record | None, name: str
) -> dict[str, object] | None:
    ratio = group.compute_ratio(record, base)
    if ratio is None or base is None:
        return None
    times = (ratio.value, ratio.low, ratio.high) if ratio.quiet else (nan,) * 3
    case, options = group.id, group.id.options
    lanes, base_lanes = record.counters.get("helper_lanes"), base.counters.get("helper_lanes")
    return {
        **dict(zip(SCENE_KEYS, (case.scene, case.rasteriser, case.device_name), strict=True)),
        **vars(case.view),
        "work": options.work,
        "samples": options.samples,
        "order": options.order,
        "triangulator": record.name,
        "base": name,
        **dict(zip(TIME_RATIOS, times, strict=True)),
        "verdict": ratio.verdict,
        "rounds": ratio.rounds,
        "helper_lanes_ratio": lanes / base_lanes if lanes and base_lanes else None,
        "polygons": record.polygons,
    }


def list_faster(table: pd.DataFrame, base: str) -> pd.DataFrame:
    """Return a row per view, whose column `faster` has the triangulators faster than `base`."""
    from harness.metrics.statistics import FASTER

    rows = table[(table["base"] == base) & (table["triangulator"] != base)]
    columns = zip(rows["triangulator"], rows["time_ratio"], rows["verdict"], strict=True)
    faster = [f"{name} {1 - ratio:.1%}" * (verdict == FASTER) for name, ratio, verdict in columns]
    by_view = rows.assign(faster=faster).groupby([*SCENE_KEYS, *KEYS], sort=False)["faster"]
    return by_view.agg(lambda names: "; ".join(filter(None, names))).reset_index()


def split_by_order(table: pd.DataFrame, base: str) -> pd.DataFrame:
    """Separate the gain of the triangles' order from the gain of the diagonals.

    Returns a row for each view and triangulator, with the time relative to the base in native order
    (`native`) and in each other order. The gain in a common order is that of the diagonals; the
    additional gain of `native` is that of the order, which any triangulation can have.
    """
    import pandas as pd

    rows = table[(table["base"] == base) & (table["triangulator"] != base)]
    if rows.empty or "native" not in set(rows["order"]) or rows["order"].nunique() < 2:
        return pd.DataFrame()
    keys = [*SCENE_KEYS, *AXES, "fit", "triangulator"]
    wide = rows.pivot_table("time_ratio", keys, "order", sort=False)
    orders = [name for name in wide.columns if name != "native"]
    wide = wide.dropna(subset=["native"]).dropna(subset=orders, how="all")
    wide.insert(0, "native", wide.pop("native"))
    return wide.reset_index().rename_axis(columns=None)


def plot_gains(table: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the time ratios over each axis that varies, one figure per scene, device and base."""
    from harness.style import draw_figure

    files = []
    for keys, part in table.groupby([*SCENE_KEYS, "base"], sort=False):
        scene, rasteriser, device, base = (str(key) for key in keys)
        for axis in (axis for axis in AXES if part[axis].nunique() > 1):
            name = f"gain-{axis}-{scene}-{rasteriser}-{device}-over-{base}"
            title = f"{scene}: {rasteriser} on {device}"
            files += draw_figure(folder, name, _draw_gains, part, axis, base, title)
    return files


def _draw_gains(part: pd.DataFrame, axis: str, base: str, title: str) -> Figure:
    from harness.style import choose_looks, make_figure

    figure, (axes,) = make_figure((4.6, 3.6))
    # Only this axis varies: of the combinations of the other fields' values, the one with the most
    # points on the axis is drawn.
    fixed_keys = [name for name in KEYS if name != axis]
    _, fixed = max(part.groupby(fixed_keys), key=lambda group: group[1][axis].nunique())
    styles = choose_looks(list(fixed["triangulator"]))
    rows = fixed[fixed["triangulator"] != base].sort_values(axis, kind="stable")
    for name, line in rows.groupby("triangulator", sort=False):
        look, ends = styles[str(name)], (line["time_ratio_low"], line["time_ratio_high"])
        style: Any = {"color": look.colour, "marker": look.marker, "markersize": 3}
        axes.plot(line[axis], line["time_ratio"], label=str(name), **style)
        axes.fill_between(line[axis], *ends, color=look.colour, alpha=0.2, linewidth=0)
    axes.axhline(1.0, color="black", linewidth=0.8, linestyle="--")
    if axis == "resolution":
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel(AXES[axis])
    axes.set_ylabel(f"time relative to {base}")
    axes.set_title(title, fontsize=8)
    figure.legend(loc="outside lower center", ncols=2)
    return figure
