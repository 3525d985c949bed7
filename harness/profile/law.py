"""A device's law: the cost in seconds of each of `counted.TERMS`, with intervals.

The fit is robust: non-negative coefficients, relative errors.

No device follows the law exactly: measured times deviate by 9 to 27 %, with noise of 1 %, and an
eighth to a half of that deviation is common to the draws of a group. So a draw's error is modelled
as the sum of an individual error and an error that its group shares. Both variances are estimated
from the residuals within groups and from the groups' mean residuals, corrected for the part of each
that the fit absorbs (the moment estimator of a model with a random effect for each group). They
give the coefficients' covariance. As groups are few, intervals are Student's, with half as many
degrees of freedom as there are groups. Errors of epochs are part of the errors of draws. For the
intervals, coefficients may be negative: a constraint at 0 would bias the other terms downwards.

A cost is significant if it is so among all terms, by Bonferroni's correction: at most one device in
twenty may get a false cost. Some terms cannot be separated because they are nearly proportional in
all draws; the sums `SUMS` of such terms are determined more precisely.

Sources: S. Searle, G. Casella and C. McCulloch, "Variance Components", 1992, chapter 5; J. Imbens
and M. Kolesar, "Robust standard errors in small samples", Review of Economics and Statistics 98(4),
2016. Coverage of the intervals: `scripts/studies/laws.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.special import stdtrit

from harness.frame import Frame
from harness.grid import SUBPIXEL
from harness.profile.counted import TERMS, Design
from triangulators.criteria import predict
from triangulators.criteria.criterion import CALIBRATED_FEATURES

CONFIDENCE = 0.95
FAMILY_CONFIDENCE = 1.0 - (1.0 - CONFIDENCE) / len(TERMS)
"""Confidence of a single cost, so that at most one device in twenty has a false one."""

SUMS: dict[str, dict[str, float]] = {
    "triangle": {"triangles": 1.0, "set_up": 1.0, "covering": 1.0, "vertices": 3.0},
    "walk": {"half_perimeter": 1.0, "near": 1.0},
}
"""Sums of nearly proportional terms: a triangle that covers a pixel, with three unshared vertices,
and a pixel of the width and height of a small triangle's box."""

FOLDS = 6
"""Number of parts of the draws in cross-validation."""

MIN_TIME_SHARE = 0.002
"""Terms that take a smaller share of every draw's time count as free."""

Seconds = NDArray[np.float64]
Labels = Sequence[Any] | NDArray[Any]


@dataclass(frozen=True)
class Law:
    """The fitted costs of a device.

    costs : (t,) of each of `TERMS`, in the times' unit; 0 for terms that the device does not have
    signed_costs : (t,) the same without the constraint at 0; covariance : (t, t) of these
    groups : number of groups of draws
    r2_over, r2_within : R2 of the log times of held-out draws, over all draws and within groups of
        draws that differ only in the term that their kind isolates
    shares : (k, t) share of each draw's time that a cost of 1 of each term would take
    """

    costs: Seconds
    signed_costs: Seconds
    covariance: Seconds
    groups: int
    r2_over: float
    r2_within: float
    shares: Seconds

    @property
    def intervals(self) -> Seconds:
        """Ends of the 95 % interval of each cost, (t, 2): not negative, and around the cost."""
        units = np.eye(len(self.costs))
        return np.array([self.estimate_sum(unit, CONFIDENCE)[1:] for unit in units])

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Whether each cost is significant, (t,)."""
        return np.array([self.is_significant(unit) for unit in np.eye(len(self.costs))])

    def estimate_sum(self, weights: Seconds, confidence: float) -> tuple[float, float, float]:
        """Return a sum of costs with (t,) `weights`, and the ends of its interval."""
        error = float(np.sqrt(weights @ self.covariance @ weights))
        width = student_quantile(self.groups, confidence) * error
        value, signed = float(weights @ self.costs), float(weights @ self.signed_costs)
        return value, max(0.0, min(value, signed - width)), max(value, signed + width)

    def saved_interval(self, spent: Seconds, base: Seconds, costs: Seconds) -> tuple[float, float]:
        """Return the 95 % interval of the share of a draw's time that another draw saves.

        spent, base : (t,) counts of the draw that saves and of the other; costs : (t,) costs that
        give the share itself. Delta method with the covariance of the signed costs.
        """
        base_s = float(base @ costs)
        ratio = float(spent @ costs) / base_s
        weights = (ratio * base - spent) / base_s  # the derivative of the share by each cost
        deviation = float(np.sqrt(weights @ self.covariance @ weights))
        error = student_quantile(self.groups, CONFIDENCE) * deviation
        moved = float(weights @ self.signed_costs)
        return 1 - ratio + min(0.0, moved - error), 1 - ratio + max(0.0, moved + error)

    def is_significant(self, weights: Seconds) -> bool:
        """Return whether a sum takes more than `MIN_TIME_SHARE` of some draw's time."""
        used = np.flatnonzero(weights)
        max_share = (self.shares[:, used] / weights[used]).min(axis=1).max()
        low = self.estimate_sum(weights, FAMILY_CONFIDENCE)[1]
        return low * float(max_share) > MIN_TIME_SHARE


def student_quantile(groups: int, confidence: float) -> float:
    """Return the half-width of an interval in standard errors, for a number of groups."""
    return float(stdtrit(groups / 2, 0.5 + confidence / 2))


def fit(design: Design, epochs: Seconds, groups: Sequence[str], seed: int = 0) -> Law:
    """Fit a law to (k, t) rows of `TERMS` and (e, k) seconds of each epoch.

    groups : (k,) name of the group of draws that differ only in what their kind isolates
    seed : of the folds
    """
    seconds = np.exp(np.log(epochs).mean(axis=0))
    labels = np.unique(np.asarray(groups), return_inverse=True)[1]
    signed_costs, covariance = _covariance(design, seconds, labels)
    predicted = predict_held_out(design, seconds, labels, seed)
    return Law(
        costs=solve(design, seconds, labels),
        signed_costs=signed_costs,
        covariance=covariance,
        groups=int(labels.max()) + 1,
        r2_over=r_squared(np.log(seconds), np.log(predicted)),
        r2_within=r_squared_within(seconds, predicted, labels.tolist()),
        shares=design / seconds[:, None],
    )


def _covariance(
    design: Design, seconds: Seconds, labels: NDArray[np.int64]
) -> tuple[Seconds, Seconds]:
    """Return the signed coefficients, (t,), and their covariance under errors that groups share.

    The last iteration of the fit is linear in the errors: they move coefficients by
    `response` @ errors.
    """
    signed, fitted, columns, scale, trust = _fit(design, seconds, labels, np.linalg.lstsq)
    shares = design / fitted[:, None]
    unit = trust[:, None] * stack_deviations(np.eye(len(seconds)), labels)
    response = np.linalg.pinv(columns) @ unit / scale[:, None]
    errors = seconds / fitted - shares @ signed
    residual = np.eye(len(seconds)) - shares @ response  # the part of an error in the residuals
    same_group = (labels[:, None] == labels).astype(np.float64)
    mean = same_group / same_group.sum(axis=1)
    within = np.eye(len(seconds)) - mean
    # Squares within groups and of group means: observed, and expected for a variance of 1.
    observed = np.array([errors @ within @ errors, errors @ mean @ errors])
    sources = [residual @ residual.T, residual @ same_group @ residual.T]
    expected = np.array([[(part * source).sum() for source in sources] for part in (within, mean)])
    single, shared = np.linalg.solve(expected, observed)
    if min(single, shared) < 0:
        single, shared = observed.sum() / expected[:, 0].sum(), 0.0
    covariance = single * response @ response.T + shared * response @ same_group @ response.T
    return signed, covariance


def predict_held_out(
    design: Design, seconds: Seconds, labels: NDArray[np.int64], seed: int
) -> Seconds:
    """Return (k,) seconds, each predicted by a fit to the draws of the other folds."""
    folds = assign_folds(labels, seed)
    predicted = np.empty(len(seconds))
    for fold in range(FOLDS):
        out = folds == fold
        predicted[out] = design[out] @ solve(design[~out], seconds[~out], labels[~out])
    return np.maximum(predicted, 1e-12)


def assign_folds(labels: NDArray[np.int64], seed: int) -> NDArray[np.int64]:
    """Return the fold of each draw, (k,); the draws of a group are spread over the folds."""
    order = np.lexsort((np.random.default_rng(seed).random(len(labels)), labels))
    folds = np.empty(len(labels), np.int64)
    folds[order] = np.arange(len(labels)) % FOLDS
    return folds


def select_terms(
    design: Design, seconds: Seconds, groups: Sequence[str], seed: int = 0
) -> tuple[str, ...]:
    """Return the smallest set of terms that predicts as well as all terms.

    Backward elimination removes the term without which the others predict best. Of the sets on this
    path, the smallest within one standard error of the best is chosen (Breiman, Friedman, Olshen
    and Stone, "Classification and Regression Trees", 1984, section 3.4).
    """
    from scipy.stats import sem  # it takes long to import

    labels = np.unique(np.asarray(groups), return_inverse=True)[1]

    def squared_errors(columns: Sequence[int]) -> NDArray[np.float64]:
        predicted = predict_held_out(design[:, columns], seconds, labels, seed)
        squared: NDArray[np.float64] = np.log(seconds / predicted) ** 2
        return squared

    columns = list(range(design.shape[1]))
    path = [(squared_errors(columns), columns)]
    while len(columns) > 1:
        subsets = [[column for column in columns if column != gone] for gone in columns[1:]]
        path.append(min(((squared_errors(s), s) for s in subsets), key=lambda step: step[0].mean()))
        columns = path[-1][1]
    best = min((errors for errors, _ in path), key=np.mean)
    limit = best.mean() + max(float(sem(best)), 1e-12)
    *_, selected = (columns for errors, columns in path if errors.mean() <= limit)
    return tuple(list(TERMS)[column] for column in selected)


COSTS = ("draw", *CALIBRATED_FEATURES)
"""Terms that `optimal:calibrated` weights, sums from coordinates alone: the draw itself, which no
choice changes, then the number of triangles T, their area S, their half-perimeters H, the areas of
their bounding boxes, the deviation D of their angles from 60 degrees, the expected quads Q and 4x4
blocks P, and R, the expected number of triangles whose bounding box holds a pixel centre."""

BETWEEN_WEIGHT = 0.3
"""Weight of the differences between sets of polygons; those within a set have weight 1."""

LARGE_ERROR = 0.05
"""Relative error beyond which the loss is linear instead of quadratic."""

MAX_FIT_RATIO = 2.0
"""Upper bound of the ratio of a fitted to the measured time, either way, in the weights."""

FIT_TOLERANCE, MAX_ITERATIONS = 1e-4, 100
"""The fit ends if no fitted time changes by a larger share, or after so many iterations."""


def cost_rows(draws: Sequence[tuple[Frame, NDArray[np.int32]]]) -> Design:
    """Return (k, 9) rows of `COSTS` of draws, from coordinates alone."""
    predicted = (predict(frame.points / SUBPIXEL, triangles) for frame, triangles in draws)
    return np.array([[1.0, *(sums[name] for name in COSTS[1:])] for sums in predicted])


def solve(design: Design, seconds: Seconds, groups: Labels) -> Seconds:
    """Return the coefficients of (k, terms) columns: non-negative, with a soft L1 loss.

    groups : (k,) labels; draws of one label have the same polygons in different triangulations

    The draws of one set of polygons share a misfit that depends on the polygons' size and kind.
    It varies more than the differences within a set, but choosing a triangulation needs the
    differences. So the shared part has the weight `BETWEEN_WEIGHT`, as in a model with a random
    effect for each set.

    The weights of the soft L1 loss and the coefficients are computed alternately (P. Holland and
    R. Welsch, "Robust regression using iteratively reweighted least-squares", Communications in
    Statistics 6(9), 1977). Errors are relative to the fitted times: relative to the measured times,
    which contain the errors, noise would bias all coefficients downwards. A term that costs nothing
    gets exactly 0.
    """
    labels = np.unique(groups, return_inverse=True)[1]
    return _fit(design, seconds, labels, nnls)[0]


def _fit(
    design: Design, seconds: Seconds, labels: NDArray[np.int64], least_squares: Any
) -> tuple[Seconds, ...]:
    """Return the coefficients of `solve`, and the linear system of the last iteration.

    These are: the fitted times, (k,); the weighted rows in units of their columns; these units; the
    rows' weights. least_squares : solver, `nnls` or `lstsq`
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
        scale = np.maximum(np.abs(rows[:, :-1]).max(axis=0), 1e-300)
        columns = rows[:, :-1] / scale * trust[:, None]
        if np.allclose(fitted, before, FIT_TOLERANCE, atol=0.0):
            break
        before = fitted
        coefficients = least_squares(columns, rows[:, -1] * trust)[0] / scale
        # The weight of a draw that the fit misses by far stays near that of its measured time.
        fitted = np.clip(design @ coefficients, seconds / MAX_FIT_RATIO, seconds * MAX_FIT_RATIO)
    return coefficients, fitted, columns, scale, trust


def stack_deviations(shares: Design, labels: NDArray[np.int64]) -> Design:
    """Return (k, c) rows minus their group's mean, and below these the weighted group means.

    A group's mean counts `BETWEEN_WEIGHT` times as much as its draws would.
    """
    mean = np.stack([_means(column, labels) for column in shares.T], axis=1)
    weight = BETWEEN_WEIGHT * np.sqrt(np.bincount(labels))
    return np.concatenate([shares - mean[labels], weight[:, None] * mean])


def _means(values: Seconds, labels: NDArray[np.int64]) -> Seconds:
    """Return the mean of the (k,) values of each label."""
    return np.asarray(np.bincount(labels, values) / np.bincount(labels))


def r_squared(measured: Seconds, predicted: Seconds) -> float:
    """Return the share of the measured variance that the prediction explains."""
    residual = float(((measured - predicted) ** 2).sum())
    return 1.0 - residual / float(((measured - measured.mean()) ** 2).sum())


def r_squared_within(measured: Seconds, predicted: Seconds, polygons: Labels) -> float:
    """Return R2 after each polygon's mean (of logs) is subtracted from both."""
    labels = np.unique(np.asarray(polygons, dtype=str), return_inverse=True)[1]
    logs = np.log(measured), np.log(predicted)
    return r_squared(*(values - _means(values, labels)[labels] for values in logs))
