"""Figures in the documents, rendered from the files under `results/`.

A figure in a sentence is followed by a comment with the source of the value, such as
`0.84<!-- = gain city 1024 H :.2f -->`. A table stands between `<!-- table ... -->` and
`<!-- end -->`; the comment lists rows and the figures of columns. `render` replaces each
figure and all rows below a table's header; the surrounding text is free. CONTRIBUTING.md describes
the notation. The functions that compute figures are in `docs/results.py`.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from statistics import fmean, geometric_mean
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent

LABELS = tomllib.loads(Path(__file__).with_name("labels.toml").read_text(encoding="utf-8"))
"""Label of each value of a row key, by key."""

ALIASES = {
    "H": "optimal:half-perimeter",
    "Q": "optimal:expected-quads",
    "A": "optimal:overdraw",
    "refined": "refined:half-perimeter",
}
"""Short names of triangulators in figure comments."""

INLINE = re.compile(r"([-+]?\w[\w.,]*|-)?<!-- = (.*?) -->", re.DOTALL)
TABLE = re.compile(r"(<!-- table\n(.*?)-->\n+)(.*?)\n*<!-- end -->", re.DOTALL)

AGGREGATES: dict[str, Callable[[list[float]], float]] = {
    "min": min,
    "max": max,
    "sum": sum,
    "mean": fmean,
    "gmean": geometric_mean,
    "ratio": lambda values: values[0] / values[1],
}


class Interval(NamedTuple):
    """A value with the ends of the confidence interval."""

    value: float
    low: float
    high: float


class Expression(NamedTuple):
    """A parsed figure: `[aggregate] function arguments [:format]`."""

    aggregate: str
    function: str
    positional: list[list[str]]
    keyword: dict[str, list[str]]
    spec: str

    def calls(self, **row: str) -> Iterator[Callable[..., Any]]:
        """Yield a function without parameters per combination of the arguments."""
        from docs.results import FUNCTIONS

        keyword = {**self.keyword, **{key: [value] for key, value in row.items()}}
        for values in product(*self.positional, *keyword.values()):
            converted = [convert(value) for value in values]
            named = dict(zip(keyword, converted[len(self.positional) :], strict=True))
            yield partial(FUNCTIONS[self.function], *converted[: len(self.positional)], **named)


def parse(text: str) -> Expression:
    """Parse a figure comment; a comma separates alternative values of an argument."""
    parts = text.split()
    aggregate = parts.pop(0) if parts[0] in AGGREGATES else ""
    spec = parts.pop()[1:] if parts[-1].startswith(":") else ""
    pairs = [re.match(r"(?:([\w-]+)=)?(.+)", word) for word in parts[1:]]
    positional = [pair[2].split(",") for pair in pairs if pair and not pair[1]]
    keyword = {pair[1]: pair[2].split(",") for pair in pairs if pair and pair[1]}
    return Expression(aggregate, parts[0], positional, keyword, spec)


def convert(text: str) -> Any:
    """Return an argument as a number if possible, else as text with aliases replaced."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return ALIASES.get(text, text)


def format_value(value: Any, spec: str, *, in_table: bool = False) -> str:
    """Return a figure as text.

    A `%` format writes a share in percent; `+...%` the percent above 1 and `-...%` the percent
    below 1 of a ratio. Without a number of digits, small percentages get one digit.
    """
    if isinstance(value, str):
        return value
    if isinstance(value, Interval):
        mean, *ends = (format_value(part, spec) for part in value)
        return f"{mean}{' %' * spec.endswith('%')} ({ends[0]} to {ends[1]})"
    if value != value:  # NaN: no value
        return "-"
    if spec.endswith("%"):
        share = {"+": value - 1.0, "-": 1.0 - value}.get(spec[0], value) * 100.0
        digits = spec.strip("+-%") or (".0f" if abs(share) >= 9.95 else ".1f")
        return f"{share:z{digits.rstrip('f')}f}" + " %" * in_table
    return format(value, f"z{spec}" if spec.endswith("f") else spec or ",")


def compute(text: str) -> str:
    """Return the text of a figure from the comment."""
    expression = parse(text)
    values = [value for call in expression.calls() for value in as_list(call())]
    if expression.aggregate:
        values = [AGGREGATES[expression.aggregate](values)]
    if len(values) != 1:
        raise LookupError(f"{len(values)} values instead of one")
    return format_value(values[0], expression.spec)


def as_list(value: Any) -> list[Any]:
    """Return a list of the values of a figure function."""
    return value if isinstance(value, list) else [value]


def table_rows(text: str) -> list[str]:
    """Return the lines of a table from the comment.

    `rows key=a,b other=c,d` starts a group with a row per combination; `rows joined` puts the
    labels of a row in one cell, a text in double quotes replaces the labels. Each line `cells
    FIGURE` adds a column per combination of the figure's arguments. `bold min row` or `bold max
    column` marks the extreme cell of the columns above that line.
    """
    lines, marked = [], []
    for group in re.split(r"^rows ", text, flags=re.MULTILINE)[1:]:
        head, *figures = group.strip().splitlines()
        head, _, title = head.partition('"')
        axes = dict(word.split("=", 1) for word in head.split() if "=" in word)
        for values in product(*(axis.split(",") for axis in axes.values())):
            row = dict(zip(axes, values, strict=True))
            names = [LABELS.get(key, {}).get(value, value) for key, value in row.items()]
            cells: list[Cell] = []
            for line in figures:
                if line.startswith("bold "):
                    best, direction = line.split()[1:]
                    marked.append((best, direction, len(lines), len(cells)))
                else:
                    cells += row_cells(parse(line.removeprefix("cells ")), row)
            label = title.rstrip('"') or (", " if "joined" in head else " | ").join(names)
            lines.append((label, cells))
    for best, direction, number, width in marked:
        across = [lines[number][1][:width]]
        down = [[cells[column] for _, cells in lines] for column in range(width)]
        for candidates in across if direction == "row" else down:
            extreme = AGGREGATES[best]([cell.number for cell in candidates])
            text = next(cell.text for cell in candidates if cell.number == extreme)
            for cell in candidates:
                cell.bold = cell.bold or cell.text == text
    return [f"| {' | '.join([label, *map(str, cells)])} |" for label, cells in lines]


@dataclass
class Cell:
    """A cell of a table: number, text, and whether the text is bold."""

    number: float
    text: str
    bold: bool = False

    def __str__(self) -> str:
        return f"**{self.text}**" if self.bold else self.text


def row_cells(figure: Expression, row: Mapping[str, str]) -> Iterator[Cell]:
    """Yield the cells of a figure in a row."""
    for call in figure.calls(**row):
        values = as_list(call())
        for value in [AGGREGATES[figure.aggregate](values)] if figure.aggregate else values:
            number = value.value if isinstance(value, Interval) else value
            text = format_value(value, figure.spec, in_table=True)
            yield Cell(math.nan if isinstance(number, str) else number, text)


def render(page: str) -> str:
    """Return a page with every figure and table computed again; raises ValueError with the figure
    that cannot be computed.
    """

    def inline(match: re.Match[str]) -> str:
        return f"{_checked(compute, match[2])}<!-- = {match[2]} -->"

    def table(match: re.Match[str]) -> str:
        header = match[3].splitlines()[:2]
        rows = _checked(table_rows, match[2])
        if len(header) < 2 or len({line.count("|") for line in [*header, *rows]}) != 1:
            raise ValueError(f"table: header and rows differ in length ({' '.join(header)})")
        return match[1] + "\n".join([*header, *rows]) + "\n\n<!-- end -->"

    return TABLE.sub(table, INLINE.sub(inline, page))


def _checked(computation: Callable[[str], Any], text: str) -> Any:
    try:
        return computation(text)
    except (LookupError, TypeError, OSError, ValueError) as error:
        raise ValueError(f"figure `{' '.join(text.split())}`: {error}") from error


def without_comments(page: str) -> str:
    """Return a page without the comments behind figures, as the site publishes it."""
    return INLINE.sub(lambda match: match[1] or "", page)
