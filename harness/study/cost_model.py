"""Fits a model of a device's draw time, on draws designed to tell its terms apart.

    time = c0 + cT*T + cS*S + cH*H + cB*sum(w*h) + cD*D + cQ*Q + cP*P + cR*R

T is the number of triangles, S their area, H their half-perimeters, w*h the areas of their bounding
boxes, and D the deviation of their angles from 60 degrees. Q and P are the expected quads and 4x4
blocks; unlike H, they are small for slivers that cover nothing. R is the expected number of
triangles whose bounding box holds a pixel centre; a device can drop the others early.

D stands for mispredicted branches. Which corner of a triangle is its lowest, or its leftmost,
changes least from one triangle to the next if the triangles are well shaped. For triangles smaller
than a pixel, this is the difference that remains.

The fit is non-negative, because no term can make a draw faster. It is robust, because a draw that
another program disturbed must not change it much. It stays a sum over triangles, so
`optimal:calibrated` minimises it exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from shapely import Polygon

from harness.frame import SUBPIXEL
from triangulators.criteria import CALIBRATED

TERMS = ("draw", *CALIBRATED)
"""Columns of a design: one for the draw itself, then T, S, H, the sum of w*h, D, Q, P and R."""

UNITS = ("s", "s", "s/px^2", "s/px", "s/px^2", "s/degree", "s", "s", "s")

VERTICES = (6, 12, 24, 48, 96)
EXTENTS = (0.01, 0.03, 0.06, 0.12, 0.25, 0.5, 0.95)
"""Sizes of the designed polygons as shares of the viewport."""

ALONE = 0.2
"""A designed polygon of this share of the viewport or more is drawn alone."""

CROWD = (1000, 4000)
"""Smallest and largest number of triangles in a draw of small polygons."""

SHAPES = ((0.35, 1.0), (0.35, 0.05), (0.97, 1.0), None)
"""Smallest radius of a star, as a share of its largest, and how far it is squeezed; None: a stroke.
Squeezed and nearly round polygons have slivers as triangles. Slivers separate the cost of covered
pixels from the cost of bounding boxes. Letters and roads are made of strokes."""

CUTS = (
    "delaunay",
    "optimal:half-perimeter",
    "optimal:shape",
    "optimal:overdraw",
    "optimal:edge-length",
)
"""Triangulators of the designed polygons. All are good ones, because the model must choose among
good triangulations. The slivers of the worst cost less than H predicts; a fit to them would be
wrong for the others."""

BETWEEN = 0.3
"""Weight of the differences between sets of polygons; those within a set have weight 1."""

LARGE_ERROR = 0.05
"""A relative error beyond which an error counts by itself instead of by its square."""

FAR_OFF, CLOSE, MOST_TURNS = 2.0, 1e-4, 100
"""In which ratio to the measured time a fitted one may weigh; the fit ends when no fitted time
changes by more than `CLOSE` of it, or after so many turns."""

DesignMatrix = NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """A fitted model: seconds for each of `TERMS`, with 95 % bootstrap intervals.

    r2 : of the fitted draws; relative_residuals : quartiles of (measured - fitted) / measured
    valid : for each term, the (lowest, highest) value among the fitted draws
    """

    coefficients: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    r2: float
    relative_residuals: tuple[float, float, float]
    valid: dict[str, tuple[float, float]]
    draws: int

    def to_json(self) -> dict[str, Any]:
        """Return the fit as JSON-ready values."""
        return {**asdict(self), "units": dict(zip(TERMS, UNITS, strict=True))}


def designed_polygons(resolution: int, seed: int = 0) -> list[list[Polygon]]:
    """Return the polygons of each draw, in a viewport of `resolution` px: T, S, H and w*h vary.

    They are stars of random radii and strokes, rotated, of all `VERTICES`, `EXTENTS` and `SHAPES`.
    A large polygon is alone in its draw. Small ones share a draw: as many as `CROWD` triangles
    take, or as fit side by side. So the cost of the draw itself can be told from theirs. All are
    different, because a processor learns the branches of a few hundred triangles that are drawn
    again and again.
    """
    random = np.random.default_rng(seed)
    found = []
    for number in VERTICES:
        for extent in EXTENTS:
            size = extent * resolution
            for shape in SHAPES:
                if extent < ALONE:
                    wanted = random.uniform(*CROWD) / (number - 2)
                    places = _places(resolution, size, wanted)
                else:
                    places = _anywhere(random, resolution, size)
                found.append([_polygon(random, shape, number, size, place) for place in places])
    # Rounding to the grid makes edges of the thinnest polygons cross.
    valid = [[polygon for polygon in polygons if polygon.is_valid] for polygons in found]
    return [polygons for polygons in valid if polygons]


def _anywhere(random: np.random.Generator, resolution: int, size: float) -> NDArray[np.float64]:
    """Return the centre (1, 2) of one polygon, 2 px or more from the viewport's sides."""
    room = resolution - size - 4
    return resolution / 2 + random.uniform(-0.5, 0.5, (1, 2)) * room


def _places(resolution: int, size: float, wanted: float) -> NDArray[np.float64]:
    """Return the centres of at most `wanted` polygons, row after row, none touching another."""
    pitch = size + 2
    across = max(1, int((resolution - 4) / pitch))
    number = np.arange(min(across**2, max(1, round(wanted))))
    cells = np.column_stack([number % across, number // across]).astype(np.float64)
    return 2 + (cells + 0.5) * pitch


def _polygon(
    random: np.random.Generator,
    shape: tuple[float, float] | None,
    number: int,
    size: float,
    centre: NDArray[np.float64],
) -> Polygon:
    """Return a star or a stroke, turned, at most `size` px wide and off the pixels' grid."""
    xy = _stroke(random, number) if shape is None else _star(random, number, *shape)
    angle = random.uniform(0, 2 * np.pi)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    place = centre + random.uniform(-0.5, 0.5, 2)
    return Polygon(np.rint((size / 2 * xy @ rotation.T + place) * SUBPIXEL) / SUBPIXEL)


def _star(
    random: np.random.Generator, number: int, least: float, squeeze: float
) -> NDArray[np.float64]:
    turn = 2 * np.pi * (np.arange(number) + random.uniform(-0.3, 0.3, number)) / number
    radius = random.uniform(least, 1.0, number)
    return np.column_stack([radius * np.cos(turn), squeeze * radius * np.sin(turn)])


def _stroke(random: np.random.Generator, number: int) -> NDArray[np.float64]:
    """Return a bow of some width, as letters and roads are made of, in the unit circle."""
    along = np.linspace(0.0, random.uniform(0.5, 5.0), number // 2)
    outer = np.column_stack([np.cos(along), np.sin(along)])
    xy = np.vstack([outer, outer[::-1] * random.uniform(0.3, 0.8)])
    xy -= (xy.min(axis=0) + xy.max(axis=0)) / 2
    return xy / np.hypot(*xy.T).max()


def terms(predicted: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the row of `TERMS` for one draw from its predictions (see `criteria.predict`)."""
    return np.array([1.0, *(predicted[name] for name in TERMS[1:])])


def fit(
    design: DesignMatrix,
    seconds: NDArray[np.float64],
    groups: Sequence[int],
    seed: int = 0,
    resamples: int = 200,
    terms: Sequence[str] = TERMS[1:],
) -> Fit:
    """Fit non-negative coefficients to (k, 9) rows of `TERMS` and (k,) times.

    groups : (k,) which draws have the same polygons, with different triangulations
    terms : those of `TERMS` that the model has besides the draw itself; the others get 0

    Errors are relative, so that short draws count as much as long ones. The intervals are a
    bootstrap over groups.
    """
    labels = np.unique(groups, return_inverse=True)[1]
    columns = columns_of(terms)
    coefficients = np.zeros(len(TERMS))
    coefficients[columns] = solve(design[:, columns], seconds, labels)
    random = np.random.default_rng(seed)
    members = [np.flatnonzero(labels == label) for label in np.unique(labels)]
    samples = []
    for _ in range(resamples):
        drawn = [members[label] for label in random.integers(0, len(members), len(members))]
        rows = np.concatenate(drawn)
        own = np.repeat(np.arange(len(drawn)), [len(part) for part in drawn])
        samples.append(np.zeros(len(TERMS)))
        samples[-1][columns] = solve(design[rows][:, columns], seconds[rows], own)
    low, high = np.percentile(np.array(samples), [2.5, 97.5], axis=0)
    fitted = design @ coefficients
    quartiles = np.percentile((seconds - fitted) / seconds, [25, 50, 75])
    return Fit(
        coefficients=dict(zip(TERMS, coefficients.tolist(), strict=True)),
        intervals={name: (float(a), float(b)) for name, a, b in zip(TERMS, low, high, strict=True)},
        r2=r_squared(np.log(seconds), np.log(fitted)),
        relative_residuals=(float(quartiles[0]), float(quartiles[1]), float(quartiles[2])),
        valid={
            name: (float(column.min()), float(column.max()))
            for name, column in zip(TERMS, design.T, strict=True)
        },
        draws=len(seconds),
    )


def columns_of(terms: Sequence[str]) -> list[int]:
    """Return the columns of a design that a model with these terms has."""
    return [0, *(TERMS.index(name) for name in terms)]


def solve(
    design: DesignMatrix,
    seconds: NDArray[np.float64],
    groups: Sequence[int] | NDArray[np.int64],
    *,
    signed: bool = False,
) -> NDArray[np.float64]:
    """Return the coefficients of (k, terms) columns: non-negative, with a soft L1 loss.

    groups : (k,) see `fit`
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
    weight = BETWEEN * np.sqrt(np.bincount(labels))
    least: Any = np.linalg.lstsq if signed else nnls
    fitted = seconds
    trust = np.ones(len(seconds) + len(weight))
    found = np.zeros(design.shape[1])
    for _ in range(MOST_TURNS):
        shares = np.column_stack([design, seconds]) / fitted[:, None]
        mean = np.stack([_means(column, labels) for column in shares.T], axis=1)
        rows = np.concatenate([shares - mean[labels], weight[:, None] * mean])
        if found.any():
            errors = rows[:, :-1] @ found - rows[:, -1]
            trust = (1.0 + (errors / LARGE_ERROR) ** 2) ** -0.25
        scale = np.maximum(np.abs(rows[:, :-1]).max(axis=0), 1e-300)
        found = least(rows[:, :-1] / scale * trust[:, None], rows[:, -1] * trust)[0] / scale
        before = fitted
        # A draw that the fit misses by far keeps a weight of its own size.
        fitted = np.clip(design @ found, seconds / FAR_OFF, seconds * FAR_OFF)
        if np.abs(fitted / before - 1.0).max() <= CLOSE:
            break
    return np.asarray(found)


def _means(values: NDArray[np.float64], labels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean of the (k,) values of each label."""
    return np.asarray(np.bincount(labels, values) / np.bincount(labels))


def predict(fitted: Mapping[str, float], design: DesignMatrix) -> NDArray[np.float64]:
    """Return the (k,) seconds that coefficients predict for (k, 9) rows of `TERMS`."""
    return design @ np.array([fitted[name] for name in TERMS])


def r_squared(measured: NDArray[np.float64], predicted: NDArray[np.float64]) -> float:
    """Return the share of the measured variance that the prediction explains."""
    left = float(((measured - predicted) ** 2).sum())
    return 1.0 - left / float(((measured - measured.mean()) ** 2).sum())


def r_squared_within(
    measured: NDArray[np.float64], predicted: NDArray[np.float64], polygons: Sequence[Any]
) -> float:
    """Return R2 after each polygon's own mean (of logs) is subtracted from both."""
    labels = np.unique(np.asarray(polygons, dtype=str), return_inverse=True)[1]
    logs = [np.log(measured), np.log(predicted)]
    centred = [x - _means(x, labels)[labels] for x in logs]
    return 1.0 - float(((centred[0] - centred[1]) ** 2).sum()) / float((centred[0] ** 2).sum())
