"""Which figures decide a comparison, of all that records may hold.

A counter that nobody declared, of a rasteriser of somebody else's, is one like any other.
"""

from __future__ import annotations

from harness.figures.registry import figures, find
from harness.rasterisers.counters import DRIVER


def is_cost(name: str) -> bool:
    """Whether a change of the figure `name` for the worse is a regression without being asked for.

    Ratios of counters say nothing that the counters do not, predictions are not measurements, and
    what a driver says of itself is its opinion.
    """
    figure = find(name)
    counted = figure.kind in ("counter", "count")
    return counted and (figure.better != "none" or is_shared(name))


def is_shared(name: str) -> bool:
    """Whether every triangulation of a polygon has the same, so that any change is a defect."""
    figure = find(name)
    return figure.kind == "counter" and figure.better == "none" and not name.startswith(DRIVER)


def has_direction(name: str) -> bool:
    """Whether growth beyond a threshold can be a regression."""
    return find(name).better != "none" or is_shared(name)


def registered() -> list[str]:
    """Return the names of all exact figures that are known before anything is measured."""
    return [name for name, figure in figures().items() if figure.exact]
