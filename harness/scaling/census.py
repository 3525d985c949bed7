"""Census: gains of each triangulator over all polygons of a data set; table, distribution and map.

`harness.scaling.counts` counts the polygons of a part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import pandas as pd

from harness import atomic
from harness.scaling.counts import (
    BINS,
    COUNTS,
    GAINED,
    MEASURES,
    CensusCounts,
    Group,
    PartCounter,
    Sums,
    read_part_result,
)
from harness.scaling.dataset import CHUNK_ROWS, FilePart, PartResult, PartWork
from harness.style import TWO_COLUMNS, choose_looks, draw_figure, make_figure, make_plain_table
from scenes.files import read_chunks
from scenes.slices import Slices, TileSelection, cut_file, cut_tiles, read_tiles
from scenes.tiles import note_rounding

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

SHARES = (0.01, 0.05, 0.10, 0.20, 0.30, 0.50)  # columns: share that gains as much
QUANTILES = (0.05, 0.25, 0.50, 0.75, 0.95)

EDGES = np.linspace(-1.0, 1.0, BINS + 1)  # bounds of the bins of a gain
MAX_CELLS = 4000  # along a side of the map; a larger map is drawn coarser


@dataclass(frozen=True)
class Counting(PartWork):
    """Options of both kinds of census; the first triangulator is the base of the gains."""

    title: ClassVar[str] = "counting"
    suffix: ClassVar[str] = ".npz"
    noun: ClassVar[str]
    read_result = staticmethod(read_part_result)

    triangulators: tuple[str, ...]


@dataclass(frozen=True)
class Census(Counting):
    """A census of footprints."""

    noun: ClassVar[str] = "footprints"

    units_per_pixel: float  # metres if the source is in degrees
    cell: float  # side of a map cell, in the source's units
    layer: str | None = None
    where: str | None = None

    def list_slices(self, path: str) -> Slices:
        """Return the slices of a file, which are ranges of rows."""
        return cut_file(path, self.layer, self.where)

    def write_part(self, part: FilePart, path: Path, threads: int | None) -> PartResult:
        """Count the footprints in a part's rows, and write the part's file."""
        counter = PartCounter(self.triangulators, threads)
        for chunk in read_chunks(
            part.path, layer=self.layer, where=self.where, size=CHUNK_ROWS, rows=part.rows
        ):
            counter.add_chunk(chunk, self.units_per_pixel, self.cell)
        return counter.save(part, path)


@dataclass(frozen=True)
class TileCensus(Counting):
    """A census of map tiles; `selection` has zooms, layers and a tile's side in pixels."""

    unit: ClassVar[str] = "tiles"
    noun: ClassVar[str] = "polygons"

    selection: TileSelection

    def list_slices(self, path: str) -> Slices:
        """Return the slices of an archive, which are ranges of tiles."""
        return cut_tiles(path, self.selection.zooms)

    def write_part(self, part: FilePart, path: Path, threads: int | None) -> PartResult:
        """Count the polygons of a part's tiles, and write the part's file."""
        counter = PartCounter(self.triangulators, threads)
        assert part.rows is not None
        extents: set[int] = set()
        for tile in read_tiles(part.path, part.rows, self.selection):
            extents.update(layer.extent for layer in counter.add_tile(tile, self.selection.pixels))
        counter.count_waiting(self.selection.pixels)
        counter.notes += note_rounding(extents, self.selection.pixels)
        return counter.save(part, path)


def make_gain_rows(sums: Sums, triangulators: Sequence[str]) -> pd.DataFrame:
    """Return a row for each triangulator and measure: totals, total gain, distribution of gains.

    Shares and quantiles are exact to a bin's width, 0.5 %; a quantile is its bin's lower bound.
    """
    index = pd.MultiIndex.from_product([triangulators, GAINED], names=["triangulator", "measure"])
    table = index.to_frame(index=False)
    totals = sums.totals[:, [MEASURES.index(measure) for measure in GAINED]]
    base = np.broadcast_to(totals[0], totals.shape)
    table["footprints"] = sums.get_count("polygons")
    table["total"], table["total_of_base"] = totals.ravel(), base.ravel()
    ratio = np.divide(totals, base, out=np.ones_like(totals), where=base > 0)
    table["gain_of_total"] = (1.0 - ratio).ravel()
    upto = np.cumsum(sums.bins, axis=2).reshape(-1, BINS)
    count = upto[:, -1]
    for share in SHARES:
        lower = upto[:, np.searchsorted(EDGES, share - 1e-9) - 1]
        table[f"share_gaining_{share:.0%}"] = (count - lower) / np.maximum(1, count)
    lower = upto[:, np.searchsorted(EDGES, -0.01 - 1e-9) - 1]
    table["share_losing_1%"] = lower / np.maximum(1, count)
    for quantile in QUANTILES:
        position = (upto < quantile * count[:, None]).sum(axis=1)
        low = EDGES[np.minimum(position, BINS - 1)].round(4)
        table[f"gain_p{100 * quantile:.0f}"] = np.where(count, low, 0.0)
    return table


def write_census(folder: Path, counted: CensusCounts, census: Census | TileCensus) -> list[str]:
    """Write census.csv, other tables and plots into `folder`; return the names; raises OSError."""
    names, plots = census.triangulators, folder / "plots"
    written = {"census.csv": _make_census_table(counted, census)}
    if counted.damaged:
        written["damaged.csv"] = pd.DataFrame(counted.damaged, columns=["tile", "reason"])
    if isinstance(census, Census):
        (cells,) = counted.cells
        places = {axis: cells[axis] * census.cell for axis in ("x", "y")}
        written["cells.csv"] = cells.assign(**places)
        draw_figure(plots, "map", plot_map, cells, census)
    for name, table in written.items():
        text = table.to_csv(index=False, lineterminator="\n")
        atomic.write(folder / name, text.encode())
    draw_figure(plots, "gains", plot_distribution, counted.sum_groups(), names, census.noun)
    return [*written, "plots/"]


def _make_census_table(counted: CensusCounts, census: Census | TileCensus) -> pd.DataFrame:
    tables = []
    for (zoom, layer), sums in _sort_groups(counted):
        table = make_gain_rows(sums, census.triangulators)
        if isinstance(census, TileCensus):
            table = table.drop(columns="footprints")
            about = {"zoom": zoom, "layer": layer, **dict(zip(COUNTS, sums.counts, strict=True))}
            for position, (name, value) in enumerate(about.items()):
                table.insert(position, name, value)
        tables.append(table)
    return pd.concat(tables)


def _sort_groups(counted: CensusCounts) -> list[tuple[Group, Sums]]:
    return sorted(counted.groups.items(), key=lambda item: (item[0][0] or 0, item[0][1]))


def make_table(counted: CensusCounts, census: Census | TileCensus) -> Table:
    """Return the table for the terminal: savings of helper lanes."""
    base, *names = census.triangulators
    if isinstance(census, TileCensus):
        return _make_tile_table(counted, base, names)
    sums = counted.sum_groups()
    title = f"{sums.get_count('polygons'):,} footprints: helper lanes, compared with {base}"
    headings = (">in all", ">median", ">gain 10 %", ">gain 30 %", ">lose 1 %")
    table = make_plain_table(title, "triangulator", *headings)
    every = make_gain_rows(sums, census.triangulators).query("measure == 'helper_lanes'")
    for row in every.iloc[1:].to_dict("records"):
        table.add_row(
            row["triangulator"],
            *(f"{-row[name]:+z.1%}" for name in ("gain_of_total", "gain_p50")),
            *(f"{row[name]:.1%}" for name in ("share_gaining_10%", "share_gaining_30%")),
            f"{row['share_losing_1%']:.1%}",
        )
    return table


def _make_tile_table(counted: CensusCounts, base: str, triangulators: Sequence[str]) -> Table:
    # Long names wrap after a colon or a hyphen.
    names = [name.replace(":", ":\n").replace("-", "-\n") for name in triangulators]
    table = make_plain_table(
        f"map tiles: helper lanes, compared with {base}",
        *("zoom", "layer", ">tiles", ">polygons", ">lost", ">helpers", *(f">{n}" for n in names)),
        padding=(0, 1, 0, 0),
    )
    groups = _sort_groups(counted)
    if len(groups) > 1:
        groups.append(((None, "(all)"), counted.sum_groups()))
    for (zoom, layer), sums in groups:
        lanes = sums.get_total("helper_lanes")
        # A tile has several layers, so tiles of layers cannot be summed.
        tiles = "" if layer == "(all)" else f"{sums.get_count('tiles'):,}"
        counts = (sums.get_count("polygons"), sums.get_count("dropped"), int(lanes[0]))
        saved = [f"{value / lanes[0] - 1:+z.1%}" if lanes[0] else "" for value in lanes[1:]]
        label = "" if zoom is None else str(zoom)
        table.add_row(label, layer, tiles, *(f"{count:,}" for count in counts), *saved)
    return table


def plot_distribution(sums: Sums, triangulators: Sequence[str], noun: str) -> Figure:
    """Draw the share of footprints by minimum gain, for helper lanes and quads."""
    figure, panels = make_figure((TWO_COLUMNS, 2.8), columns=2, sharey=True)
    styles = choose_looks(triangulators)
    for panel, measure in zip(panels, ("helper_lanes", "quads"), strict=True):
        for number, name in enumerate(triangulators[1:], start=1):
            bins = sums.bins[number, GAINED.index(measure)]
            share = np.cumsum(bins[::-1])[::-1] / max(1, bins.sum())
            panel.step(100 * EDGES[:-1], 100 * share, color=styles[name].colour, label=name)
        panel.set_xlim(-25, 100)
        panel.set_ylim(0, 100)
        panel.axvline(0, color="black", linewidth=0.8, linestyle="--")
        panel.set_xlabel(f"gain in {measure.replace('_', ' ')}, % of {triangulators[0]}'s")
    panels[0].set_ylabel(f"{noun} that gain at least as much, %")
    panels[0].legend(fontsize=7)
    figure.suptitle(f"Gain on {sums.get_count('polygons'):,} {noun}", fontsize=8)
    return figure


def plot_map(cells: pd.DataFrame, census: Census) -> Figure:
    """Draw a map of the share of helper lanes that the last triangulator saves, by map cell."""
    coarse = max(1, int(np.ceil(np.ptp(cells[["x", "y"]], axis=0).max() / MAX_CELLS)))
    sums = cells.groupby([cells["y"] // coarse, cells["x"] // coarse]).sum()
    base, *_, last = (sums[f"helper_lanes {name}"] for name in census.triangulators)
    gain = (100 * (1 - last / base)).unstack()
    (south, west), (north, east) = (sums.index.to_frame().agg(end) for end in ("min", "max"))
    gain = gain.reindex(range(south, north + 1), columns=range(west, east + 1))
    size = census.cell * coarse
    extent = (west * size, (east + 1) * size, south * size, (north + 1) * size)
    figure, (panel,) = make_figure((TWO_COLUMNS, 5.0))
    seen = gain.to_numpy()[np.isfinite(gain)]
    low_gain, high_gain = np.percentile(seen, [2, 98]) if len(seen) else (0.0, 1.0)
    picture = panel.imshow(
        gain, origin="lower", extent=extent, cmap="viridis", vmin=low_gain, vmax=high_gain
    )
    panel.grid(visible=False)
    figure.colorbar(picture, shrink=0.8, label="helper lanes saved, %")
    figure.suptitle(
        f"{census.triangulators[-1]} against {census.triangulators[0]}, by cells of {size:g}",
        fontsize=8,
    )
    return figure
