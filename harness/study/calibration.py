"""Fits what a device's time is made of, on draws designed to tell the parts apart.

    time = c0 + cT*T + cS*S + cH*H + cB*sum(w*h) + cQ*Q + cP*P + cR*R

with T triangles, S their area, H the half-perimeters, w*h the areas of their bounding boxes, Q and
P the expected quads and 4x4 blocks, which unlike H are small for slivers that cover nothing, and R
the expected number of triangles whose bounding box holds a pixel centre: others are dropped early.
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
"""Columns of a design: one for the draw itself, then T, S, H, the sum of w*h, Q, P and R."""

UNITS = ("s", "s", "s/px^2", "s/px", "s/px^2", "s", "s", "s")

VERTICES = (6, 12, 24, 48, 96)
EXTENTS = (0.01, 0.03, 0.06, 0.12, 0.25, 0.5, 0.95)
"""Sizes of the designed polygons as shares of the viewport."""

SHAPES = ((0.35, 1.0), (0.35, 0.05), (0.97, 1.0))
"""Least radius of a star, as a share of its greatest, and how far it is squeezed. The squeezed and
the nearly round are cut into slivers, which tell what is covered from what is only bounded."""

CUTS = ("delaunay", "optimal:half-perimeter", "worst:half-perimeter", "random#0", "random#1")

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


def designed_polygons(resolution: int, seed: int = 0) -> list[tuple[Polygon, int]]:
    """Return (polygon in a viewport of `resolution` px, copies) that vary T, S, H and w*h.

    Stars of random radii, turned, of all numbers of vertices in `VERTICES`, `EXTENTS` and `SHAPES`.
    Small ones are drawn in many copies, so that a draw's own cost
    can be told from that of its triangles.
    """
    random = np.random.default_rng(seed)
    found = []
    for number in VERTICES:
        for extent in EXTENTS:
            for least, squeeze in SHAPES:
                copies = 8 if extent < 0.2 and random.random() < 0.5 else 1
                copies = 32 if extent < 0.02 else copies
                star = _star(random, resolution, number, extent, least, squeeze)
                found.append((star, copies))
    return found


def _star(
    random: np.random.Generator,
    resolution: int,
    number: int,
    share: float,
    least: float,
    squeeze: float,
) -> Polygon:
    extent = share * resolution
    turn = 2 * np.pi * (np.arange(number) + random.uniform(-0.3, 0.3, number)) / number
    radius = random.uniform(least, 1.0, number) * extent / 2
    xy = np.column_stack([radius * np.cos(turn), squeeze * radius * np.sin(turn)])
    angle = random.uniform(0, np.pi)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    centre = resolution / 2 + random.uniform(-0.5, 0.5, 2) * (resolution - extent - 4)
    return Polygon(np.rint((xy @ rotation.T + centre) * SUBPIXEL) / SUBPIXEL)


def terms(predicted: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the row of `TERMS` for one draw from its predictions (see `criteria.predict`)."""
    return np.array([1.0, *(predicted[name] for name in TERMS[1:])])


def fit(design: Design, seconds: NDArray[np.float64], seed: int = 0, resamples: int = 200) -> Fit:
    """Fit non-negative coefficients to (k, 8) rows of `TERMS` and (k,) times.

    Errors are relative, so that short draws count as much as long ones.
    """
    coefficients = _solve(design, seconds)
    random = np.random.default_rng(seed)
    draws = [random.integers(0, len(seconds), len(seconds)) for _ in range(resamples)]
    samples = np.array([_solve(design[rows], seconds[rows]) for rows in draws])
    low, high = np.percentile(samples, [2.5, 97.5], axis=0)
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


def _solve(design: Design, seconds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Non-negative least squares of relative errors with a soft L1 loss."""
    weighted = design / seconds[:, None]
    scale = np.abs(weighted).max(axis=0)
    scaled = weighted / scale

    def relative_errors(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(scaled @ coefficients - 1.0)

    result = least_squares(
        relative_errors,
        np.full(design.shape[1], 0.1),
        bounds=(0.0, np.inf),
        loss="soft_l1",
        f_scale=0.05,
    )
    return np.asarray(result.x / scale)


def predict(fitted: Mapping[str, float], design: Design) -> NDArray[np.float64]:
    """Return the (k,) seconds that coefficients predict for (k, 8) rows of `TERMS`."""
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
    size = np.bincount(labels)
    logs = [np.log(measured), np.log(predicted)]
    centred = [x - (np.bincount(labels, x) / size)[labels] for x in logs]
    return 1.0 - float(((centred[0] - centred[1]) ** 2).sum()) / float((centred[0] ** 2).sum())
