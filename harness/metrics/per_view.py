"""Counters over the map tiles of a scene, or over the views of a model, with intervals."""

from dataclasses import dataclass
from math import isfinite

import numpy as np

from harness.metrics.groups import RecordGroup
from harness.metrics.registry import find_metric, list_costs
from harness.results.record import Record
from harness.stats.intervals import MIN_VALUES, compute_mean_interval, compute_ratio_interval

DESCRIBED = ("helper_lanes", "quads")
"""Counters that `describe_views` compares in addition to the main counter."""


@dataclass(frozen=True)
class ViewStatistics:
    """A counter of a record over its views, with 95 % intervals over the views; NaN if unknown.

    mean : mean of the views, with `mean_low` and `mean_high`
    ratio : sum over the views relative to the base's sum, with `ratio_low` and `ratio_high`
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
    def text(self) -> str:
        """The ratio, with its interval if there is one."""
        interval = f" ({self.ratio_low:.3f}-{self.ratio_high:.3f})"
        return f"{self.ratio:.3f}{interval if isfinite(self.ratio_low) else ''}"


def compare_views(record: Record, base: Record | None, measure: str = "") -> ViewStatistics | None:
    """Return statistics of a counter over a record's views, and of the ratio to the base.

    None without views, or if the records have different numbers of polygons.

    measure : a counter, by default the main counter
    """
    if base is None or record.polygons != base.polygons:
        return None
    if record.views is None or base.views is None:
        return None
    sums, base_sums = record.views.counters, base.views.counters
    common = {*sums} & {*base_sums}
    measure = measure or next(iter(list_costs(common)), "")
    if measure not in common or len(sums[measure]) != len(base_sums[measure]):
        return None
    values = np.array(sums[measure], np.float64)
    base_values = np.array(base_sums[measure], np.float64)
    if not base_values.sum():
        return None
    return ViewStatistics(
        len(values),
        measure,
        float(values.mean()),
        *compute_mean_interval(values),
        float(values.sum() / base_values.sum()),
        *compute_ratio_interval(values, base_values),
    )


def describe_views(group: RecordGroup) -> list[str]:
    """Return lines that compare the group's counters over views, and count depth ties."""
    base = group.base
    if base is None:
        return []
    main = next(iter(list_costs(base.views.counters if base.views else ())), "")
    lines = [_describe_counter(group, base, name) for name in dict.fromkeys((main, *DESCRIBED))]
    if ties := base.counters.get("depth_ties", 0):
        lines.append(f"{ties:,} depth tests of {base.name} are ties: rounding decides them")
    return [line for line in lines if line]


def _describe_counter(group: RecordGroup, base: Record, measure: str) -> str:
    """Return a line with each triangulator's ratio of a counter to the base, "" without views."""
    rows = [
        (statistics.ratio, record.name, statistics)
        for record in group.measured
        if record is not base and (statistics := compare_views(record, base, measure)) is not None
    ]
    if not rows or not measure:
        return ""
    views, noun = rows[0][2].views, "tile" if group.id.view.fit == "tile" else "view"
    nouns = f"{views:,} {noun}{'' if views == 1 else 's'}"
    note = f"95 % CI over {nouns}" if views >= MIN_VALUES else f"{nouns}, too few for intervals"
    rows.sort(key=lambda row: row[0])
    ratios = ", ".join(f"{name} {statistics.text}" for _, name, statistics in rows)
    return f"{find_metric(measure).label} relative to {base.name} ({note}): {ratios}"
