"""What a census found: a table of gains, their distribution, and a map of them.

Footprints are one group. Polygons of map tiles have a line for each zoom and layer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.scaling.census import Options, TileOptions
from harness.scaling.sums import BINS, GAINED, MEASURES, Group, Sums, whole
from harness.stored import atomic
from harness.style import TWO_COLUMNS, draw, looks, plain_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console
    from rich.table import Table

SHARES = (0.01, 0.05, 0.10, 0.20, 0.30, 0.50)
"""Gains for which the table has the share of footprints that gain at least as much."""

QUANTILES = (0.05, 0.25, 0.50, 0.75, 0.95)

EDGES = np.linspace(-1.0, 1.0, BINS + 1)
"""(BINS + 1,) bounds of the bins of a gain."""

MOST_CELLS = 4000
"""Cells along an edge of the map; a larger one is drawn more coarsely."""


def rows(sums: Sums, triangulators: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield a row for each triangulator and measure: totals, gains in all, and their distribution.

    Shares and quantiles are exact to the width of a bin, 0.5 %: a quantile is the lower bound of
    its bin.
    """
    for number, name in enumerate(triangulators):
        for place, measure in enumerate(GAINED):
            column = MEASURES.index(measure)
            base, own = sums.totals[0, column], sums.totals[number, column]
            bins = sums.bins[number, place]
            yield {
                "triangulator": name,
                "measure": measure,
                "footprints": sums.footprints,
                "total": own,
                "total_of_base": base,
                "gain_of_total": 1.0 - own / base if base else 0.0,
                **{f"share_gaining_{share:.0%}": at_least(bins, share) for share in SHARES},
                "share_losing_1%": below(bins, -0.01),
                **{
                    f"gain_p{quantile:.0%}"[:-1]: quantile_of(bins, quantile)
                    for quantile in QUANTILES
                },
            }


def at_least(bins: NDArray[np.int64], gain: float) -> float:
    """Return the share of footprints in bins from `gain` on."""
    return float(bins[np.searchsorted(EDGES, gain - 1e-9) :].sum() / max(1, bins.sum()))


def below(bins: NDArray[np.int64], gain: float) -> float:
    """Return the share of footprints in bins below `gain`."""
    return float(bins[: np.searchsorted(EDGES, gain - 1e-9)].sum() / max(1, bins.sum()))


def quantile_of(bins: NDArray[np.int64], quantile: float) -> float:
    """Return the lower bound of the bin in which the quantile is."""
    if not bins.sum():
        return 0.0
    place = int(np.searchsorted(np.cumsum(bins), quantile * bins.sum()))
    return float(EDGES[min(place, BINS - 1)].round(4))


def write(
    folder: Path,
    groups: Mapping[Group, Sums],
    options: Options | TileOptions,
    damaged: Sequence[tuple[str, str]],
) -> list[str]:
    """Write census.csv and the pictures into `folder`; returns what was written; raises OSError.

    Of footprints cells.csv and a map, too; of tiles damaged.csv, if any is.
    """
    names = options.triangulators
    sums = whole(groups, len(names))
    written = {"census.csv": list(_lines(groups, options))}
    if isinstance(options, TileOptions):
        if damaged:
            written["damaged.csv"] = [{"tile": tile, "reason": why} for tile, why in damaged]
    else:
        lanes = [f"helper_lanes {name}" for name in names]
        written["cells.csv"] = [
            {"x": x * options.cell, "y": y * options.cell, "footprints": int(values[0])}
            | dict(zip(lanes, values[1:].astype(int).tolist(), strict=True))
            for (x, y), values in sorted(sums.cells.items())
        ]
    for name, content in written.items():
        text = pd.DataFrame(content).to_csv(index=False, lineterminator="\n") if content else ""
        atomic.write(folder / name, text.encode())
    draw(folder / "plots", "gains", distribution, sums, names, noun(options))
    if isinstance(options, Options) and sums.cells:
        draw(folder / "plots", "map", map_of, sums, options)
    return [*written, "plots/"]


def noun(options: Options | TileOptions) -> str:
    """Return what is counted."""
    return "polygons" if isinstance(options, TileOptions) else "footprints"


def _lines(
    groups: Mapping[Group, Sums], options: Options | TileOptions
) -> Iterator[dict[str, Any]]:
    """Yield the rows of census.csv; of tiles for each zoom and layer."""
    for (zoom, layer), sums in _in_order(groups):
        about: dict[str, Any] = {}
        if isinstance(options, TileOptions):
            about = {"zoom": zoom, "layer": layer, "tiles": sums.tiles, "polygons": sums.footprints}
            about |= {name: getattr(sums, name) for name in ("vertices", "dropped", "repaired")}
        for row in rows(sums, options.triangulators):
            if about:
                del row["footprints"]
            yield about | row


def _in_order(groups: Mapping[Group, Sums]) -> list[tuple[Group, Sums]]:
    """Return groups by zoom, then by layer."""
    return sorted(groups.items(), key=lambda item: (item[0][0] or 0, item[0][1]))


def table(groups: Mapping[Group, Sums], options: Options | TileOptions, console: Console) -> Table:
    """Return what a terminal shows: helper lanes, which a choice of triangulation saves.

    Of tiles vertices are left out where there is no room for them.
    """
    names = options.triangulators
    if isinstance(options, TileOptions):
        wide = console.options.update(max_width=1000)
        full = _table_of_tiles(groups, names, vertices=True)
        if console.measure(full, options=wide).maximum <= console.width:
            return full
        return _table_of_tiles(groups, names, vertices=False)
    sums = whole(groups, len(names))
    title = f"{sums.footprints:,} footprints: helper lanes, compared with {names[0]}"
    headings = (">in all", ">median", ">gain 10 %", ">gain 30 %", ">lose 1 %")
    shown = plain_table(title, "triangulator", *headings)
    for row in rows(sums, names):
        if row["measure"] == "helper_lanes" and row["triangulator"] != names[0]:
            shown.add_row(
                row["triangulator"],
                f"{-row['gain_of_total']:+z.1%}",
                f"{-row['gain_p50']:+z.1%}",
                *(f"{row[name]:.1%}" for name in ("share_gaining_10%", "share_gaining_30%")),
                f"{row['share_losing_1%']:.1%}",
            )
    return shown


def _table_of_tiles(
    groups: Mapping[Group, Sums], triangulators: Sequence[str], *, vertices: bool
) -> Table:
    base, *others = triangulators
    counted = ("tiles", "polygons", *["vertices"] * vertices, "lost", "helpers")
    # A long name breaks where it has a colon or a hyphen.
    names = [name.replace(":", ":\n").replace("-", "-\n") for name in others]
    shown = plain_table(
        f"map tiles: helper lanes, compared with {base}",
        *("zoom", "layer", *(f">{heading}" for heading in (*counted, *names))),
        padding=(0, 1, 0, 0),
    )
    for (zoom, layer), sums in _in_order(groups):
        shown.add_row("" if zoom is None else str(zoom), layer, *_cells(sums, vertices=vertices))
    if len(groups) > 1:  # a tile has several layers, so that tiles do not add up
        _, *rest = _cells(whole(groups, len(triangulators)), vertices=vertices)
        shown.add_row("", "(all)", "", *rest)
    return shown


def _cells(sums: Sums, *, vertices: bool) -> list[str]:
    lanes = sums.totals[:, MEASURES.index("helper_lanes")]
    counts = (sums.tiles, sums.footprints, *[sums.vertices] * vertices, sums.dropped, int(lanes[0]))
    saved = [f"{own / lanes[0] - 1:+z.1%}" if lanes[0] else "" for own in lanes[1:]]
    return [*(f"{each:,}" for each in counts), *saved]


def distribution(sums: Sums, triangulators: Sequence[str], what: str) -> Figure:
    """Draw which share of footprints gains at least so much, for quads and for helper lanes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(TWO_COLUMNS, 2.8))
    styles = looks(triangulators)
    for panel, measure in zip(
        figure.subplots(1, 2, sharey=True), ("helper_lanes", "quads"), strict=True
    ):
        for number, name in enumerate(triangulators[1:], start=1):
            bins = sums.bins[number, GAINED.index(measure)]
            share = np.cumsum(bins[::-1])[::-1] / max(1, bins.sum())
            panel.step(100 * EDGES[:-1], 100 * share, color=styles[name].colour, label=name)
        panel.set_xlim(-25, 100)
        panel.set_ylim(0, 100)
        panel.axvline(0, color="black", linewidth=0.8, linestyle="--")
        panel.set_xlabel(f"gain in {measure.replace('_', ' ')}, % of {triangulators[0]}'s")
    first = figure.axes[0]
    first.set_ylabel(f"{what} that gain at least as much, %")
    first.legend(fontsize=7)
    figure.suptitle(f"What is gained on {sums.footprints:,} {what}?", fontsize=8)
    return figure


def map_of(sums: Sums, options: Options) -> Figure:
    """Draw, for each cell of the map, what the last triangulator saves of its helper lanes."""
    from matplotlib.figure import Figure

    places = np.array(sorted(sums.cells))
    values = np.array([sums.cells[tuple(place)] for place in places.tolist()])
    coarse = max(1, int(np.ceil(np.ptp(places, axis=0).max() / MOST_CELLS)))
    places = places // coarse
    low = places.min(axis=0)
    columns, lines = (places.max(axis=0) - low + 1).tolist()
    lanes = np.zeros((2, lines, columns))
    x, y = (places - low).T
    np.add.at(lanes[0], (y, x), values[:, 1])
    np.add.at(lanes[1], (y, x), values[:, -1])
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = 100 * (1 - lanes[1] / lanes[0])
    size = options.cell * coarse
    west, south = low * size
    extent = (west, west + columns * size, south, south + lines * size)
    figure = Figure(figsize=(TWO_COLUMNS, 5.0))
    panel = figure.subplots()
    seen = gain[np.isfinite(gain)]
    low_gain, high_gain = np.percentile(seen, [2, 98]) if len(seen) else (0.0, 1.0)
    picture = panel.imshow(
        gain, origin="lower", extent=extent, cmap="viridis", vmin=low_gain, vmax=high_gain
    )
    panel.grid(visible=False)
    figure.colorbar(picture, shrink=0.8, label="helper lanes saved, %")
    figure.suptitle(
        f"{options.triangulators[-1]} against {options.triangulators[0]}, by cells of {size:g}",
        fontsize=8,
    )
    return figure
