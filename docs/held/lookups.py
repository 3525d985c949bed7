"""Single figures of the files under `results/`, and how documents write them."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

from docs.held import ROOT

REFERENCE = ROOT / "results" / "reference"

BEST_FOR_H = "optimal:half-perimeter"

Row = dict[str, str]
K, C = TypeVar("K"), TypeVar("C")


@cache
def rows(file: str) -> list[Row]:
    """Return the rows of a CSV file under `results/reference`.

    Criteria are named as columns are, with underscores; newer files have hyphens.
    """
    with (REFERENCE / file).open(encoding="utf-8", newline="") as stream:
        found = list(csv.DictReader(stream))
    for row in found:
        if "criterion" in row:
            row["criterion"] = row["criterion"].replace("-", "_")
    return found


@cache
def values(file: str) -> Any:
    """Return what a JSON file under `results` holds."""
    return json.loads((ROOT / "results" / file).read_text(encoding="utf-8"))


@cache
def text(file: str) -> str:
    """Return a text file under `results/reference`."""
    return (REFERENCE / file).read_text(encoding="utf-8")


def some(file: str, **where: object) -> list[Row]:
    """Return the rows whose columns are as `where` says; numbers are compared as numbers."""
    return list(_some(file, tuple(where.items())))


@cache
def _some(file: str, where: tuple[tuple[str, object], ...]) -> list[Row]:
    return [row for row in rows(file) if all(_equal(row[k], v) for k, v in where)]


def one(file: str, **where: object) -> Row:
    """Return the only such row; raises `LookupError` if there is none or several."""
    found = some(file, **where)
    if len(found) != 1:
        raise LookupError(f"{file}: {len(found)} rows where {where}")
    return found[0]


def _equal(cell: str, value: object) -> bool:
    if isinstance(value, int | float):
        return cell not in ("", None) and float(cell) == value
    return cell == str(value)


def matched(file: str, pattern: str) -> tuple[str, ...]:
    """Return the groups of a pattern that a text file has once."""
    found = re.findall(pattern, text(file))
    if len(found) != 1:
        raise LookupError(f"{file}: {pattern!r} is there {len(found)} times")
    return found[0] if isinstance(found[0], tuple) else (found[0],)


def fixed(value: object, digits: int) -> str:
    """Write with so many digits after the point, and commas between thousands."""
    shown = f"{float(str(value)):,.{digits}f}"
    return shown.lstrip("-") if float(shown.replace(",", "")) == 0.0 else shown


def two(value: object) -> str:
    """Write with two digits."""
    return fixed(value, 2)


def three(value: object) -> str:
    """Write with three digits."""
    return fixed(value, 3)


def whole(value: object) -> str:
    """Write as a whole number."""
    return fixed(value, 0)


def percent(value: object, digits: int | None = None) -> str:
    """Write a share as per cent, without the sign: two figures where it is small."""
    share = 100.0 * float(str(value))
    if digits is None:
        digits = 0 if abs(share) >= 9.95 else 1
    shown = f"{share:.{digits}f}"
    return shown.lstrip("-") if float(shown) == 0.0 else shown


def bold(cells: list[str], marked: set[int]) -> list[str]:
    """Set the cells at some places in bold."""
    return [f"**{cell}**" if place in marked else cell for place, cell in enumerate(cells)]


def table_row(*cells: str) -> str:
    """Return a line of a table."""
    return "| " + " | ".join(cells) + " |"


def grid(
    labels: Mapping[K, str],
    columns: Sequence[C],
    cell: Callable[[K, C], str],
    least: str = "",
    more: Callable[[K], list[str]] = lambda _: [],
) -> list[str]:
    """Return the lines of a table: a label, a cell for each column, and what `more` says of a row.

    least : of what the least cell is in bold: "row", "column", or none
    """
    cells = {key: [cell(key, column) for column in columns] for key in labels}
    lines = []
    for key, label in labels.items():
        own = cells[key]
        among = [own] * len(own) if least == "row" else list(zip(*cells.values(), strict=True))
        marked = {place for place, text in enumerate(own) if least and text == min(among[place])}
        lines.append(table_row(label, *bold(own, marked), *more(key)))
    return lines
