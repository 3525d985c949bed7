"""What a comparison knows of a figure by its name, also of one that it never heard of.

A rasteriser of somebody else's may count what nobody registered: it is a count, and less is better.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from harness.figures.polygons import SAME_FOR_ALL
from harness.figures.registry import METRICS

Kind = Literal["counter", "ratio", "prediction", "opinion", "time"]

PREDICTED = "predicted_"
"""Before the name of a criterion that is no registered metric."""

OPINION = "driver_"
"""Before the name of what a driver says of itself, which no two drivers count alike."""


@dataclass(frozen=True)
class Figure:
    """A figure of a record.

    better : "lower" or "higher" is better; "none" where neither is
    shared : every triangulation of a polygon has the same, so any difference is a defect
    """

    name: str
    unit: str
    kind: Kind
    better: Literal["lower", "higher", "none"]
    shared: bool = False

    @property
    def gated(self) -> bool:
        """Whether a change for the worse is a regression without being asked for.

        Ratios of counters say nothing that the counters do not, and predictions are not
        measurements.
        """
        return self.kind == "counter" and (self.shared or self.better != "none")


def find(name: str) -> Figure:
    """Return what is known of the figure `name`."""
    if name in SAME_FOR_ALL:
        return Figure(name, "", "counter", "none", shared=True)
    if name.startswith(OPINION):
        return Figure(name, "", "opinion", "none")
    metric = METRICS.get(name)
    if metric is None:
        predicted = name.startswith(PREDICTED)
        kind: Kind = "prediction" if predicted else "counter"
        return Figure(name, "", kind, "none" if predicted else "lower")
    if not metric.exact:
        return Figure(name, metric.unit, "time", metric.better)
    kinds: dict[str, Kind] = {"": "counter", "x": "ratio"}
    return Figure(name, metric.unit, kinds.get(metric.unit, "prediction"), metric.better)


def registered() -> list[str]:
    """Return the names of all exact figures that the registry has."""
    return [name for name, metric in METRICS.items() if metric.exact]
