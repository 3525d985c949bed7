"""What each draw of the design costs, counted exactly from coordinates: the columns of a law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.frame import SUBPIXEL
from harness.profile.design import Draw
from harness.rasterisers import binning, reference


class Term(NamedTuple):
    """Something that a device may take time for.

    unit : of its cost
    sentence : what that cost is, with a place for it
    noun : what it is called in a table
    """

    unit: str
    sentence: str
    noun: str


TERMS = {
    "draw": Term("s", "A draw by itself costs {}.", "the draw itself"),
    "triangles": Term("s", "A triangle costs {}, however small it is.", "triangles"),
    "set_up": Term(
        "s",
        "One whose box holds a pixel centre costs {} more.",
        "triangles set up",
    ),
    "vertices": Term("s", "A vertex costs {}.", "vertices"),
    "fragments": Term("s", "A pixel that a triangle covers costs {}.", "covered pixels"),
    "helper_lanes": Term("s", "A helper lane costs {}.", "helper lanes"),
    "half_perimeter": Term(
        "s/px", "A pixel of width or height of its box costs {}.", "half-perimeter"
    ),
    "blocks": Term("s", "A block of 4x4 pixels that it touches costs {}.", "4x4 blocks"),
    "tiles_64": Term("s", "A tile of 64x64 pixels that it touches costs {}.", "64x64 tiles"),
    "bbox_tests": Term("s", "A pixel of its bounding box costs {}.", "pixels of bounding boxes"),
    "work": Term("s", "A round of arithmetic in a lane costs {}.", "rounds of arithmetic"),
}
"""What a law may be made of, by the counter; the half-perimeter is in px, all else is counted."""

Design = NDArray[np.float64]


def counters(draw: Draw) -> dict[str, int]:
    """Return the draw's exact counters; `half_perimeter` in 1/256 px.

    triangles, vertices : drawn, and different ones among their corners
    set_up : triangles whose bounding box holds a pixel centre; covering : that cover one
    fragments, quads, helper_lanes, blocks, bbox_tests : see `harness.rasterisers.reference.predict`
    tiles_64 : tiles of 64 px that the triangles overlap
    work : rounds of arithmetic in all lanes
    """
    points, triangles = draw.frame.points, draw.triangles
    each = reference.predict(points, triangles)
    sums = {name: int(values.sum()) for name, values in each.items()}
    return {
        "triangles": len(triangles),
        "vertices": len(np.unique(triangles)),
        "set_up": int((each["bbox_tests"] > 0).sum()),
        "covering": int((each["fragments"] > 0).sum()),
        **sums,
        "half_perimeter": int(np.ptp(points[triangles].astype(np.int64), axis=1).sum()),
        "tiles_64": int(binning.predict(points, triangles)["tiles_64_exact"].sum()),
        "work": 4 * sums["quads"] * draw.work,
    }


def design_of(counted: Sequence[Mapping[str, int]]) -> Design:
    """Return (k, 11) rows of `TERMS` of the draws' counters."""
    rows = [{**each, "draw": 1} for each in counted]
    found = np.array([[row[name] for name in TERMS] for row in rows], np.float64)
    found[:, list(TERMS).index("half_perimeter")] /= SUBPIXEL
    return found
