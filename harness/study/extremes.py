"""The best triangulation against the worst, by a criterion: the predicted and the measured ratio.

A correlation says whether a criterion sorts triangulations correctly; this says how large the
difference is. The paper's own claim is of this kind: of the triangulations that it lists for its
polygon, the one with the least A has 2.96 times less A than the one with the most.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from rich.console import Console

from harness.figures.groups import groups, time_ratio
from harness.figures.registry import find, measures, predictions
from harness.pictures.style import COLOURS, draw, plain_table
from harness.stored.folder import Record
from harness.study.analysis import TIME, label, without_twins

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = (
    *("scene", "rasteriser", "device", "resolution", "samples", "criterion", "among"),
    *("best", "worst", "predicted_ratio", "measure", "ratio", "ratio_low", "ratio_high"),
)


def extremes_table(records: Sequence[Record]) -> pd.DataFrame:
    """Return `COLUMNS`: worst in ratio to best of each polygon, by each criterion and measure.

    among : "conforming", or "all" if allowing T-junctions changes which is best or worst
    ratio_low, ratio_high : the 95 % interval of a time's ratio; counters are exact
    """
    rows = []
    for members in groups(records):
        good = [record for record in members if record["status"] == "ok" and record["polygons"]]
        for criterion in predictions():
            known = [record for record in good if criterion in record["predicted"]]
            rows += _rows(known, criterion)
    table = pd.DataFrame(rows, columns=COLUMNS)
    # Counters do not depend on the work a fragment does: one row for all of them.
    counted = ~table["measure"].str.startswith("time")
    return table[~(counted & table.duplicated())].reset_index(drop=True)


def _rows(good: Sequence[Record], criterion: str) -> list[dict[str, Any]]:
    conforming = [record for record in good if record["conforming"]]
    ends = {"conforming": _ends(conforming, criterion), "all": _ends(good, criterion)}
    if ends["all"] == ends["conforming"]:
        del ends["all"]
    rows = []
    for among, pair in ends.items():
        if pair is None:
            continue
        best, worst = pair
        shared = {
            **{name: best[name] for name in ("scene", "rasteriser", "device", "resolution")},
            "samples": best["options"]["samples"],
            "criterion": find(criterion).written,
            "among": among,
            "best": best["triangulator"],
            "worst": worst["triangulator"],
            "predicted_ratio": _over(worst, best, "predicted", criterion),
        }
        for measure in measures(best["counters"]):
            ratio = _over(worst, best, "counters", measure)
            if ratio is not None:
                rows.append({**shared, "measure": measure, "ratio": ratio})
        if (timed := time_ratio(worst, best)) is not None:
            span = {"ratio": timed.value, "ratio_low": timed.low, "ratio_high": timed.high}
            rows.append(shared | {"measure": f"{TIME}{best['options']['work']}"} | span)
    return rows


def _ends(records: Sequence[Record], criterion: str) -> tuple[Record, Record] | None:
    """Return the records with the least and the most of a criterion; the first of several."""
    if len(records) < 2:
        return None
    ordered = sorted(records, key=lambda record: record["predicted"][criterion])
    most = ordered[-1]["predicted"][criterion]
    return ordered[0], next(r for r in ordered if r["predicted"][criterion] == most)


def _over(worst: Record, best: Record, part: str, name: str) -> float | None:
    above, below = ((record.get(part) or {}).get(name) for record in (worst, best))
    return above / below if above is not None and below else None


def print_claim(table: pd.DataFrame, criterion: str, console: Console) -> None:
    """Print the measured cost of the worst triangulation by `criterion` in ratio to the best."""
    part = table[table["criterion"] == criterion]
    for among, rows in part.groupby("among", sort=False):
        predicted = rows.drop_duplicates("scene")["predicted_ratio"].median()
        word = ", with T-junctions," if among == "all" else ""
        title = f"worst triangulation by {criterion}{word} in ratio to the best: predicted "
        title += f"{predicted:.2f}, measured:"
        shown = plain_table(title, "rasteriser", "device", "measure", ">ratio")
        for names, ratios in rows.groupby(["rasteriser", "device", "measure"], sort=False)["ratio"]:
            rasteriser, device, measure = (str(name) for name in names)
            shown.add_row(rasteriser, device, label(measure), f"{ratios.median():.3f}")
        console.print(shown)


def write(records: Sequence[Record], folder: Path) -> pd.DataFrame:
    """Write extremes.csv into `folder`, and the plots where there is one polygon; returns it."""
    table = extremes_table(records)
    table.to_csv(folder / "extremes.csv", index=False, float_format="%.6g")
    if table["scene"].nunique() == 1:
        plot_polygon(records, folder / "plots")
    return table


def plot_polygon(records: Sequence[Record], folder: Path) -> list[Path]:
    """Draw the cost of each triangulation of one polygon against its A, one figure per device.

    Triangulations with T-junctions are marked: they leave cracks, and have fewer triangles.
    """
    files: list[Path] = []
    for members in groups(records):
        good = [record for record in members if record["status"] == "ok" and record["polygons"]]
        if not good or good[0]["options"]["work"] != 0:
            continue
        name = f"measured-over-a-{good[0]['rasteriser']}-{good[0]['device']}"
        files += draw(folder, name, _figure, without_twins(good))
    return files


def _figure(records: Sequence[Record]) -> Figure | None:
    from matplotlib.figure import Figure

    first = records[0]
    wanted = [name for name in ("bbox_tests", "helper_lanes") if name in first["counters"]]
    panels = [*wanted, *(["time"] if first.get("time") else [])]
    if not panels:
        return None
    figure = Figure(figsize=(0.6 + 2.9 * len(panels), 3.2))
    for axes, measure in zip(
        figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
    ):
        _panel(axes, records, measure)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    figure.suptitle(
        f"{first['scene']}, {first['resolution']} px: {first['rasteriser']} on {first['device']}",
        fontsize=9,
    )
    return figure


def _panel(axes: Axes, records: Sequence[Record], measure: str) -> None:
    for conforming, name, marker in ((True, "conforming", "o"), (False, "with T-junctions", "x")):
        part = [record for record in records if record["conforming"] is conforming]
        if not part:
            continue
        axes.scatter(
            [record["predicted"]["overdraw"] for record in part],
            [_value(record, measure) for record in part],
            s=14,
            marker=marker,
            color=COLOURS[0 if conforming else 1],
            label=f"{name} ({len(part)})",
        )
    axes.set_xlabel("A, bounding-box overdraw (px$^2$)")
    axes.set_ylabel("draw time (microseconds)" if measure == "time" else label(measure))
    axes.ticklabel_format(axis="x", style="sci", scilimits=(-3, 4))


def _value(record: Record, measure: str) -> float:
    if measure == "time":
        return float(record["time"]["median_s"]) * 1e6
    return float(record["counters"][measure])
