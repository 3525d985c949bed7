"""Scenes of many pictures, map tiles or views of a model: sums over them, intervals over them."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from harness.metrics.groups import base_of
from harness.metrics.registry import find, measures
from harness.results.run_folder import Record
from harness.stats.intervals import FEWEST, mean_interval, ratio_interval

VIEWS = "views"
"""Field of a record: the sums (v,) of each counter, one a tile or view; and the views' `NAMES`."""

NAMES = "names"

TOLD = ("helper_lanes", "quads")
"""Counters of which a line is said, and the main one."""


@dataclass(frozen=True)
class OverViews:
    """A counter of a record of v views, with 95 % intervals over these; NaN for none.

    mean : a view's, with `mean_low` and `mean_high`
    ratio : of the sum to the base's, with `ratio_low` and `ratio_high`
    """

    views: int
    measure: str
    mean: float
    mean_low: float
    mean_high: float
    ratio: float
    ratio_low: float
    ratio_high: float

    @property
    def written(self) -> str:
        """The ratio, with its interval if it has one."""
        told = f" ({self.ratio_low:.3f}-{self.ratio_high:.3f})"
        return f"{self.ratio:.3f}{told if isfinite(self.ratio_low) else ''}"


def over_views(record: Record, base: Record | None, measure: str = "") -> OverViews | None:
    """Return what is told of a record's views; None where it has none, or lacks polygons.

    measure : a counter, by default the main one
    """
    if base is None or record.get("polygons") != base.get("polygons"):
        return None
    counted, others = record.get(VIEWS) or {}, base.get(VIEWS) or {}
    both = {*counted} & {*others} - {NAMES}
    measure = measure or next(iter(measures(both)), "")
    if measure not in both or len(counted[measure]) != len(others[measure]):
        return None
    own, usual = (np.array(each[measure], np.float64) for each in (counted, others))
    if not usual.sum():
        return None
    return OverViews(
        len(own),
        measure,
        float(own.mean()),
        *mean_interval(own),
        float(own.sum() / usual.sum()),
        *ratio_interval(own, usual),
    )


def said(members: Sequence[Record]) -> list[str]:
    """Say how a group's counters compare over views, a line each; and ties of depth."""
    base = base_of(members)
    if base is None:
        return []
    main = next(iter(measures({*(base.get(VIEWS) or {})} - {NAMES})), "")
    lines = [_line(members, base, name) for name in dict.fromkeys((main, *TOLD))]
    ties = (base.get("counters") or {}).get("depth_ties", 0)
    if ties:
        name = base["triangulator"]
        lines.append(f"{ties:,} depth tests of {name} are ties: rounding decides them")
    return [line for line in lines if line]


def _line(members: Sequence[Record], base: Record, measure: str) -> str:
    found = [
        (record["triangulator"], over)
        for record in members
        if record is not base
        and record["status"] == "ok"
        and (over := over_views(record, base, measure)) is not None
    ]
    if not found or not measure:
        return ""
    count, noun = found[0][1].views, "tile" if base.get("fit") == "tile" else "view"
    nouns = f"{count:,} {noun}{'' if count == 1 else 's'}"
    how = f"with 95 % intervals over {nouns}"
    if count < FEWEST:
        how = f"over {nouns}, too few for intervals"
    ratios = sorted(found, key=lambda each: each[1].ratio)
    told = ", ".join(f"{name} {each.written}" for name, each in ratios)
    return f"{find(measure).label} in ratio to {base['triangulator']}'s, {how}: {told}"
