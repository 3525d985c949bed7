"""Fits what a device's time is made of, on draws designed to tell the parts apart.

    time = c0 + cT*T + cS*S + cH*H + cB*sum(w*h) + cD*D + cQ*Q + cP*P + cR*R

with T triangles, S their area, H the half-perimeters, w*h the areas of their bounding boxes, D the
angles' deviation from 60 degrees, Q and P the expected quads and 4x4 blocks, which unlike H are
small for slivers that cover nothing, and R the expected number of triangles whose bounding box
holds a pixel centre: others are dropped early. D stands for what a processor fails to foresee:
which corner of a triangle is its lowest, or its leftmost, changes least from one to the next where
the triangles are well shaped, and where they are smaller than a pixel this is what is left.
The fit is non-negative, because no part can make a draw faster, and robust, because a draw that
something else disturbed must not bend it. It stays a sum over triangles, so `optimal:calibrated`
minimises it exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
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
"""Share of the viewport from which on a designed polygon is drawn alone."""

CROWD = (1000, 4000)
"""Least and most triangles of a draw of small polygons."""

SHAPES = ((0.35, 1.0), (0.35, 0.05), (0.97, 1.0), None)
"""Least radius of a star, as a share of its greatest, and how far it is squeezed; None is a stroke.
The squeezed and the nearly round are cut into slivers, which tell what is covered from what is only
bounded; strokes are what letters and roads are made of."""

CUTS = (
    "delaunay",
    "optimal:half-perimeter",
    "optimal:shape",
    "optimal:overdraw",
    "optimal:edge-length",
)
"""How designed polygons are cut: well, each in a way of its own, as the model is to choose among
what is good. The slivers of the worst cost less than H says; a fit to them would miss the rest."""

BETWEEN = 0.3
"""Weight of what sets of polygons differ in beside what triangulations of one differ in."""

Design = NDArray[np.float64]


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

    Stars of random radii and strokes, turned, of all `VERTICES`, `EXTENTS` and `SHAPES`.
    One alone where it is large. Of small ones as many as `CROWD` triangles take or as fit side by
    side, all different: so a draw's own cost can be told from theirs, and a processor cannot learn
    them by heart, which it does with a few hundred triangles drawn over and over.
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
                    room = resolution - size - 4
                    places = resolution / 2 + random.uniform(-0.5, 0.5, (1, 2)) * room
                found.append([_polygon(random, shape, number, size, place) for place in places])
    # Rounding to the grid makes edges of the thinnest cross.
    valid = [[polygon for polygon in polygons if polygon.is_valid] for polygons in found]
    return [polygons for polygons in valid if polygons]


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
    design: Design,
    seconds: NDArray[np.float64],
    groups: Sequence[int],
    seed: int = 0,
    resamples: int = 200,
) -> Fit:
    """Fit non-negative coefficients to (k, 9) rows of `TERMS` and (k,) times.

    groups : (k,) which draws have the same polygons, cut in several ways

    Errors are relative, so that short draws count as much as long ones. The intervals come from
    drawing groups anew.
    """
    labels = np.unique(groups, return_inverse=True)[1]
    coefficients = _solve(design, seconds, labels)
    random = np.random.default_rng(seed)
    members = [np.flatnonzero(labels == label) for label in range(labels.max() + 1)]
    samples = []
    for _ in range(resamples):
        drawn = [members[label] for label in random.integers(0, len(members), len(members))]
        rows = np.concatenate(drawn)
        own = np.repeat(np.arange(len(drawn)), [len(part) for part in drawn])
        samples.append(_solve(design[rows], seconds[rows], own))
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


def _solve(
    design: Design, seconds: NDArray[np.float64], labels: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Non-negative least squares of relative errors with a soft L1 loss.

    What the draws of one set of polygons have in common, some misfit for its size or kind, varies
    more than what tells them apart, and choosing a triangulation needs the latter: the former's
    weight is `BETWEEN`, as in a model with a random effect for each set.
    """
    weighted = design / seconds[:, None]
    scale = np.abs(weighted).max(axis=0)
    scaled = weighted / scale
    mean = np.stack([_means(column, labels) for column in scaled.T], axis=1)
    apart = scaled - mean[labels]
    weight = BETWEEN * np.sqrt(np.bincount(labels))

    def relative_errors(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([apart @ coefficients, weight * (mean @ coefficients - 1.0)])

    result = least_squares(
        relative_errors,
        np.full(design.shape[1], 0.1),
        bounds=(0.0, np.inf),
        loss="soft_l1",
        f_scale=0.05,
    )
    return np.asarray(result.x / scale)


def _means(values: NDArray[np.float64], labels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean of the (k,) values of each label."""
    return np.asarray(np.bincount(labels, values) / np.bincount(labels))


def predict(fitted: Mapping[str, float], design: Design) -> NDArray[np.float64]:
    """Return the (k,) seconds that coefficients predict for (k, 9) rows of `TERMS`."""
    return design @ np.array([fitted[name] for name in TERMS])


def r_squared(measured: NDArray[np.float64], predicted: NDArray[np.float64]) -> float:
    """Return the share of the measured variance that the prediction explains."""
    left = float(((measured - predicted) ** 2).sum())
    return 1.0 - left / float(((measured - measured.mean()) ** 2).sum())


def r_squared_within(
    measured: NDArray[np.float64], predicted: NDArray[np.float64], polygons: Sequence[Any]
) -> float:
    """Return R2 of what is left when each polygon's own mean (of logs) is taken from both."""
    labels = np.unique(np.asarray(polygons, dtype=str), return_inverse=True)[1]
    logs = [np.log(measured), np.log(predicted)]
    centred = [x - _means(x, labels)[labels] for x in logs]
    return 1.0 - float(((centred[0] - centred[1]) ** 2).sum()) / float((centred[0] ** 2).sum())
