"""Map tiles: what is counted is a sum over tiles, and how far other tiles may be from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from harness.figures.groups import base_of
from harness.figures.intervals import FEWEST, mean_interval, ratio_interval
from harness.figures.registry import find, measures
from harness.stored.folder import Record

TILES = "tiles"
"""Field of a record of map tiles: each counter's sums (t,) a tile."""


@dataclass(frozen=True)
class OverTiles:
    """The main counter of a record of t tiles, with 95 % intervals over these; NaN for none.

    mean : a tile's, with `mean_low` and `mean_high`
    ratio : of the sum to the base's, with `low` and `high`
    """

    measure: str
    tiles: int
    mean: float
    mean_low: float
    mean_high: float
    ratio: float
    low: float
    high: float


def over_tiles(record: Record, base: Record | None) -> OverTiles | None:
    """Return what is told of a record's tiles; None where it is of none, or lacks polygons."""
    if base is None or record.get("polygons") != base.get("polygons"):
        return None
    counted, others = record.get(TILES) or {}, base.get(TILES) or {}
    measure = next(iter(measures(set(counted) & set(others))), None)
    if measure is None or len(counted[measure]) != len(others[measure]):
        return None
    own, usual = (np.array(each[measure], np.float64) for each in (counted, others))
    if not usual.sum():
        return None
    return OverTiles(
        measure,
        len(own),
        float(own.mean()),
        *mean_interval(own),
        float(own.sum() / usual.sum()),
        *ratio_interval(own, usual),
    )


def said(members: Sequence[Record]) -> str | None:
    """Say in a line how a group's main counter compares over tiles; None where there are none."""
    base = base_of(members)
    found = [
        (record["triangulator"], over)
        for record in members
        if record is not base
        and record["status"] == "ok"
        and (over := over_tiles(record, base)) is not None
    ]
    if base is None or not found:
        return None
    first = found[0][1]
    begin = f"{find(first.measure).label} in ratio to {base['triangulator']}'s, "
    if first.tiles < FEWEST:
        begin += (
            f"over {first.tiles} {'tiles' if first.tiles > 1 else 'tile'}, too few for intervals: "
        )
    else:
        begin += f"with 95 % intervals over {first.tiles:,} tiles: "
    told = (
        f"{name} {over.ratio:.3f}"
        + (f" ({over.low:.3f}-{over.high:.3f})" if isfinite(over.low) else "")
        for name, over in sorted(found, key=lambda each: each[1].ratio)
    )
    return begin + ", ".join(told)
