"""Scenes of many pictures, map tiles or views of a model: counters over them, with intervals."""

from dataclasses import dataclass
from math import isfinite

import numpy as np

from harness.metrics.groups import RecordGroup
from harness.metrics.registry import find_metric, measures
from harness.results.record import Record
from harness.stats.intervals import FEWEST, mean_interval, ratio_interval

DESCRIBED = ("helper_lanes", "quads")
"""Counters that `describe_views` compares, next to the main one."""


@dataclass(frozen=True)
class OverViews:
    """A counter of a record over v views, with 95 % intervals over these; NaN if there is none.

    mean : of the views, with `mean_low` and `mean_high`
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
        interval = f" ({self.ratio_low:.3f}-{self.ratio_high:.3f})"
        return f"{self.ratio:.3f}{interval if isfinite(self.ratio_low) else ''}"


def over_views(record: Record, base: Record | None, measure: str = "") -> OverViews | None:
    """Return a counter over the record's views; None if it has none, or lacks polygons.

    measure : a counter, by default the main one
    """
    if base is None or record.polygons != base.polygons:
        return None
    if record.views is None or base.views is None:
        return None
    sums, base_sums = record.views.counters, base.views.counters
    both = {*sums} & {*base_sums}
    measure = measure or next(iter(measures(both)), "")
    if measure not in both or len(sums[measure]) != len(base_sums[measure]):
        return None
    values, usual = (np.array(each[measure], np.float64) for each in (sums, base_sums))
    if not usual.sum():
        return None
    return OverViews(
        len(values),
        measure,
        float(values.mean()),
        *mean_interval(values),
        float(values.sum() / usual.sum()),
        *ratio_interval(values, usual),
    )


def describe_views(group: RecordGroup) -> list[str]:
    """Return how the group's counters compare over views, a line each, and ties of depth."""
    base = group.base
    if base is None:
        return []
    main = next(iter(measures(base.views.counters if base.views else ())), "")
    lines = [_line(group, base, name) for name in dict.fromkeys((main, *DESCRIBED))]
    if ties := base.counters.get("depth_ties", 0):
        lines.append(f"{ties:,} depth tests of {base.name} are ties: rounding decides them")
    return [line for line in lines if line]


def _line(group: RecordGroup, base: Record, measure: str) -> str:
    ratios = [
        (record.name, over)
        for record in group.measured
        if record is not base and (over := over_views(record, base, measure)) is not None
    ]
    if not ratios or not measure:
        return ""
    count, noun = ratios[0][1].views, "tile" if group.id.view.fit == "tile" else "view"
    nouns = f"{count:,} {noun}{'' if count == 1 else 's'}"
    how = f"with 95 % intervals over {nouns}"
    if count < FEWEST:
        how = f"over {nouns}, too few for intervals"
    ratios.sort(key=lambda pair: pair[1].ratio)
    listed = ", ".join(f"{name} {over.written}" for name, over in ratios)
    return f"{find_metric(measure).label} in ratio to {base.name}'s, {how}: {listed}"
