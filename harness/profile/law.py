"""A device's law: seconds for each of `counted.TERMS`, with intervals, fitted to timed draws.

The fit is that of `harness.profile.fitting`: coefficients that are not negative, relative errors.
An interval holds two things. One is how much the times differ from epoch to epoch: epochs are drawn
anew. The other is by how much the draws miss the law beyond that noise: each error, made larger by
as much as the fit has followed it, is given a new sign, one for all draws of a group, which share
what the law misses. Resamples may be negative: where they may
not, a term that costs nothing makes others too small.

Sources: C. Cameron, J. Gelbach and D. Miller, "Bootstrap-based improvements for inference with
clustered errors", Review of Economics and Statistics 90(3), 2008; J. MacKinnon and H. White, "Some
heteroskedasticity-consistent covariance matrix estimators with improved finite sample properties",
Journal of Econometrics 29(3), 1985. How often the intervals hold the truth:
`scripts/studies/laws.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from harness.profile import fitting
from harness.profile.counted import TERMS, Design

RESAMPLES = 400
FOLDS = 6
"""Parts of the draws, each of which is predicted by a fit to the others."""

SHARE = 0.002
"""Of a draw's time: what takes less of every draw's time than this is nothing."""

Seconds = NDArray[np.float64]


@dataclass(frozen=True)
class Law:
    """What a device's time is made of.

    seconds : (t,) of each of `TERMS`, 0 for those it does not have
    resampled : (n, t) the same of each resample
    r2_over, r2_within : of log time of draws that were held out, over all of them and within groups
        of draws that differ in what their kind isolates alone
    most : (t,) the largest number of each term for a second of any draw
    """

    seconds: Seconds
    resampled: Seconds
    r2_over: float
    r2_within: float
    most: Seconds

    @property
    def intervals(self) -> Seconds:
        """The ends of each 95 % interval, (t, 2): no less than 0, and around the fitted seconds."""
        low, high = np.percentile(self.resampled, [2.5, 97.5], axis=0)
        ends = np.minimum(low, self.seconds), np.maximum(high, self.seconds)
        return np.maximum(np.stack(ends, axis=1), 0.0)

    @property
    def shown(self) -> NDArray[np.bool_]:
        """Which terms are shown to cost anything, (t,): their interval begins above nothing."""
        return self.intervals[:, 0] * self.most > SHARE


def fit(
    design: Design,
    epochs: Seconds,
    groups: Sequence[str],
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Law:
    """Fit a law to (k, t) rows of `TERMS` and (e, k) seconds of each epoch.

    groups : (k,) draws that differ in what their kind isolates have one name
    """
    seconds = np.exp(np.log(epochs).mean(axis=0))
    labels = np.unique(np.asarray(groups), return_inverse=True)[1]
    free = fitting.solve(design, seconds, labels, signed=True)
    fitted = np.clip(design @ free, seconds / fitting.FAR_OFF, seconds * fitting.FAR_OFF)
    logs = np.log(epochs) - np.log(seconds)
    # Resampled means of few epochs scatter too little: by the variance's bias, and as Student's
    # distribution is wider than the normal one.
    free_epochs = len(epochs) - 1
    apart = np.sqrt(len(epochs) / free_epochs) * stdtrit(free_epochs, 0.975) / ndtri(0.975)
    noise_of_mean = logs.var(axis=0, ddof=1).mean() / len(epochs)
    errors = _errors(design, seconds, fitted, float(noise_of_mean))
    random = np.random.default_rng(seed)
    resampled = []
    for _ in range(resamples):
        chosen = random.integers(len(epochs), size=len(epochs))
        noise = np.exp(apart * logs[chosen].mean(axis=0))
        signs = random.choice([-1.0, 1.0], labels.max() + 1)[labels]
        times = fitted * np.maximum(1.0 + signs * errors, 0.01) * noise
        resampled.append(fitting.solve(design, times, labels, signed=True))
    predicted = held_out(design, seconds, labels, seed)
    return Law(
        seconds=fitting.solve(design, seconds, labels),
        resampled=np.array(resampled),
        r2_over=fitting.r_squared(np.log(seconds), np.log(predicted)),
        r2_within=fitting.r_squared_within(seconds, predicted, labels.tolist()),
        most=(design / seconds[:, None]).max(axis=0),
    )


def _errors(design: Design, seconds: Seconds, fitted: Seconds, noise: float) -> NDArray[np.float64]:
    """Return by how much each draw misses the law, (k,), relative, the noise of epochs taken out.

    Each is over 1 less its leverage (MacKinnon and White's HC3).
    noise : variance of a draw's mean over the epochs, which the errors hold, too
    """
    rows = design[:, design.any(axis=0)] / fitted[:, None]
    basis = np.linalg.qr(rows / np.linalg.norm(rows, axis=0))[0]
    leverage = np.minimum((basis**2).sum(axis=1), 0.99)
    errors = (seconds / fitted - 1.0) / (1.0 - leverage)
    missed = max(0.0, 1.0 - noise / float(np.mean(errors**2) + 1e-30))
    return np.asarray(errors * np.sqrt(missed))


def held_out(design: Design, seconds: Seconds, labels: NDArray[np.int64], seed: int) -> Seconds:
    """Return (k,) seconds, each predicted by a fit to the draws of other folds than its own."""
    folds = folds_of(labels, seed)
    predicted = np.empty(len(seconds))
    for fold in range(FOLDS):
        out = folds == fold
        found = fitting.solve(design[~out], seconds[~out], labels[~out])
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
    labels = np.unique(np.asarray(groups), return_inverse=True)[1]

    def errors(columns: Sequence[int]) -> NDArray[np.float64]:
        predicted = held_out(design[:, columns], seconds, labels, seed)
        squared: NDArray[np.float64] = np.log(seconds / predicted) ** 2
        return squared

    kept = list(range(design.shape[1]))
    way, found = [kept], [errors(kept)]
    while len(kept) > 1:
        fewer = [[column for column in kept if column != left] for left in kept[1:]]
        judged = [errors(columns) for columns in fewer]
        best = int(np.argmin([each.mean() for each in judged]))
        kept = fewer[best]
        way.append(kept)
        found.append(judged[best])
    means = [each.mean() for each in found]
    best = int(np.argmin(means))
    error = found[best].std(ddof=1) / np.sqrt(len(seconds)) if len(seconds) > 1 else 0.0
    enough = means[best] + max(float(error), 1e-12)
    chosen = max(place for place, mean in enumerate(means) if mean <= enough)
    return tuple(list(TERMS)[column] for column in way[chosen])
