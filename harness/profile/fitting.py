"""Fits seconds to draws: robust, with errors relative to each draw's time, and how well it does.

`COSTS` are what a criterion may weigh, sums from coordinates alone: the draw itself, then the
number of triangles T, their area S, their half-perimeters H, the areas of their bounding boxes, the
deviation D of their angles from 60 degrees, the expected quads Q and 4x4 blocks P, and R, the
expected number of triangles whose bounding box holds a pixel centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from harness.frame import SUBPIXEL, Frame
from triangulators.criteria import CALIBRATED, predict

COSTS = ("draw", *CALIBRATED)
"""What `optimal:calibrated` weighs; the first is the draw itself, which no choice changes."""

BETWEEN = 0.3
"""Weight of the differences between sets of polygons; those within a set have weight 1."""

LARGE_ERROR = 0.05
"""A relative error beyond which an error counts by itself instead of by its square."""

FAR_OFF, CLOSE, MOST_TURNS = 2.0, 1e-4, 100
"""In which ratio to the measured time a fitted one may weigh; the fit ends when no fitted time
changes by more than `CLOSE` of it, or after so many turns."""

DesignMatrix = NDArray[np.float64]


def costs_of(draws: Sequence[tuple[Frame, NDArray[np.int32]]]) -> DesignMatrix:
    """Return (k, 9) rows of `COSTS` of draws, from coordinates alone."""
    predicted = (predict(frame.points / SUBPIXEL, triangles) for frame, triangles in draws)
    return np.array([[1.0, *(each[name] for name in COSTS[1:])] for each in predicted])


def solve(
    design: DesignMatrix,
    seconds: NDArray[np.float64],
    groups: Sequence[int] | NDArray[np.int64],
    *,
    signed: bool = False,
) -> NDArray[np.float64]:
    """Return the coefficients of (k, terms) columns: non-negative, with a soft L1 loss.

    groups : (k,) which draws have the same polygons, with different triangulations
    signed : let coefficients be negative; what forbids it makes others too small on average, where
        some cost nothing

    The draws of one set of polygons share a misfit that depends on the polygons' size and kind.
    It varies more than the differences within a set, but choosing a triangulation needs the
    differences. So the weight of what a set shares is `BETWEEN`, as in a model with a random
    effect for each set.

    The weights that the soft L1 loss gives are found by turns with the coefficients (P. Holland and
    R. Welsch, "Robust regression using iteratively reweighted least-squares", Communications in
    Statistics 6(9), 1977). Errors are relative to the fitted times: relative to the measured ones,
    which have the errors themselves, noise would make all coefficients too small. A term that costs
    nothing gets exactly 0.
    """
    labels = np.unique(groups, return_inverse=True)[1]
    least: Any = np.linalg.lstsq if signed else nnls
    fitted = seconds
    trust = np.ones(len(seconds) + labels.max() + 1)
    found = np.zeros(design.shape[1])
    for _ in range(MOST_TURNS):
        rows = stacked(np.column_stack([design, seconds]) / fitted[:, None], labels)
        if found.any():
            errors = rows[:, :-1] @ found - rows[:, -1]
            trust = trust_in(errors)
        scale = np.maximum(np.abs(rows[:, :-1]).max(axis=0), 1e-300)
        found = least(rows[:, :-1] / scale * trust[:, None], rows[:, -1] * trust)[0] / scale
        before = fitted
        # A draw that the fit misses by far keeps a weight of its own size.
        fitted = np.clip(design @ found, seconds / FAR_OFF, seconds * FAR_OFF)
        if np.abs(fitted / before - 1.0).max() <= CLOSE:
            break
    return np.asarray(found)


def stacked(shares: DesignMatrix, labels: NDArray[np.int64]) -> DesignMatrix:
    """Return (k, c) rows as deviations from their group's mean, and below these the means, weighed.

    A group's mean counts `BETWEEN` times as much as its draws would.
    """
    mean = np.stack([_means(column, labels) for column in shares.T], axis=1)
    weight = BETWEEN * np.sqrt(np.bincount(labels))
    return np.concatenate([shares - mean[labels], weight[:, None] * mean])


def trust_in(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights of rows with these errors under the soft L1 loss."""
    return np.asarray((1.0 + (errors / LARGE_ERROR) ** 2) ** -0.25)


def _means(values: NDArray[np.float64], labels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean of the (k,) values of each label."""
    return np.asarray(np.bincount(labels, values) / np.bincount(labels))


def r_squared(measured: NDArray[np.float64], predicted: NDArray[np.float64]) -> float:
    """Return the share of the measured variance that the prediction explains."""
    left = float(((measured - predicted) ** 2).sum())
    return 1.0 - left / float(((measured - measured.mean()) ** 2).sum())


def r_squared_within(
    measured: NDArray[np.float64],
    predicted: NDArray[np.float64],
    polygons: Sequence[Any] | NDArray[Any],
) -> float:
    """Return R2 after each polygon's own mean (of logs) is subtracted from both."""
    labels = np.unique(np.asarray(polygons, dtype=str), return_inverse=True)[1]
    logs = [np.log(measured), np.log(predicted)]
    centred = [x - _means(x, labels)[labels] for x in logs]
    return 1.0 - float(((centred[0] - centred[1]) ** 2).sum()) / float((centred[0] ** 2).sum())
