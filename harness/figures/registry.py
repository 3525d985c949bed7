"""Every figure derived from a record, by name: what it is, its unit, and which way is better.

Records hold raw samples and counters only; tables, plots and comparisons compute what they show
through this registry, so that one name means one thing everywhere.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from harness.stored.folder import Record


@dataclass(frozen=True)
class Metric:
    """One derived figure of a record.

    better : "lower" or "higher" is better, or "none" where neither is
    best_case : the value no triangulation can beat, None where it depends on the scene
    exact : True for what is counted, False for what is timed
    function : record -> value, or None where the record has no such figure
    """

    name: str
    description: str
    unit: str
    better: Literal["lower", "higher", "none"]
    best_case: float | None
    exact: bool
    function: Callable[[Record], float | None]

    def __call__(self, record: Record) -> float | None:
        """Return the figure for `record`."""
        return self.function(record)


def _field(*path: str, scale: float = 1.0) -> Callable[[Record], float | None]:
    def read(record: Record) -> float | None:
        value: Any = record
        for name in path:
            value = value.get(name) if isinstance(value, dict) else None
        return None if value is None else value * scale

    return read


def _ratio(
    top: Callable[[Record], float | None], bottom: Callable[[Record], float | None]
) -> Callable[[Record], float | None]:
    def divide(record: Record) -> float | None:
        numerator, denominator = top(record), bottom(record)
        if numerator is None or not denominator:
            return None
        return numerator / denominator

    return divide


def _counter(name: str) -> Callable[[Record], float | None]:
    return _field("counters", name)


def _overshading(record: Record) -> float | None:
    quads, fragments = _counter("quads")(record), _counter("fragments")(record)
    return 4 * quads / fragments if quads is not None and fragments else None


_SECONDS = _field("time", "median_s")


def _normalised(record: Record) -> float | None:
    seconds = _SECONDS(record)
    reference = (record.get("time") or {}).get("reference_s")
    if seconds is None or not reference:
        return None
    return seconds / statistics.median(reference)


METRICS = {
    metric.name: metric
    for metric in (
        Metric("triangles", "triangles drawn", "", "lower", None, True, _field("triangles")),
        Metric("fragments", "covered pixels", "", "none", None, True, _counter("fragments")),
        Metric("quads", "2x2 quads shaded", "", "lower", None, True, _counter("quads")),
        Metric(
            "helper_lanes",
            "lanes of those quads that cover nothing",
            "",
            "lower",
            0.0,
            True,
            _counter("helper_lanes"),
        ),
        Metric(
            "overshading",
            "lanes shaded for each pixel covered",
            "x",
            "lower",
            1.0,
            True,
            _overshading,
        ),
        Metric(
            "bbox_tests",
            "pixel centres tested in bounding boxes",
            "",
            "lower",
            None,
            True,
            _counter("bbox_tests"),
        ),
        Metric(
            "bbox_overdraw",
            "pixel centres tested for each pixel covered",
            "x",
            "lower",
            1.0,
            True,
            _ratio(_counter("bbox_tests"), _counter("fragments")),
        ),
        Metric(
            "draw_ms",
            "median time of one draw",
            "ms",
            "lower",
            0.0,
            False,
            _field("time", "median_s", scale=1e3),
        ),
        Metric(
            "draw_of_reference",
            "median draw over the same run's reference triangle",
            "x",
            "lower",
            0.0,
            False,
            _normalised,
        ),
        Metric(
            "triangulate_ms",
            "time to triangulate the scene",
            "ms",
            "lower",
            0.0,
            False,
            _field("triangulate_s", scale=1e3),
        ),
        Metric(
            "coverage_error",
            "pixels covered too often or not at all",
            "",
            "lower",
            0.0,
            True,
            _field("coverage_error"),
        ),
        Metric(
            "t_junctions",
            "vertices inside a triangle's edge",
            "",
            "lower",
            0.0,
            True,
            _field("t_junctions"),
        ),
        Metric(
            "overdraw",
            "predicted: the paper's A",
            "px^2",
            "lower",
            0.0,
            True,
            _field("predicted", "overdraw"),
        ),
        Metric(
            "half_perimeter",
            "predicted: H, sum of bounding-box width + height",
            "px",
            "lower",
            None,
            True,
            _field("predicted", "half_perimeter"),
        ),
    )
}
