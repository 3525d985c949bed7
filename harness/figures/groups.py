"""Records that may be compared with each other, and what they are compared against."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

from harness.figures.ratios import Ratio, paired_ratio
from harness.stored.folder import Record

BASE = "ear-clipping"
"""What ratios are given against: the triangulator most programs use today."""


def group_of(record: Record) -> tuple[Any, ...]:
    """Return what the records that may be compared with each other have in common."""
    options = tuple(sorted((record.get("options") or {}).items()))
    names = ("scene", "rasteriser", "device", "resolution", "rotation", "fit")
    return (*(record.get(name) for name in names), options)


def groups(records: Sequence[Record]) -> list[list[Record]]:
    """Split records into those measured alike but for the triangulator."""
    ordered = sorted(records, key=lambda record: repr(group_of(record)))
    return [list(members) for _, members in groupby(ordered, key=group_of)]


def base_of(members: Sequence[Record]) -> Record | None:
    """Return the record of a group that the others are measured against, None without one."""
    return next((r for r in members if r["triangulator"] == BASE and r["status"] == "ok"), None)


def time_ratio(record: Record, base: Record | None) -> Ratio | None:
    """Return the paired ratio of two records' times, None where they are not comparable."""
    if base is None or record.get("polygons") != base.get("polygons"):
        return None
    times, base_times = record.get("time"), base.get("time")
    if not times or not base_times or times["reference_s"] != base_times["reference_s"]:
        return None
    return paired_ratio(times["samples_s"], base_times["samples_s"])
