"""What a census of map tiles found: a line for each zoom and layer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.pictures.style import draw, plain_table
from harness.scaling.census_report import distribution, rows, write_csv
from harness.scaling.sums import MEASURES, Group, Sums, whole

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_LANES = MEASURES.index("helper_lanes")


def rows_of_tiles(
    groups: Mapping[Group, Sums], triangulators: Sequence[str]
) -> Iterator[dict[str, Any]]:
    """Yield a row for each zoom, layer, triangulator and measure, as `rows` does for footprints."""
    for (zoom, layer), sums in in_order(groups):
        about = {"zoom": zoom, "layer": layer, "tiles": sums.tiles, "polygons": sums.footprints}
        about |= {name: getattr(sums, name) for name in ("vertices", "dropped", "repaired")}
        for row in rows(sums, triangulators):
            del row["footprints"]
            yield about | row


def in_order(groups: Mapping[Group, Sums]) -> list[tuple[Group, Sums]]:
    """Return groups by zoom, then by layer."""
    return sorted(groups.items(), key=lambda item: (item[0][0] or 0, item[0][1]))


def write(
    folder: Path,
    groups: Mapping[Group, Sums],
    triangulators: Sequence[str],
    damaged: Sequence[tuple[str, str]],
) -> None:
    """Write census.csv, the picture, and damaged.csv if any tile is; raises OSError."""
    write_csv(folder / "census.csv", list(rows_of_tiles(groups, triangulators)))
    if damaged:
        lost = [{"tile": name, "reason": why} for name, why in damaged]
        write_csv(folder / "damaged.csv", lost)
    sums = whole(groups, len(triangulators))
    draw(folder / "plots", "gains", distribution, sums, triangulators, "polygons")


def table(groups: Mapping[Group, Sums], triangulators: Sequence[str], console: Console) -> Table:
    """Return what a terminal shows: helper lanes of each zoom and layer, and what is saved.

    Vertices are left out where there is no room for them.
    """
    wide = console.options.update(max_width=1000)
    full = _table(groups, triangulators, vertices=True)
    if console.measure(full, options=wide).maximum <= console.width:
        return full
    return _table(groups, triangulators, vertices=False)


def _table(groups: Mapping[Group, Sums], triangulators: Sequence[str], *, vertices: bool) -> Table:
    base, *others = triangulators
    counted = ("tiles", "polygons", *["vertices"] * vertices, "lost", "helpers")
    # A long name breaks where it has a colon or a hyphen.
    names = [name.replace(":", ":\n").replace("-", "-\n") for name in others]
    shown = plain_table(
        f"map tiles: helper lanes, compared with {base}",
        *("zoom", "layer", *(f">{heading}" for heading in (*counted, *names))),
        padding=(0, 1, 0, 0),
    )
    for (zoom, layer), sums in in_order(groups):
        shown.add_row("" if zoom is None else str(zoom), layer, *_cells(sums, vertices=vertices))
    if len(groups) > 1:  # a tile has several layers, so that tiles do not add up
        _, *rest = _cells(whole(groups, len(triangulators)), vertices=vertices)
        shown.add_row("", "(all)", "", *rest)
    return shown


def _cells(sums: Sums, *, vertices: bool) -> list[str]:
    lanes = sums.totals[:, _LANES]
    counts = (sums.tiles, sums.footprints, *[sums.vertices] * vertices, sums.dropped, int(lanes[0]))
    saved = [f"{own / lanes[0] - 1:+.1%}" if lanes[0] else "" for own in lanes[1:]]
    return [*(f"{each:,}" for each in counts), *saved]
