"""Rows and figures of the files under `results/`, and how tables of documents show them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from itertools import product
from typing import Any, TypeVar

import pandas as pd

from docs.held import ROOT, shown

REFERENCE = ROOT / "results" / "reference"

K, C = TypeVar("K"), TypeVar("C")


@cache
def _table(file: str) -> pd.DataFrame:
    """Return a CSV file under `results/reference`.

    Criteria are named as columns are, with underscores; newer files have hyphens.
    """
    found = pd.read_csv(REFERENCE / file)
    if "criterion" in found:
        found["criterion"] = found["criterion"].str.replace("-", "_")
    return found


@cache
def values(file: str) -> Any:
    """Return what a JSON file under `results` holds."""
    return json.loads((ROOT / "results" / file).read_text(encoding="utf-8"))


def some(file: str, **where: object) -> pd.DataFrame:
    """Return the rows whose columns are as `where` says."""
    found = _table(file)
    return found[(found[list(where)] == list(where.values())).all(axis=1)]


def one(file: str, **where: object) -> pd.Series[Any]:
    """Return the only such row; raises `LookupError` if there is none or several."""
    found = some(file, **where)
    if len(found) != 1:
        raise LookupError(f"{file}: {len(found)} rows where {where}")
    return found.iloc[0]


def matched(file: str, pattern: str) -> tuple[str, ...]:
    """Return the groups of a pattern that a text file has once."""
    found = list(re.finditer(pattern, (REFERENCE / file).read_text(encoding="utf-8")))
    if len(found) != 1:
        raise LookupError(f"{file}: {pattern!r} is there {len(found)} times")
    return found[0].groups()


def ends(found: Iterable[float], digits: int | None = None) -> tuple[float, float]:
    """Return the least and the largest, rounded outwards where digits after the point are given."""
    each = list(found)
    if digits is None:
        return min(each), max(each)
    return math.floor(min(each) * 10**digits) / 10**digits, at_most(each, digits)


def at_most(found: Iterable[float], digits: int) -> float:
    """Return a bound that none exceeds, with so many digits after the point."""
    return math.ceil(max(found) * 10**digits) / 10**digits


def crossed(
    first: Mapping[K, str], second: Mapping[C, str] | Sequence[C], join: str
) -> dict[tuple[K, C], str]:
    """Return a label for each pair; what has none is its own."""
    more = second if isinstance(second, Mapping) else {each: str(each) for each in second}
    pairs = product(first.items(), more.items())
    return {(one, other): f"{a}{join}{b}" for (one, a), (other, b) in pairs}


def bold(text: str, when: object) -> str:
    """Return a cell, in bold where something is so."""
    return f"**{text}**" if when else text


def table_row(*cells: str) -> str:
    """Return a line of a table."""
    return "| " + " | ".join(cells) + " |"


def grid(
    labels: Mapping[K, str],
    columns: Iterable[C],
    cell: Callable[[K, C], object],
    spec: str | Sequence[str] = "",
    least: str = "",
    more: Callable[[K], Iterable[str]] = lambda _: (),
) -> Callable[[], list[str]]:
    """Return what makes the lines of a table: a label, a cell for each column, and `more` of a row.

    spec : how a cell that is no text is written, or those of each column; shares have their sign
    least : of what the least cell is in bold: "row", "column", or none
    """
    keys = list(columns)

    def lines() -> list[str]:
        specs = [spec] * len(keys) if isinstance(spec, str) else spec
        pairs = list(zip(keys, specs, strict=True))
        rows = [[_text(cell(key, column), each) for column, each in pairs] for key in labels]
        cells = pd.DataFrame(rows, dtype=object)
        if least:
            marked = cells.eq(cells.min(axis=int(least == "row")), axis=int(least == "column"))
            cells = cells.mask(marked, "**" + cells + "**")
        texts = zip(labels.items(), cells.to_numpy().tolist(), strict=True)
        return [table_row(label, *row, *more(key)) for (key, label), row in texts]

    return lines


def _text(value: Any, spec: str) -> str:
    if isinstance(value, str):
        return value
    return "-" if pd.isna(value) else shown(value, spec) + " %" * spec.endswith("%")
