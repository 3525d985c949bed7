"""What a choice saves in the views of a model: sums over views, intervals over views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.figures.groups import base_of
from harness.figures.intervals import student_interval
from harness.stored.folder import Record

VIEWS = "views"
"""A record's table of counters: for each a list, one sum a view; and the views' names."""

TOLD = {"helper_lanes": "helper lanes", "quads": "shaded quads"}


@dataclass(frozen=True)
class OverViews:
    """A counter in ratio to the base's.

    value : of the sums over all views
    low, high : 95 % interval, as if the views were some of many (a ratio of means, by Student's t;
        W. G. Cochran, "Sampling techniques", 1977, chapter 6)
    """

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.3f} ({self.low:.3f} to {self.high:.3f})"


def over_views(record: Record, base: Record, counter: str) -> OverViews | None:
    """Return a counter of a record in ratio to its base's; None where it is not known of views."""
    own, other = ((each.get(VIEWS) or {}).get(counter) for each in (record, base))
    if not own or not other or len(own) != len(other) or not sum(other) or not sum(own):
        return None
    if len(own) < 2:
        return None
    value = sum(own) / sum(other)
    off = (np.array(own) - value * np.array(other)) / np.mean(other)
    _, low, high = student_interval(off)
    return OverViews(value, value + low, value + high)


def views_told(members: Sequence[Record]) -> list[str]:
    """Say, a line for each triangulator, what it does to what is shaded in a model's views."""
    base = base_of(members)
    if base is None or not base.get(VIEWS):
        return []
    lines = []
    for record in members:
        if record is base or record["status"] != "ok":
            continue
        found = {words: over_views(record, base, name) for name, words in TOLD.items()}
        told = ", ".join(f"{words} {ratio}" for words, ratio in found.items() if ratio)
        if told:
            lines.append(f"{record['triangulator']} in ratio to {base['triangulator']}: {told}")
    if not lines:
        return []
    ties = base["counters"].get("depth_ties", 0)
    if ties:
        lines.append(
            f"{ties:,} depth tests of {base['triangulator']} are ties: rounding decides them"
        )
    count = len(base[VIEWS]["names"])
    return [f"over {count} views, ratios of sums and their 95 % intervals:", *lines]
