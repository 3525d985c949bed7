"""A device's law: seconds for each of `counted.TERMS`, with intervals, fitted to draws.

The fit is robust: coefficients that are not negative, relative errors.

No device keeps the law exactly: draws miss it by 9 to 27 %, where noise is 1 %, and an eighth to a
half of that is common to the draws of a group. So the error of a draw is taken for the sum of two,
one of its own and one that its group shares. Both variances are told by what the fit leaves within
groups and of their means, less what the fit has followed of each (the moments' estimator of a model
with a random effect for each group). They give the coefficients' covariance. As groups are few,
intervals are Student's, with half as many degrees of freedom as there are groups. Errors of the
epochs are among those of the draws. Coefficients may be negative here: where they may not, a term
that costs nothing makes others too small.

A cost is shown if it would be among so many terms, by Bonferroni's correction: no more than one
device in twenty is to be said to charge for what is free. Some terms cannot be told apart, as all
draws have about as much of one as of the other; of `SUMS` of them more is known.

Sources: S. Searle, G. Casella and C. McCulloch, "Variance Components", 1992, chapter 5; J. Imbens
and M. Kolesar, "Robust standard errors in small samples", Review of Economics and Statistics 98(4),
2016. How often the intervals hold the truth: `scripts/studies/laws.py`.
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
from triangulators.criteria.families import CALIBRATED_FEATURES

CONFIDENCE = 0.95
OF_ALL = 1.0 - (1.0 - CONFIDENCE) / len(TERMS)
"""What a single cost needs to be shown, that one device in twenty is said to have a false one."""

SUMS: dict[str, dict[str, float]] = {
    "triangle": {"triangles": 1.0, "set_up": 1.0, "covering": 1.0, "vertices": 3.0},
    "walk": {"half_perimeter": 1.0, "near": 1.0},
}
"""Terms that go together: a triangle that covers a pixel, with three vertices of its own, and a
pixel of the width and height of a small triangle's box."""

FOLDS = 6
"""Parts of the draws, each of which is predicted by a fit to the others."""

SHARE = 0.002
"""Of a draw's time: what takes less of every draw's time than this is nothing."""

Seconds = NDArray[np.float64]
Labels = Sequence[Any] | NDArray[Any]


@dataclass(frozen=True)
class Law:
    """What a device's time is made of.

    costs : (t,) of each of `TERMS`, in the times' unit; 0 for those it does not have
    free : (t,) the same where they may be negative; covariance : (t, t) of these
    groups : of the draws, how many
    r2_over, r2_within : of log time of draws that were held out, over all of them and within groups
        of draws that differ in what their kind isolates alone
    shares : (k, t) how much of each draw's time one of each term is
    """

    costs: Seconds
    free: Seconds
    covariance: Seconds
    groups: int
    r2_over: float
    r2_within: float
    shares: Seconds

    @property
    def intervals(self) -> Seconds:
        """The ends of each 95 % interval, (t, 2): no less than 0, and around the fitted costs."""
        ends = [self.sum_of(one, CONFIDENCE) for one in np.eye(len(self.costs))]
        return np.array([(low, high) for _, low, high in ends])

    @property
    def shown(self) -> NDArray[np.bool_]:
        """Which terms are shown to cost anything, (t,)."""
        return np.array([self.is_shown(one) for one in np.eye(len(self.costs))])

    def sum_of(self, weights: Seconds, confidence: float) -> tuple[float, float, float]:
        """Return a weighed sum of terms with its interval; (t,) `weights`."""
        error = float(np.sqrt(weights @ self.covariance @ weights))
        width = quantile(self.groups, confidence) * error
        value, free = float(weights @ self.costs), float(weights @ self.free)
        return value, max(0.0, min(value, free - width)), max(value, free + width)

    def is_shown(self, weights: Seconds) -> bool:
        """Whether a weighed sum is shown to cost more than `SHARE` of some draw's time."""
        used = np.flatnonzero(weights)
        most = (self.shares[:, used] / weights[used]).min(axis=1).max()
        return self.sum_of(weights, OF_ALL)[1] * float(most) > SHARE


def quantile(groups: int, confidence: float) -> float:
    """Return how many standard errors an interval reaches, of draws in so many groups."""
    return float(stdtrit(groups / 2, 0.5 + confidence / 2))


def fit(design: Design, epochs: Seconds, groups: Sequence[str], seed: int = 0) -> Law:
    """Fit a law to (k, t) rows of `TERMS` and (e, k) seconds of each epoch.

    groups : (k,) draws that differ in what their kind isolates have one name; seed : of the folds
    """
    seconds = np.exp(np.log(epochs).mean(axis=0))
    labels = np.unique(np.asarray(groups), return_inverse=True)[1]
    free, covariance = _covariance(design, seconds, labels)
    predicted = held_out(design, seconds, labels, seed)
    return Law(
        costs=solve(design, seconds, labels),
        free=free,
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

    The last turn of the fit is linear in the draws' errors: coefficients move by `moved` @ errors.
    """
    free, fitted, columns, scale, trust = _fit(design, seconds, labels, np.linalg.lstsq)
    shares = design / fitted[:, None]
    unit = trust[:, None] * stacked(np.eye(len(seconds)), labels)
    moved = np.linalg.pinv(columns) @ unit / scale[:, None]
    errors = seconds / fitted - shares @ free
    left = np.eye(len(seconds)) - shares @ moved  # of an error, what the fit does not follow
    own = (labels[:, None] == labels).astype(np.float64)  # 1 for draws of one group
    mean = own / own.sum(axis=1)
    within = np.eye(len(seconds)) - mean
    # Squares within groups and of their means: what is expected of either for a variance of 1.
    told = np.array([errors @ within @ errors, errors @ mean @ errors])
    unit_of = [left @ left.T, left @ own @ left.T]
    expected = np.array([[(part * each).sum() for each in unit_of] for part in (within, mean)])
    alone, shared = np.linalg.solve(expected, told)
    if min(alone, shared) < 0:
        alone, shared = told.sum() / expected[:, 0].sum(), 0.0
    return free, alone * moved @ moved.T + shared * moved @ own @ moved.T


def held_out(design: Design, seconds: Seconds, labels: NDArray[np.int64], seed: int) -> Seconds:
    """Return (k,) seconds, each predicted by a fit to the draws of other folds than its own."""
    folds = folds_of(labels, seed)
    predicted = np.empty(len(seconds))
    for fold in range(FOLDS):
        out = folds == fold
        found = solve(design[~out], seconds[~out], labels[~out])
        predicted[out] = design[out] @ found
    return np.maximum(predicted, 1e-12)


def folds_of(labels: NDArray[np.int64], seed: int) -> NDArray[np.int64]:
    """Return the fold of each draw, (k,), of the draws' groups as numbers.

    Each group's draws are spread over the folds, so that no fit is without a kind of draws.
    """
    order = np.lexsort((np.random.default_rng(seed).random(len(labels)), labels))
    folds = np.empty(len(labels), np.int64)
    folds[order] = np.arange(len(labels)) % FOLDS
    return folds


def fewest(
    design: Design, seconds: Seconds, groups: Sequence[str], seed: int = 0
) -> tuple[str, ...]:
    """Return the fewest terms that predict as well as all.

    Terms are left out one by one, each time that without which the others predict best; of the sets
    on this way, the smallest within one standard error of the best is taken (Breiman, Friedman,
    Olshen and Stone, "Classification and Regression Trees", 1984, section 3.4).
    """
    from scipy.stats import sem

    labels = np.unique(np.asarray(groups), return_inverse=True)[1]

    def errors(columns: Sequence[int]) -> NDArray[np.float64]:
        predicted = held_out(design[:, columns], seconds, labels, seed)
        squared: NDArray[np.float64] = np.log(seconds / predicted) ** 2
        return squared

    kept = list(range(design.shape[1]))
    way = [(errors(kept), kept)]
    while len(kept) > 1:
        fewer = [[column for column in kept if column != left] for left in kept[1:]]
        judged = [(errors(columns), columns) for columns in fewer]
        way.append(min(judged, key=lambda each: each[0].mean()))
        kept = way[-1][1]
    least = min((found for found, _ in way), key=np.mean)
    enough = least.mean() + max(float(sem(least)), 1e-12)
    *_, chosen = (columns for found, columns in way if found.mean() <= enough)
    return tuple(list(TERMS)[column] for column in chosen)


COSTS = ("draw", *CALIBRATED_FEATURES)
"""What `optimal:calibrated` weighs, sums from coordinates alone: the draw itself, which no choice
changes, then the number of triangles T, their area S, their half-perimeters H, the areas of their
bounding boxes, the deviation D of their angles from 60 degrees, the expected quads Q and 4x4 blocks
P, and R, the expected number of triangles whose bounding box holds a pixel centre."""

BETWEEN = 0.3
"""Weight of the differences between sets of polygons; those within a set have weight 1."""

LARGE_ERROR = 0.05
"""A relative error beyond which an error counts by itself instead of by its square."""

FAR_OFF, CLOSE, MOST_TURNS = 2.0, 1e-4, 100
"""In which ratio to the measured time a fitted one may weigh; the fit ends when no fitted time
changes by more than `CLOSE` of it, or after so many turns."""


def costs_of(draws: Sequence[tuple[Frame, NDArray[np.int32]]]) -> Design:
    """Return (k, 9) rows of `COSTS` of draws, from coordinates alone."""
    predicted = (predict(frame.points / SUBPIXEL, triangles) for frame, triangles in draws)
    return np.array([[1.0, *(each[name] for name in COSTS[1:])] for each in predicted])


def solve(design: Design, seconds: Seconds, groups: Labels) -> Seconds:
    """Return the coefficients of (k, terms) columns: non-negative, with a soft L1 loss.

    groups : (k,) which draws have the same polygons, with different triangulations

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
    return _fit(design, seconds, labels, nnls)[0]


def _fit(
    design: Design, seconds: Seconds, labels: NDArray[np.int64], least: Any
) -> tuple[Seconds, ...]:
    """Return the coefficients of `solve`, then what tells how errors move them.

    That is, of the last turn: the fitted times, (k,); the rows, weighed, in units of their columns;
    these units; the rows' weights. least : solves equations by least squares
    """
    fitted, before, found = seconds, np.zeros(len(seconds)), np.zeros(design.shape[1])
    trust = np.ones(len(seconds) + labels.max() + 1)
    for _ in range(MOST_TURNS):
        # Each draw's row over its fitted time, so that errors are relative; as deviations from its
        # group and the groups' means, which may miss by more.
        rows = stacked(np.column_stack([design, seconds]) / fitted[:, None], labels)
        if found.any():
            # The soft L1 loss, 2 (sqrt(1 + e^2) - 1), has the weight (1 + e^2)^-1/2 for a squared
            # error; rows are multiplied by its root.
            errors = rows[:, :-1] @ found - rows[:, -1]
            trust = (1.0 + (errors / LARGE_ERROR) ** 2) ** -0.25
        scale = np.maximum(np.abs(rows[:, :-1]).max(axis=0), 1e-300)
        columns = rows[:, :-1] / scale * trust[:, None]
        if np.allclose(fitted, before, CLOSE, atol=0.0):
            break
        found, before = least(columns, rows[:, -1] * trust)[0] / scale, fitted
        # A draw that the fit misses by far keeps a weight of its own size.
        fitted = np.clip(design @ found, seconds / FAR_OFF, seconds * FAR_OFF)
    return found, fitted, columns, scale, trust


def stacked(shares: Design, labels: NDArray[np.int64]) -> Design:
    """Return (k, c) rows as deviations from their group's mean, and below these the means, weighed.

    A group's mean counts `BETWEEN` times as much as its draws would.
    """
    mean = np.stack([_means(column, labels) for column in shares.T], axis=1)
    weight = BETWEEN * np.sqrt(np.bincount(labels))
    return np.concatenate([shares - mean[labels], weight[:, None] * mean])


def _means(values: Seconds, labels: NDArray[np.int64]) -> Seconds:
    """Return the mean of the (k,) values of each label."""
    return np.asarray(np.bincount(labels, values) / np.bincount(labels))


def r_squared(measured: Seconds, predicted: Seconds) -> float:
    """Return the share of the measured variance that the prediction explains."""
    left = float(((measured - predicted) ** 2).sum())
    return 1.0 - left / float(((measured - measured.mean()) ** 2).sum())


def r_squared_within(measured: Seconds, predicted: Seconds, polygons: Labels) -> float:
    """Return R2 after each polygon's own mean (of logs) is subtracted from both."""
    labels = np.unique(np.asarray(polygons, dtype=str), return_inverse=True)[1]
    logs = np.log(measured), np.log(predicted)
    return r_squared(*(each - _means(each, labels)[labels] for each in logs))
