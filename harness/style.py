"""Style of plots and tables: colours, symbols, number formats, files."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.results.run_folder import make_file_stem

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
DARK_COLOURS = (  # for dark pages, in the same order
    *("#56B4E9", "#FF8A3D", "#2FC79A", "#E79AC5", "#F0C94A", "#9DA9FF", "#F2F2F2", "#A8A8A8"),
)

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
SYMBOLS = (  # of the report's charts, in the order of `MARKERS`, the symbols of plots
    "circle",
    "rect",
    "triangle",
    "diamond",
    "path://M0,0L10,0L5,9Z",
    "path://M3,0H7V3H10V7H7V10H3V7H0V3H3Z",
    "path://M2,0L5,3L8,0L10,2L7,5L10,8L8,10L5,7L2,10L0,8L3,5L0,2Z",
    "path://M5,0L6.2,3.6H10L6.9,5.8L8.1,9.5L5,7.2L1.9,9.5L3.1,5.8L0,3.6H3.8Z",
)

COMMON_TRIANGULATORS = (  # with fixed looks, in the order of the looks
    "optimal:half-perimeter",
    "ear-clipping",
    "delaunay",
    "optimal:overdraw",
    "fan",
    "refined:half-perimeter",
    "earcut-refine",
    "optimal:expected-quads",
    "greedy",
    "flips:l1",
    "random",
    "optimal:calibrated",
)

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

ONE_COLUMN, TWO_COLUMNS = 3.4, 7.0  # widths of columns of a paper, in inches
MAX_VECTOR_MARKS = 20_000  # of a panel; more marks become a bitmap inside the SVG


@dataclass(frozen=True)
class Look:
    """Look of a series: colours on light and dark pages, marker and symbol."""

    colour: str
    dark: str
    marker: str
    symbol: str


def get_look(index: int) -> Look:
    """Return the look of series `index` of a plot; looks repeat after 64."""
    colour = index % len(COLOURS)
    symbol = (index + index // len(COLOURS)) % len(MARKERS)
    return Look(COLOURS[colour], DARK_COLOURS[colour], MARKERS[symbol], SYMBOLS[symbol])


def choose_looks(triangulators: Sequence[str]) -> dict[str, Look]:
    """Return a fixed look for each of `COMMON_TRIANGULATORS`, and the next looks for the others."""
    families = dict.fromkeys([*COMMON_TRIANGULATORS, *map(get_family, triangulators)])
    looks = {family: get_look(index) for index, family in enumerate(families)}
    return {name: looks[get_family(name)] for name in triangulators}


def get_family(triangulator: str) -> str:
    """Return a triangulator's name without its number: random#1 and random#2 are one family."""
    return triangulator.partition("#")[0]


def draw_scatter(
    panel: Axes, x: ArrayLike, y: ArrayLike, look: Look, label: str, **options: Any
) -> None:
    """Draw one triangulator's marks; `options` as for Matplotlib's `scatter`."""
    options = {"s": 7, "alpha": 0.5, "linewidths": 0, **options}
    panel.scatter(x, y, color=look.colour, marker=look.marker, label=label, **options)


def draw_scatter_over_medians(
    panel: Axes, table: pd.DataFrame, x: str, y: str, by: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw two columns relative to their medians in each group `by`; return the drawn x and y.

    Random triangulations are drawn first, so that other marks cover them.
    """
    of_polygon = table.groupby(list(by))
    across = table[x] / of_polygon[x].transform("median")
    up = table[y] / of_polygon[y].transform("median")
    families = table["triangulator"].map(get_family)
    names = [*(name for name in dict.fromkeys(families) if name != "random"), "random"]
    is_large = len(table) > MAX_VECTOR_MARKS
    for name, look in reversed(choose_looks(names).items()):
        rows = (families == name) & (across > 0) & (up > 0)
        draw_scatter(panel, across[rows], up[rows], look, name, alpha=0.6, rasterized=is_large)
    return across.to_numpy(float), up.to_numpy(float)


def make_panels(
    count: int, size: tuple[float, float], title: str, across: int = 9, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure of `count` panels of `size` in inches; `shared` as for `subplots`."""
    wide = min(across, count)
    high = -(-count // wide)
    inches = (max(wide * size[0] + 0.6, 4.6), high * size[1] + 0.6)
    figure, cells = make_figure(inches, high, wide, **shared)
    for panel in cells[count:]:
        panel.set_visible(False)
    figure.suptitle(title, fontsize=9)
    return figure, cells[:count]


def make_figure(
    size: tuple[float, float], rows: int = 1, columns: int = 1, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure of `size` in inches and its panels by row; `shared` as for `subplots`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size)
    return figure, figure.subplots(rows, columns, squeeze=False, **shared).ravel().tolist()


def add_legend_below(figure: Figure, panels: Sequence[Axes], columns: int) -> None:
    """Draw one legend for all panels below a figure, in a number of columns."""
    entries = (panel.get_legend_handles_labels() for panel in panels)
    handles = {text: handle for pair in entries for handle, text in zip(*pair, strict=True)}
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=columns)


def make_plain_table(title: TextType | None, *columns: str, **options: Any) -> Table:
    """Return an empty table for the terminal; a heading with a leading ">" is aligned right."""
    from rich.table import Table

    looks: Any = {"title_justify": "left", "box": None, "pad_edge": False, "header_style": "bold"}
    table = Table(title=title, **looks, **options)
    for name in columns:
        table.add_column(
            name.lstrip(">"), justify="right" if name[0] == ">" else "left", overflow="fold"
        )
    return table


@cache
def _report_missing_plots() -> None:
    from scenes.spec import format_install_command

    install = format_install_command("plots")
    print(f"plots skipped: matplotlib is not installed; {install}", file=sys.stderr)


def format_markdown_table(heading: Sequence[str], rows: Iterable[Sequence[str]], texts: int) -> str:
    """Return a Markdown table; columns after the first `texts` are aligned right."""
    alignment = ["---"] * texts + ["--:"] * (len(heading) - texts)
    return "".join(f"| {' | '.join(line)} |\n" for line in (heading, alignment, *rows))


def format_latex_table(heading: Sequence[str], rows: Iterable[Sequence[str]], texts: int) -> str:
    """Return a LaTeX table (booktabs); columns after the first `texts` are aligned right."""

    def format_line(cells: Sequence[str]) -> str:
        return " & ".join(re.sub(r"([%_#&$])", r"\\\1", cell) for cell in cells) + " \\\\\n"

    columns = "l" * texts + "r" * (len(heading) - texts)
    body = "".join(map(format_line, rows))
    return (
        f"\\begin{{tabular}}{{{columns}}}\n\\toprule\n{format_line(heading)}\\midrule\n{body}"
        "\\bottomrule\n\\end{tabular}\n"
    )


def draw_figure(
    folder: Path, name: str, make: Callable[..., Figure | None], *arguments: Any
) -> list[Path]:
    """Draw the figure that `make` returns, if any, as PNG and SVG in the common style."""
    try:
        import matplotlib
    except ModuleNotFoundError:
        _report_missing_plots()
        return []
    with matplotlib.rc_context(STYLE):  # must also apply while files are written
        figure = make(*arguments)
        if figure is None:
            return []
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / f"{make_file_stem(name)}.{suffix}" for suffix in ("png", "svg")]
        for file in files:
            figure.savefig(file)
            figure.set_layout_engine("none")  # a second file has the layout of the first
    return files


def format_count(number: int, noun: str, plural: str = "") -> str:
    """Return a number and a noun: `1 case`, `2 cases`."""
    return f"{number:,} {noun if number == 1 else plural or noun + 's'}"


def format_percent(change: float) -> str:
    """Return a relative change, e.g. 0.123, in percent with sign: `+12.3 %`."""
    size = abs(change) * 100
    digits = 0 if size >= 100 else 1 if size >= 0.1 else 3
    return f"{change * 100:+,.{digits}f} %"


def format_number(value: float) -> str:
    """Return a number with four significant digits; integers, and numbers from 1000, in full."""
    is_integer = float(value).is_integer() or abs(value) >= 1000
    return f"{value:,.0f}" if is_integer else f"{value:,.4g}"


def format_step(before: float, after: float) -> str:
    """Return a change as `99,275 → 111,496 (+12.3 %)`."""
    growth = f" ({format_percent(after / before - 1)})" if before else ""
    return f"{format_number(before)} → {format_number(after)}{growth}"


def flatten(values: Mapping[str, Any]) -> dict[str, Any]:
    """Flatten nested values: {"timing": {"precision": 1}} becomes {"timing: precision": 1}."""
    flattened: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            inner = flatten(value).items()
            flattened |= {f"{name}: {key}": item for key, item in inner}
        else:
            flattened[name] = value
    return flattened
