"""The linear model of a draw's time: cost terms, their exact counters, and the fit of costs.

A term's counter is computed from coordinates. Its cost is a non-negative coefficient, fitted by
relative errors, robustly, with errors that draws of the same polygons share.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.grid import SUBPIXEL
from harness.profile.placing import Draw
from harness.rasterisers import reference
from harness.rasterisers.vertex_batches import sum_batches_of_draws

# Size up to which a rasteriser may scan triangles differently, as llvmpipe does (`lp_setup_tri.c`).
COARSE_SCAN_PX = 16


class Term(NamedTuple):
    """A possible cost of a device: a sentence with {} for the time, and a name in tables."""

    sentence: str
    noun: str


# Possible costs of a draw, by the counter that each is proportional to.
TERMS = {
    "draw": Term("A draw by itself costs {}.", "the draw itself"),
    "triangles": Term("A triangle costs {}, however small it is.", "triangles"),
    "set_up": Term("A triangle whose box holds a pixel centre costs {} more.", "triangles set up"),
    "covering": Term(
        "A triangle that covers a pixel centre costs {} more.", "triangles that cover a pixel"
    ),
    "tile_pairs": Term(
        "Each tile of 16x16 pixels that a covering triangle overlaps costs {}.",
        "16x16 tiles of covering triangles",
    ),
    "transformed_vertices": Term("A transformed vertex costs {}.", "transformed vertices"),
    "vertex_batches": Term("A vertex batch costs {}.", "vertex batches"),
    "fragments": Term("A pixel that a triangle covers costs {}.", "covered pixels"),
    "helper_lanes": Term("A helper lane costs {}.", "helper lanes"),
    "half_perimeter": Term(
        "Each pixel of a triangle's width and height costs {}.", "half-perimeter"
    ),
    "near": Term(
        f"Each of the first {COARSE_SCAN_PX} pixels of a triangle's width and height costs {{}}.",
        f"half-perimeter up to {COARSE_SCAN_PX} px",
    ),
    "rows": Term("Each row of pixels that a triangle crosses costs {}.", "rows of pixels"),
    "blocks": Term(
        "Each block of 4x4 pixels in which a triangle covers a pixel costs {}.", "4x4 blocks"
    ),
    "coarse_blocks": Term(
        "A block of 4x4 costs {} more if the triangle is wider or higher than "
        f"{COARSE_SCAN_PX} pixels.",
        f"4x4 blocks of triangles over {COARSE_SCAN_PX} px",
    ),
    "further_tiles": Term(
        "Each tile of 64x64 pixels that a triangle overlaps, except the first, costs {}.",
        "further 64x64 tiles",
    ),
    "bbox_tests": Term("A pixel of a bounding box costs {}.", "pixels of bounding boxes"),
    "work": Term("A round of arithmetic in a lane costs {}.", "rounds of arithmetic"),
}

# Terms in px, whose counters are in 1/256 px; others are counts.
PX_TERMS = ("half_perimeter", "near")

Design = NDArray[np.float64]  # counters of k draws, (k, t), such as a column for each of `TERMS`
Seconds = NDArray[np.float64]  # times of k draws, (k,), or coefficients, (t,)
Labels = Sequence[Any] | NDArray[Any]  # the group of each draw, (k,)


def count_draw(draw: Draw) -> dict[str, int]:
    """Return the exact counters of a draw; see `count_cost_terms`."""
    return count_cost_terms(draw.frame, draw.triangles, draw.work)


def count_cost_terms(frame: Frame, triangles: NDArray[np.int32], work: int = 0) -> dict[str, int]:
    """Return exact counters of triangles (m, 3); `half_perimeter` and `near` in 1/256 px.

    set_up : triangles whose bounding box contains a pixel centre
    covering : triangles that cover a pixel centre
    fragments, quads, helper_lanes, blocks, bbox_tests : see `reference.count_per_triangle`
    near : width and height of each triangle, clamped to `COARSE_SCAN_PX` px
    coarse_blocks : 4x4 blocks of triangles whose box is wider or higher than `COARSE_SCAN_PX` px
    rows : rows of pixels whose centres lie between a triangle's lowest and highest corner
    further_tiles : tiles of 64 px that triangles overlap, except one per triangle
    tile_pairs : pairs of a covering triangle and a tile of 16 px that it overlaps, as on an H200
    """
    points = frame.points
    counts = reference.count_per_triangle(points, triangles)
    corners = points[triangles].astype(np.int64)
    sides = np.ptp(corners, axis=1)
    # Rows whose centre, half a pixel above the row's edge, satisfies `first <= centre <= last`.
    centre = SUBPIXEL // 2
    first = -((centre - corners[:, :, 1].min(axis=1)) // SUBPIXEL)  # rounded up
    last = (corners[:, :, 1].max(axis=1) - centre) // SUBPIXEL
    limit = COARSE_SCAN_PX * SUBPIXEL
    tiles = reference.count_tiles_per_triangle(points, triangles)
    covering = counts["fragments"] > 0
    sums = {name: int(values.sum()) for name, values in counts.items()}
    return {
        "triangles": len(triangles),
        "vertices": int((np.bincount(triangles.ravel()) > 0).sum()),
        "set_up": int((counts["bbox_tests"] > 0).sum()),
        "covering": int(covering.sum()),
        **sums,
        "half_perimeter": int(sides.sum()),
        "near": int(np.minimum(sides, limit).sum()),
        "rows": int(np.maximum(last - first + 1, 0).sum()),
        "coarse_blocks": int(counts["blocks"][(sides > limit).any(axis=1)].sum()),
        "further_tiles": int(np.maximum(tiles["tiles_64_exact"] - 1, 0).sum()),
        "tile_pairs": int(tiles["tiles_16_exact"][covering].sum()),
        **sum_batches_of_draws(frame, triangles),
        "work": 4 * sums["quads"] * work,
    }


def make_design_rows(counted: Sequence[Mapping[str, int]]) -> Design:
    """Return the values of `TERMS` for each draw, (k, t), given the counters of each draw."""
    rows = [{**counts, "draw": 1} for counts in counted]
    design = np.array([[row[name] for name in TERMS] for row in rows], np.float64)
    design[:, [list(TERMS).index(name) for name in PX_TERMS]] /= SUBPIXEL
    return design


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
