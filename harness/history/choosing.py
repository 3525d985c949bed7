"""Chooses what of a history is worth looking at: what was asked for, and what changed most."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from harness.errors import unknown
from harness.history.series import TOGETHER, Series

MOST = 12
"""Series that are shown unless all are asked for: as many as one can follow."""


@dataclass(frozen=True)
class Choice:
    """What is wanted of a history; () for no restriction."""

    scenes: tuple[str, ...] = ()
    triangulators: tuple[str, ...] = ()
    rasterisers: tuple[str, ...] = ()
    all: bool = False


def matching(series: Sequence[Series], choice: Choice) -> list[Series]:
    """Return the series that were asked for.

    Raises
    ------
    UsageError
        if no run has what was asked for
    """
    wanted = (
        ("scene", choice.scenes, lambda entry: entry.name.scene),
        ("triangulator", choice.triangulators, lambda entry: entry.name.triangulator),
        ("rasteriser", choice.rasterisers, lambda entry: entry.name.rasteriser),
    )
    left = list(series)
    for kind, names, value in wanted:
        known = {value(entry) for entry in left}
        for name in names:
            if name not in known:
                raise unknown(kind, name, known)
        left = [entry for entry in left if not names or value(entry) in names]
    return left


def worth_showing(series: Sequence[Series], choice: Choice) -> list[Series]:
    """Return what changed most, then what most runs have, at most `MOST` unless all are wanted.

    What only one run has, has no history.
    """
    if choice.all:
        return list(series)
    several = [entry for entry in series if np.isfinite(entry.values).sum() > 1]
    first = sorted(several, key=_interest)[:MOST]
    return [entry for entry in series if any(entry is each for each in first)]


def change_of(entry: Series) -> float:
    """Return the largest step of a series as an absolute log ratio; inf from or to 0."""
    cuts = [0, *entry.changes, len(entry.values)]
    levels = [float(np.nanmedian(entry.values[a:b])) for a, b in pairwise(cuts)]
    steps = [_step(before, after) for before, after in pairwise(levels)]
    return max(steps, default=0.0)


def _step(before: float, after: float) -> float:
    if before == after:
        return 0.0
    return abs(math.log(after / before)) if before > 0 and after > 0 else math.inf


def _interest(entry: Series) -> tuple[float, bool, float]:
    together = entry.name.triangulator == TOGETHER
    return -change_of(entry) if not together else 0.0, together, -np.isfinite(entry.values).sum()
