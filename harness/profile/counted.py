"""Exact counters of each draw of a profile, from coordinates: the terms of a device's cost."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

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

Design = NDArray[np.float64]  # counters of k draws, (k, t): a column for each of `TERMS`


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
