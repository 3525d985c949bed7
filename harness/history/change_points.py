"""Finds where a series changes for good.

An exact figure changes wherever it differs from the run before. A noisy one is cut into stretches
of constant median by the pruned exact linear time search of Killick, Fearnhead & Eckley (2012);
absolute deviations are its cost, so that a run on a busy machine is no change. Steps too small to
act on are then left out, the smallest first.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from scenes.spec import install

SHORTEST = 3
"""Runs in a stretch: one or two odd runs are noise, and the last ones are for `compare`."""

PENALTY = 3.0
"""Times mean deviation times log n, a change; outliers make more than the textbook's 1 needed."""

LEAST_NOISE = 0.0075
"""Mean deviation of a log time between runs of the same code, at the least."""

LEAST_STEP = 0.03
"""Least step of a log time that is a change."""


def changes_of_exact(values: NDArray[np.float64]) -> list[int]:
    """Return the positions at which (n,) values differ from the ones before."""
    return (np.flatnonzero(np.diff(values)) + 1).tolist()


def changes_of_noisy(logs: NDArray[np.float64]) -> list[int]:
    """Return the positions at which the level of (n,) log values changes."""
    if len(logs) < 2 * SHORTEST:
        return []
    try:
        import ruptures
    except ImportError:
        raise UsageError(f"where times change is found by ruptures: {install('history')}") from None
    noise = max(LEAST_NOISE, _noise(logs))
    search = ruptures.Pelt(model="l1", min_size=SHORTEST, jump=1).fit(logs[:, None])
    ends: list[int] = search.predict(pen=PENALTY * noise * math.log(len(logs)))
    return _worthwhile(logs, [int(end) for end in ends[:-1]])


def _worthwhile(logs: NDArray[np.float64], cuts: list[int]) -> list[int]:
    """Drop the cut with the smallest step until all steps are worth a mark."""
    while cuts:
        levels = [float(np.median(part)) for part in np.split(logs, cuts)]
        steps = np.abs(np.diff(levels))
        if steps.min() >= LEAST_STEP:
            break
        cuts = [cut for number, cut in enumerate(cuts) if number != int(steps.argmin())]
    return cuts


def _noise(logs: NDArray[np.float64]) -> float:
    """Return the mean deviation from the level, from the median size of differences.

    Differences of neighbours hardly see a change of level. For normal noise of deviation s their
    median size is 0.954 s, and the mean deviation is 0.798 s.
    """
    return float(0.798 / 0.954 * np.median(np.abs(np.diff(logs))))
