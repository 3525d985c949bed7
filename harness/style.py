"""Style of plots, tables and reports: colours, symbols, number formats, files.

A triangulator has the same colour and symbol everywhere. The common ones have fixed looks; others
get the remaining looks in the order in which they appear.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.results.run_folder import file_stem

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray
    from rich.table import Table
    from rich.text import TextType


# Okabe and Ito's eight colours, distinguishable with any colour vision deficiency.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999")
DARK_COLOURS = (
    *("#56B4E9", "#FF8A3D", "#2FC79A", "#E79AC5", "#F0C94A", "#9DA9FF", "#F2F2F2", "#A8A8A8"),
)
"""The same colours for dark pages."""

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
SYMBOLS = (
    "circle",
    "rect",
    "triangle",
    "diamond",
    "path://M0,0L10,0L5,9Z",
    "path://M3,0H7V3H10V7H7V10H3V7H0V3H3Z",
    "path://M2,0L5,3L8,0L10,2L7,5L10,8L8,10L5,7L2,10L0,8L3,5L0,2Z",
    "path://M5,0L6.2,3.6H10L6.9,5.8L8.1,9.5L5,7.2L1.9,9.5L3.1,5.8L0,3.6H3.8Z",
)
"""Symbols of the report's charts, in the order of `MARKERS`, those of the plots."""

COMMON_TRIANGULATORS = (
    "optimal:half-perimeter",
    "ear-clipping",
    "delaunay",
    "optimal:overdraw",
    "fan",
    "refined:half-perimeter",
    "earcut-refine",
    "random",
    "greedy",
    "flips:l1",
    "optimal:expected-quads",
    "optimal:calibrated",
)
"""Triangulators with fixed looks, in the order of the looks."""

STYLE: Any = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.constrained_layout.use": True,
    "font.size": 8.0,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "savefig.dpi": 200,
    "svg.fonttype": "none",
    "svg.hashsalt": "raster-harness",
}

ONE_COLUMN, TWO_COLUMNS = 3.4, 7.0
"""Widths in inches of one and of two columns of a paper."""

MAX_VECTOR_MARKS = 20_000
"""Upper bound of vector marks of a panel; more become a bitmap inside the SVG."""


@dataclass(frozen=True)
class Look:
    """Look of a series: colours on light and dark pages, marker and symbol."""

    colour: str
    dark: str
    marker: str
    symbol: str


def look_of(index: int) -> Look:
    """Return the look of series `index` of a plot; looks repeat after 64."""
    colour = index % len(COLOURS)
    symbol = (index + index // len(COLOURS)) % len(MARKERS)
    return Look(COLOURS[colour], DARK_COLOURS[colour], MARKERS[symbol], SYMBOLS[symbol])


def looks(triangulators: Sequence[str]) -> dict[str, Look]:
    """Return the look of each triangulator, in the given order.

    A family in `COMMON_TRIANGULATORS` has a fixed look; each other family gets the next.
    """
    families = dict.fromkeys([*COMMON_TRIANGULATORS, *map(family_of, triangulators)])
    place = {family: look_of(index) for index, family in enumerate(families)}
    return {name: place[family_of(name)] for name in triangulators}


def family_of(triangulator: str) -> str:
    """Return a name without its number: random#1 and random#2 are one family."""
    return triangulator.partition("#")[0]


def scatter(panel: Axes, x: ArrayLike, y: ArrayLike, of: Look, label: str, **how: Any) -> None:
    """Draw one triangulator's marks; `how` are options of Matplotlib's `scatter`."""
    how = {"s": 7, "alpha": 0.5, "linewidths": 0, **how}
    panel.scatter(x, y, color=of.colour, marker=of.marker, label=label, **how)


def scatter_over_medians(
    panel: Axes, table: pd.DataFrame, x: str, y: str, by: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw two columns relative to each polygon's medians, random triangulations at the bottom.

    by : columns that identify a polygon; returns the drawn x and y
    """
    of_polygon = table.groupby(list(by))
    across = table[x] / of_polygon[x].transform("median")
    up = table[y] / of_polygon[y].transform("median")
    families = table["triangulator"].map(family_of)
    shown = looks([name for name in dict.fromkeys(families) if name != "random"] + ["random"])
    many = len(table) > MAX_VECTOR_MARKS
    for name in reversed(shown):
        own = (families == name) & (across > 0) & (up > 0)
        scatter(panel, across[own], up[own], shown[name], name, alpha=0.6, rasterized=many)
    return across.to_numpy(float), up.to_numpy(float)


def panels(
    count: int, size: tuple[float, float], title: str, across: int = 9, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure with a title and `count` panels, at most `across` of them in a row.

    size : of a panel, in inches; shared : options of Matplotlib's `subplots`
    """
    wide = min(across, count)
    high = -(-count // wide)
    inches = (max(wide * size[0] + 0.6, 4.6), high * size[1] + 0.6)
    figure, places = grid(inches, high, wide, **shared)
    for panel in places[count:]:
        panel.set_visible(False)
    figure.suptitle(title, fontsize=9)
    return figure, places[:count]


def grid(
    size: tuple[float, float], rows: int = 1, columns: int = 1, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure of a size in inches, and its panels, row by row; shared: as above."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size)
    return figure, figure.subplots(rows, columns, squeeze=False, **shared).ravel().tolist()


def legend_below(figure: Figure, places: Sequence[Axes], columns: int) -> None:
    """Draw one legend of all panels below a figure."""
    entries = (panel.get_legend_handles_labels() for panel in places)
    handles = {text: each for pair in entries for each, text in zip(*pair, strict=True)}
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=columns)


def plain_table(title: TextType | None, *columns: str, **options: Any) -> Table:
    """Return an empty table for the terminal, without lines; options: of rich's `Table`.

    columns : headings; ">" at the beginning aligns a column of numbers to the right
    """
    from rich.table import Table

    looks: Any = {"title_justify": "left", "box": None, "pad_edge": False, "header_style": "bold"}
    table = Table(title=title, **looks, **options)
    for name in columns:
        table.add_column(
            name.lstrip(">"), justify="right" if name[0] == ">" else "left", overflow="fold"
        )
    return table


def draw(
    folder: Path, name: str, make: Callable[..., Figure | None], *arguments: Any
) -> list[Path]:
    """Draw a figure in the common style, and write it as PNG and SVG; return the files.

    name : any text; the files' names are its `file_stem` with their endings
    make : returns the figure, or None if there is nothing to draw
    """
    import matplotlib

    with matplotlib.rc_context(STYLE):  # also applies to writing files
        figure = make(*arguments)
        if figure is None:
            return []
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / f"{file_stem(name)}.{suffix}" for suffix in ("png", "svg")]
        for file in files:
            figure.savefig(file)
            figure.set_layout_engine("none")  # a second file has the layout of the first
    return files


def count(number: int, noun: str, several: str = "") -> str:
    """Write `1 case`, `2 cases`."""
    return f"{number:,} {noun if number == 1 else several or noun + 's'}"


def percent(change: float) -> str:
    """Write a relative change with a sign and as many digits as matter: `+12.3 %`."""
    size = abs(change) * 100
    digits = 0 if size >= 100 else 1 if size >= 0.1 else 3
    return f"{change * 100:+,.{digits}f} %"


def figure(value: float) -> str:
    """Write a number with as many digits as matter."""
    whole = float(value).is_integer() or abs(value) >= 1000
    return f"{value:,.0f}" if whole else f"{value:,.4g}"


def step(before: float, after: float) -> str:
    """Write `99,275 → 111,496 (+12.3 %)`."""
    growth = f" ({percent(after / before - 1)})" if before else ""
    return f"{figure(before)} → {figure(after)}{growth}"


def flat(values: Mapping[str, Any], between: str = ".") -> dict[str, Any]:
    """Return nested values with joined names: {"timing": {"precision": 1}} as timing.precision."""
    flattened: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            inner = flat(value, between).items()
            flattened |= {f"{name}{between}{deeper}": each for deeper, each in inner}
        else:
            flattened[name] = value
    return flattened
