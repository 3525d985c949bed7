"""`optimal:calibrated` for a device of several stages: the optimum of the stage that binds.

A draw takes as long as its slowest stage, which depends on the scene and its size, so a polygon
alone does not determine what to minimise. First the slowest stage of ear clipping's triangles is
minimised. If another stage is the slowest for the result, that one is minimised as well, and so on;
the result with the lowest predicted time is used. No triangulation shortens the stage of vertices:
where it is the slowest, the triangles are put into the order of a walk, and the slowest of the
other stages is minimised.

The cost of a stage is a sum of counters; its expectation over all positions on the pixel grid is a
sum of features of each triangle. With S the area, H the half-perimeter, Q and P the expected quads
and 4x4 blocks (`triangulators.criteria.features`):

    triangles        1
    fragments        S
    helper lanes     4 Q - S
    4x4 blocks       P
    covering         X = (S + 8 P - 6 Q) / 3
    tile pairs       X + H / 16

X is the expected number of 8-connected groups of covered pixel centres: `_expected` of the features
has a sum of pairs and a sum of unit squares with Q = S (4 - 2 pairs + squares) / 4 and P = S (16 -
12 pairs + 9 squares) / 16, and by Euler's formula X = S (1 - pairs + squares). A triangle has one
group, unless it is a sliver with gaps. A convex shape overlaps 1 + H / b + S / b^2 tiles of side b
on average; the last is constant, as the areas sum to that of the polygon.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.profile.counted import COARSE_SCAN_PX, TERMS, count_cost_terms, make_design_rows
from harness.profile.device_costs import DeviceCosts
from harness.profile.law import FORMS, VERTICES, compute_stage_times
from harness.triangulating.recipes import Recipe
from harness.triangulating.result import FrameTriangulation
from triangulators.geometry.order import put_in_walk_order

BASE = Recipe("ear-clipping")

COVERING = {"area": 1 / 3, "expected_blocks": 8 / 3, "expected_quads": -2.0}

EXPECTED: Mapping[str, Mapping[str, float]] = {
    "triangles": {"triangles": 1.0},
    "fragments": {"area": 1.0},
    "helper_lanes": {"expected_quads": 4.0, "area": -1.0},
    "blocks": {"expected_blocks": 1.0},
    "covering": COVERING,
    "tile_pairs": COVERING | {"half_perimeter": 1 / COARSE_SCAN_PX},
}
"""Expected counter of a triangle, by cost term (`TERMS`): coefficients of triangle features."""

Triangulate = Callable[[Recipe], FrameTriangulation]


def compute_stage_weights(device: DeviceCosts, stage: str) -> dict[str, float]:
    """Return the expected seconds of a triangle in a stage, as coefficients of features.

    {} for the stage of vertices, and for a stage without costs that a triangulation changes.
    """
    weights: dict[str, float] = {}
    for term, cost in zip(TERMS, device.costs.tolist(), strict=True):
        if cost and term in FORMS[device.form][stage]:
            for feature, factor in EXPECTED.get(term, {}).items():
                weights[feature] = weights.get(feature, 0.0) + cost * factor
    return weights


def minimise_slowest_stage(
    device: DeviceCosts, frame: Frame, recipe: Recipe, triangulate: Triangulate
) -> tuple[Recipe, FrameTriangulation]:
    """Return the optimum of the stage that takes longest, with the recipe that computes it.

    recipe : `optimal:calibrated`; its calibration is replaced by the costs of a stage
    triangulate : returns the triangulation of the frame by a recipe
    """
    weights = {stage: compute_stage_weights(device, stage) for stage in device.stages}
    shapes = [stage for stage in device.stages if weights[stage]]
    if not shapes:
        return recipe, triangulate(recipe)
    _, times = order_for_slowest_stage(device, frame, triangulate(BASE))
    best: tuple[float, Recipe, FrameTriangulation, str] | None = None
    tried: set[str] = set()
    while True:
        stage = max(shapes, key=lambda name: times[name])
        if best is not None and stage in tried:
            break
        tried.add(stage)
        candidate = replace(recipe, calibration=tuple(sorted(weights[stage].items())))
        result, times = order_for_slowest_stage(device, frame, triangulate(candidate))
        slowest = max(times, key=lambda name: times[name])
        if best is None or times[slowest] < best[0]:
            best = times[slowest], candidate, result, slowest
    _, candidate, result, slowest = best
    if slowest not in shapes:
        result.notes.append(
            f"{recipe} at {frame.view.resolution} px: the slowest stage on {device.name} is "
            f"{slowest}, which no triangulation shortens; the triangles are in the order of a walk"
        )
    return candidate, result


def order_for_slowest_stage(
    device: DeviceCosts, frame: Frame, result: FrameTriangulation
) -> tuple[FrameTriangulation, dict[str, float]]:
    """Return a triangulation in the order for its slowest stage, with the seconds of each stage.

    If the stage of vertices is the slowest, triangles are sorted from neighbour to neighbour (a
    walk); otherwise the order is unchanged.
    """
    times = _predict_stage_times(device, frame, result)
    slowest = max(times, key=lambda name: times[name])
    if FORMS[device.form][slowest] != VERTICES:
        return result, times
    parts: list[NDArray[np.int32] | None] = [
        None if part is None else put_in_walk_order(part, int(part.max()) + 1)
        for part in result.parts
    ]
    walked = replace(result, parts=parts)
    return walked, _predict_stage_times(device, frame, walked)


def _predict_stage_times(
    device: DeviceCosts, frame: Frame, result: FrameTriangulation
) -> dict[str, float]:
    """Return the predicted seconds of a triangulation in each stage of the device, by name."""
    design = make_design_rows([count_cost_terms(frame, frame.join_triangles(result.parts))])
    seconds = compute_stage_times(design, device.costs, device.form)[0]
    return dict(zip(device.stages, seconds.tolist(), strict=True))
