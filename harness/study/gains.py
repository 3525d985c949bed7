"""What a triangulator gains: its time in ratio to another's, for each view and shading."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from harness.metrics.groups import RecordGroup, group_run
from harness.results.record import CaseGroup, Record
from harness.results.run_folder import Run
from harness.stats.intervals import FASTER
from harness.style import draw, grid, looks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXES = {
    "resolution": "viewport (px)",
    "rotation": "rotation of the view (degrees)",
    "work": "work per fragment (iterations)",
    "samples": "samples per pixel",
}
"""What can vary in a study of gains, with the axis label."""

DRAWN = ("scene", "rasteriser", "device")
KEYS = (*AXES, "fit", "order")
"""What rows of one view share, besides the scene and the device."""


def gain_table(runs: Sequence[Run], bases: Sequence[str]) -> pd.DataFrame:
    """Return one row per case and base: the paired ratio of times and of helper lanes.

    runs : if several have a view, the first run's is used, because times of different runs are not
        paired

    Cases that left polygons out have no ratio, because they drew less.
    """
    rows = []
    seen: set[CaseGroup] = set()
    for run in runs:
        groups = group_run(run)
        for group in (group for group in groups if group.id not in seen):
            by_name = {record.name: record for record in group.measured}
            pairs = (
                _row(group, record, by_name.get(name), name)
                for record in group.measured
                for name in bases
            )
            rows += [row for row in pairs if row is not None]
        seen |= {group.id for group in groups}
    return pd.DataFrame(rows)


def _row(
    group: RecordGroup, record: Record, base: Record | None, name: str
) -> dict[str, object] | None:
    ratio = group.compare(record, base)
    if ratio is None or base is None or not ratio.quiet:
        return None
    lanes = [each.counters.get("helper_lanes") for each in (record, base)]
    where = (group.id.scene, group.id.rasteriser, group.id.device_name)
    return {
        **dict(zip(DRAWN, where, strict=True)),
        **vars(group.id.view),
        **{each: getattr(group.id.options, each) for each in ("work", "samples", "order")},
        "triangulator": record.name,
        "base": name,
        "time_ratio": ratio.value,
        "time_ratio_low": ratio.low,
        "time_ratio_high": ratio.high,
        "verdict": ratio.verdict,
        "rounds": ratio.rounds,
        "helper_lanes_ratio": lanes[0] / lanes[1] if lanes[0] and lanes[1] else None,
        "polygons": record.polygons,
    }


def best(table: pd.DataFrame, name: str) -> pd.DataFrame:
    """Return how `name` compares with all others, one row per scene, device, view and shading.

    faster : triangulators that the 95 % interval shows to be faster than it, and by how much
    """
    own = table[(table["base"] == name) & (table["triangulator"] != name)]
    told = zip(own["triangulator"], own["time_ratio"], own["verdict"], strict=True)
    said = [f"{other} {1 - ratio:.1%}" * (verdict == FASTER) for other, ratio, verdict in told]
    by_view = own.assign(faster=said).groupby([*DRAWN, *KEYS], sort=False)["faster"]
    return by_view.agg(lambda names: "; ".join(filter(None, names))).reset_index()


def by_order(table: pd.DataFrame, base: str) -> pd.DataFrame:
    """Tell what the order of triangles gains from what the diagonals gain.

    Returns a row for each view and triangulator that were drawn in their own order and in others:
    `own`, the time in ratio to the base's with both in the order in which they were made, and for
    each other order a column with the ratio in that order. What is gained there is gained by
    diagonals; what `own` gains besides is gained by the order, and any triangulation can have it.
    """
    rows = table[(table["base"] == base) & (table["triangulator"] != base)]
    if rows.empty or "native" not in set(rows["order"]) or rows["order"].nunique() < 2:
        return pd.DataFrame()
    where = [*DRAWN, *AXES, "fit", "triangulator"]
    wide = rows.pivot_table("time_ratio", where, "order", sort=False)
    others = [name for name in wide.columns if name != "native"]
    wide = wide.dropna(subset=["native"]).dropna(subset=others, how="all")
    wide.insert(0, "own", wide.pop("native"))
    return wide.reset_index().rename_axis(columns=None)


def plot(table: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the time ratios over whatever varies, one figure per scene, device and base."""
    files = []
    for keys, part in table.groupby([*DRAWN, "base"], sort=False):
        scene, rasteriser, device, base = (str(key) for key in keys)
        for axis in (axis for axis in AXES if part[axis].nunique() > 1):
            name = f"gain-{axis}-{scene}-{rasteriser}-{device}-over-{base}"
            title = f"{scene}: {rasteriser} on {device}"
            files += draw(folder, name, _figure, part, axis, base, title)
    return files


def _figure(part: pd.DataFrame, axis: str, base: str, title: str) -> Figure:
    figure, (axes,) = grid((4.6, 3.6))
    # Only this axis varies; all else is fixed where this axis has most values.
    rest = [name for name in KEYS if name != axis]
    _, fixed = max(part.groupby(rest), key=lambda group: group[1][axis].nunique())
    shown = looks(list(fixed["triangulator"]))
    others = fixed[fixed["triangulator"] != base].sort_values(axis, kind="stable")
    for name, line in others.groupby("triangulator", sort=False):
        look, ends = shown[str(name)], (line["time_ratio_low"], line["time_ratio_high"])
        style: Any = {"color": look.colour, "marker": look.marker, "markersize": 3}
        axes.plot(line[axis], line["time_ratio"], label=str(name), **style)
        axes.fill_between(line[axis], *ends, color=look.colour, alpha=0.2, linewidth=0)
    axes.axhline(1.0, color="black", linewidth=0.8, linestyle="--")
    if axis == "resolution":
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel(AXES[axis])
    axes.set_ylabel(f"time in ratio to {base}")
    axes.set_title(title, fontsize=8)
    figure.legend(loc="outside lower center", ncols=2)
    return figure
