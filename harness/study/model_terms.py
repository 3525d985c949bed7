"""Which terms a model of a device's time needs: the fewest that predict as well as any.

Every set of terms is fitted to the designed draws and judged on polygons that no fit has seen, in
two ways: by its error over polygons, and by its regret, what is lost by drawing the triangulation
that it calls fastest. Half of these polygons choose the sets; what is told of them is of the rest.
Terms that are the same for all triangulations of a polygon, T and S, change the first alone.

The rule is that of one standard error (Breiman, Friedman, Olshen and Stone, "Classification and
Regression Trees", 1984, section 3.4): of the sets that are within one standard error of the best
in both, the one with the fewest terms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import unknown
from harness.study import cost_model
from harness.study.cost_model import TERMS, DesignMatrix
from harness.study.statistics import regret_ends, regret_interval

LETTERS = dict(zip(TERMS[1:], ("T", "S", "H", "w*h", "D", "Q", "P", "R"), strict=True))
"""Symbols of the terms but for the draw itself, which every model has."""


@dataclass(frozen=True)
class HeldOut:
    """Draws of polygons that a model is judged on.

    design : (k, 9) rows of `TERMS`; seconds : (k,); halves : (k, 2) seconds by either half of the
    rounds; polygons : (k,) the polygon of each draw
    """

    design: DesignMatrix
    seconds: NDArray[np.float64]
    halves: NDArray[np.float64]
    polygons: Sequence[str]

    def split(self) -> tuple[HeldOut, HeldOut]:
        """Return every other polygon's draws, and those of the others."""
        sides: list[HeldOut] = []
        for side in range(2):
            kept = np.sort(np.concatenate(self.rows[side::2] or self.rows))
            names = [self.polygons[row] for row in kept]
            sides.append(HeldOut(self.design[kept], self.seconds[kept], self.halves[kept], names))
        return sides[0], sides[1]

    @cached_property
    def rows(self) -> list[NDArray[np.intp]]:
        """The draws of each polygon."""
        labels = np.unique(np.asarray(self.polygons, dtype=str), return_inverse=True)[1]
        return [np.flatnonzero(labels == label) for label in range(labels.max() + 1)]


@dataclass(frozen=True)
class Model:
    """A set of terms with its fitted seconds, and how it does on held-out polygons.

    r2_over, r2_within : of log time, over all draws and within polygons
    regret, regret_low, regret_high : mean over polygons, with its 95 % interval; NaN for the ends
        where there are too few polygons
    distance : how far it is from the best set, in standard errors, in error or regret, whichever
        is more; of the polygons by which sets were chosen, all else is of others
    """

    terms: tuple[str, ...]
    coefficients: dict[str, float]
    r2_over: float
    r2_within: float
    regret: float
    regret_low: float
    regret_high: float
    distance: float

    @property
    def written(self) -> str:
        """Its terms by their letters: T + S + H."""
        return " + ".join(self.letters)

    @property
    def letters(self) -> tuple[str, ...]:
        """The letters of its terms."""
        return tuple(LETTERS[name] for name in self.terms)

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON-ready values."""
        return {
            "terms": list(self.terms),
            "coefficients": self.coefficients,
            "r2_over_polygons": self.r2_over,
            "r2_within_polygons": self.r2_within,
            "regret": self.regret,
            "regret_ci95": [
                end if np.isfinite(end) else None for end in (self.regret_low, self.regret_high)
            ],
            "standard_errors_from_best": self.distance,
        }


def alternatives(
    design: DesignMatrix,
    seconds: NDArray[np.float64],
    groups: Sequence[int],
    choosing: HeldOut,
    telling: HeldOut,
    terms: Iterable[str] = TERMS[1:],
    tick: Callable[[], None] = lambda: None,
) -> list[Model]:
    """Return the best model of each number of `terms`, from one term to all of them.

    design, seconds, groups : the designed draws; see `cost_model.fit`
    choosing, telling : held-out polygons by which a set is chosen, and others of which its figures
        are: by those that it was chosen by it would look too good
    tick : called after each of the `number_of_sets` fits
    """
    known = list(terms)
    sets = [s for number in range(1, len(known) + 1) for s in combinations(known, number)]
    fits = []
    for chosen in sets:
        fits.append(_fitted(design, seconds, groups, chosen))
        tick()
    chosen_by = [cost_model.predict(fit, choosing.design) for fit in fits]
    errors = np.array([_errors(choosing, each) for each in chosen_by])
    regrets = np.array([_regrets(choosing, each)[1] for each in chosen_by])
    distances = np.maximum(in_standard_errors(errors), in_standard_errors(regrets))
    found = []
    for number in range(1, len(known) + 1):
        of_size = [place for place, chosen in enumerate(sets) if len(chosen) == number]
        place = min(of_size, key=lambda p: (distances[p], errors[p].mean()))
        predicted = cost_model.predict(fits[place], telling.design)
        below, above = _regrets(telling, predicted)
        low, high = regret_interval(below, above)
        found.append(
            Model(
                terms=sets[place],
                coefficients=fits[place],
                r2_over=cost_model.r_squared(np.log(telling.seconds), np.log(predicted)),
                r2_within=cost_model.r_squared_within(telling.seconds, predicted, telling.polygons),
                regret=max(0.0, float((below + above).mean() / 2)),
                regret_low=low,
                regret_high=high,
                distance=float(distances[place]),
            )
        )
    return found


def number_of_sets(terms: Sequence[str]) -> int:
    """Return how many sets of terms there are, without the empty one."""
    return int(2 ** len(terms)) - 1


def named(letters: Sequence[str]) -> tuple[str, ...]:
    """Return the terms of letters, e.g. T, S and H. Raises `UsageError` for one there is not."""
    known = {letter: name for name, letter in LETTERS.items()}
    for letter in letters:
        if letter not in known:
            raise unknown("term", letter, known)
    return tuple(name for name, letter in LETTERS.items() if letter in letters)


def fewest(models: Sequence[Model]) -> Model:
    """Return the model with the fewest terms that is within one standard error of the best.

    Where none is in both ways at once, the one that comes nearest.
    """
    near = [model for model in models if model.distance <= 1.0]
    return near[0] if near else min(models, key=lambda model: model.distance)


def _fitted(
    design: DesignMatrix,
    seconds: NDArray[np.float64],
    groups: Sequence[int],
    chosen: Sequence[str],
) -> dict[str, float]:
    """Return the seconds of all `TERMS`, 0 for those that the model has not."""
    columns = cost_model.columns_of(chosen)
    found = np.zeros(len(TERMS))
    found[columns] = cost_model.solve(design[:, columns], seconds, groups)
    return dict(zip(TERMS, found.tolist(), strict=True))


def _errors(held_out: HeldOut, predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each polygon's mean squared error of log time."""
    squared = np.log(held_out.seconds / predicted) ** 2
    return np.array([squared[rows].mean() for rows in held_out.rows])


def _regrets(held_out: HeldOut, predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what each polygon loses by drawing what is predicted to be fastest.

    (2, p): from below and from above; see `harness.study.statistics.regret_ends`.
    """
    ends = [
        regret_ends(held_out.halves[rows], int(np.argmin(predicted[rows])))
        for rows in held_out.rows
    ]
    return np.array(ends).T


def in_standard_errors(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far each row's mean is above the least, in standard errors of that row's mean."""
    means = values.mean(axis=1)
    best = int(np.argmin(means))
    error = values[best].std(ddof=1) / np.sqrt(values.shape[1]) if values.shape[1] > 1 else 0.0
    return (means - means[best]) / max(error, 1e-12)
