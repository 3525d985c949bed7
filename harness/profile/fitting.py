"""Fit of non-negative costs to times: relative errors, robust, with errors that groups share."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Design = NDArray[np.float64]
Seconds = NDArray[np.float64]
# Counters of k draws, (k, t); times (k,) or coefficients (t,); the group of each draw, (k,).
Labels = Sequence[Any] | NDArray[Any]

BETWEEN_WEIGHT = 0.3  # of differences between sets of polygons; within a set, the weight is 1
LARGE_ERROR = 0.05  # relative error beyond which the loss is linear instead of quadratic

# Maximum factor between the measured time and the fitted time by which a draw is weighted.
MAX_FIT_RATIO = 2.0

# The fit ends if fitted times change by smaller shares, or at this number of iterations.
FIT_TOLERANCE, MAX_ITERATIONS = 1e-4, 100


def fit_coefficients(design: Design, seconds: Seconds, groups: Labels) -> Seconds:
    """Return non-negative coefficients (t,) with which `design` (k, t) predicts `seconds` (k,).

    groups : (k,) labels; draws of one label have the same polygons in different triangulations

    The misfit that the draws of one set of polygons share varies more than the differences within a
    set, which decide between triangulations, so it has the weight `BETWEEN_WEIGHT`, as in a model
    with a random effect for each set. The weights of the soft L1 loss and the coefficients are
    computed alternately (P. Holland and R. Welsch, "Robust regression using iteratively reweighted
    least-squares", Communications in Statistics 6(9), 1977). Errors are relative to the fitted
    times: relative to the measured times, which contain the errors, noise would bias all
    coefficients downwards.
    """
    from scipy.optimize import nnls  # slow to import, and reading a profile fits nothing

    labels = np.unique(groups, return_inverse=True)[1]
    return fit_iteratively(design, seconds, labels, nnls)[0]


def fit_iteratively(
    design: Design, seconds: Seconds, labels: NDArray[np.int64], least_squares: Any
) -> tuple[Seconds, ...]:
    """Return the coefficients of `fit_coefficients`, and the linear system of the last iteration.

    The system: the fitted times, (k,); the weighted rows, each column divided by its scale; the
    scales; the weights of the rows. `least_squares` is the solver, `nnls` or `lstsq`.
    """
    fitted, before = seconds, np.zeros(len(seconds))
    coefficients = np.zeros(design.shape[1])
    trust = np.ones(len(seconds) + labels.max() + 1)
    for _ in range(MAX_ITERATIONS):
        # Each row is divided by the draw's fitted time, so that errors are relative, and split into
        # deviations from its group's mean and the groups' means, which may miss by more.
        rows = stack_deviations(np.column_stack([design, seconds]) / fitted[:, None], labels)
        if coefficients.any():
            # The soft L1 loss, 2 (sqrt(1 + e^2) - 1), has the weight (1 + e^2)^-1/2 for a squared
            # error; rows are multiplied by its root.
            errors = rows[:, :-1] @ coefficients - rows[:, -1]
            trust = (1.0 + (errors / LARGE_ERROR) ** 2) ** -0.25
        scale = np.abs(rows[:, :-1]).max(axis=0)
        scale[scale == 0.0] = 1.0
        columns = rows[:, :-1] / scale * trust[:, None]
        if (np.abs(fitted - before) <= FIT_TOLERANCE * before).all():
            break
        before = fitted
        coefficients = least_squares(columns, rows[:, -1] * trust)[0] / scale
        # The weight of a draw that the fit misses by far stays near that of its measured time.
        fitted = np.clip(design @ coefficients, seconds / MAX_FIT_RATIO, seconds * MAX_FIT_RATIO)
    return coefficients, fitted, columns, scale, trust


def compute_loss(seconds: Seconds, predicted: Seconds, labels: NDArray[np.int64]) -> float:
    """Return the soft L1 loss of predicted times, as `fit_coefficients` weights it."""
    errors = stack_deviations((seconds / predicted - 1.0)[:, None], labels)
    return float((np.sqrt(1.0 + (errors / LARGE_ERROR) ** 2) - 1.0).sum())


def stack_deviations(shares: Design, labels: NDArray[np.int64]) -> Design:
    """Return rows (k, c) of `shares` minus their group's mean, and below, the scaled means (g, c).

    A mean is multiplied by `BETWEEN_WEIGHT` and the square root of the group's size, so that its
    square counts as much as the squares of that many rows.
    """
    mean = compute_group_means(shares, labels)
    weight = BETWEEN_WEIGHT * np.sqrt(np.bincount(labels))
    return np.concatenate([shares - mean[labels], weight[:, None] * mean])


def compute_group_means(values: Seconds, labels: NDArray[np.int64]) -> Seconds:
    """Return the mean of each group's `values`, (k,) or (k, c): (g,) or (g, c)."""
    members = labels == np.arange(labels.max() + 1)[:, None]
    return np.asarray(members / members.sum(axis=1)[:, None] @ values)


def compute_r_squared(measured: Seconds, predicted: Seconds) -> float:
    """Return the share of the measured variance that the prediction explains."""
    residual = float(((measured - predicted) ** 2).sum())
    return 1.0 - residual / float(((measured - measured.mean()) ** 2).sum())


def compute_r_squared_within(measured: Seconds, predicted: Seconds, polygons: Labels) -> float:
    """Return R2 of log times after each polygon's mean is subtracted; polygons : (k,) labels."""
    labels = np.unique(np.asarray(polygons, dtype=str), return_inverse=True)[1]
    logs = np.log(measured), np.log(predicted)
    return compute_r_squared(
        *(values - compute_group_means(values, labels)[labels] for values in logs)
    )
