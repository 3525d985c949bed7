"""Predicted times of a scene's draws on a device: the slowest stage, savings, and a remedy.

`minimise_slowest_stage` is `optimal:calibrated` for a device of several stages. A draw takes as
long as its slowest stage, which depends on the scene and its size, so a polygon alone does not
determine what to minimise. First the slowest stage of ear clipping's triangles is minimised. If
another stage is the slowest for the result, that one is minimised as well, and so on; the result
with the lowest predicted time is used. No triangulation shortens the stage of vertices: where it is
the slowest, the triangles are put into the order of a walk, and the slowest of the other stages is
minimised.

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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.frame import Frame
from harness.metrics.decision import MIN_SAVED_SHARE, choose_recommended, describe_recommended
from harness.profile.cost_terms import COARSE_SCAN_PX, TERMS, count_cost_terms, make_design_rows
from harness.profile.law import FORMS, VERTICES, Law, compute_stage_times
from harness.profile.profile import describe_origin, is_of_this_machine, read_law, read_profile
from harness.rasterisers.base import Options, order_submission
from harness.rasterisers.vertex_batches import sum_batches_of_draws
from harness.triangulating.recipes import Recipe
from harness.triangulating.triangulate import FrameTriangulation
from triangulators.errors import suggest
from triangulators.geometry.order import put_in_walk_order

# Contributed profiles; an installed wheel has none.
CONTRIBUTED = Path(__file__).parents[2] / "results" / "reference" / "profiles"

# Remedies by stage; the stage of vertices depends on the order of triangles.
REMEDIES = {
    "triangles": "fewer covering triangles",
    "pixels": "fewer quads",
    "triangles and pixels": "fewer covering triangles and quads",
    "arithmetic": "fewer quads",
}

WALK = Options(order="walk")

Cost = dict[str, Any]  # Cost of one triangulator's triangles, from `predict_draw_costs`.


@dataclass(frozen=True)
class DeviceCosts:
    """A device's costs, fitted to measured draw times, from a profile.

    costs : seconds for each of `cost_terms.TERMS`, (t,)
    law : the fitted costs with their covariance, or None if the profile stores no times
    origin : the device and processor on which the profile was measured
    is_here : True if this machine has the device and processor
    """

    name: str
    costs: NDArray[np.float64]
    form: str = "sum"
    law: Law | None = None
    origin: str = ""
    is_here: bool = True

    @property
    def stages(self) -> list[str]:
        """Names of the device's stages."""
        return list(FORMS[self.form])


def find_profile(name: str, *folders: Path) -> Path:
    """Return the file of a profile, from a path or a name in `folders` or `CONTRIBUTED`."""
    profiles = {
        file.stem: file
        for folder in (CONTRIBUTED, *folders)
        for file in sorted(folder.glob("*.json"))
        if not file.stem.endswith(".refused")
    }
    if name not in profiles and not Path(name).exists():
        hint = suggest(
            name, sorted(profiles), cutoff=0.4, fallback="raster-harness profile makes one"
        )
        raise UsageError(f"--profile {name}: neither a file nor a known name; {hint}")
    return profiles.get(name, Path(name))


def read_costs(file: Path) -> DeviceCosts:
    """Return the costs of a profile; raise as `read_profile` does."""
    return read_profile(file, _make_costs)


def _make_costs(profile: Any) -> DeviceCosts:
    costs = {term["name"]: float(term["cost"]) for term in profile["terms"]}
    device, law = profile["device"], read_law(profile)
    seconds = np.array([costs[term] for term in TERMS])
    origin = describe_origin(device), is_of_this_machine(device)
    return DeviceCosts(str(device["name"]), seconds, profile["form"], law, *origin)


def count_native_and_walk(frame: Frame, triangles: NDArray[np.int32]) -> dict[str, int]:
    """Return `count_cost_terms`, and vertex counters in walk order, whose names end in _walk."""
    walked = sum_batches_of_draws(frame, order_submission(frame, triangles, WALK))
    counts = count_cost_terms(frame, triangles)
    return counts | {f"{name}_walk": value for name, value in walked.items()}


def predict_draw_costs(counters: Sequence[Mapping[str, int]], device: DeviceCosts) -> list[Cost]:
    """Return each triangulator's predicted cost, the base first, from `count_native_and_walk`.

    A cost has the seconds of a `draw`, and of a `draw_walk` in walk order; the slowest `stage`; and
    `saved_95`, the 95 % interval of the saved share of the base's draw time, or None.
    """
    design = make_design_rows(counters)
    walked = make_design_rows(
        [{**counts, **{n: counts[f"{n}_walk"] for n in VERTICES}} for counts in counters]
    )
    times = compute_stage_times(design, device.costs, device.form)
    walk_times = compute_stage_times(walked, device.costs, device.form)
    has_interval = device.law is not None and times[0].max() > 0
    return [
        {
            "draw": float(draw.max()),
            "draw_walk": float(walk.max()),
            "stage": device.stages[int(draw.argmax())],
            "saved_95": device.law.compute_saved_interval(row, design[0], device.costs)
            if has_interval and device.law is not None
            else None,
        }
        for row, draw, walk in zip(design, times, walk_times, strict=True)
    ]


def compute_saved_shares(spent: Mapping[str, float]) -> dict[str, float]:
    """Return the share of the base's cost that each triangulator saves; the base is first."""
    base = next(iter(spent.values()))
    return {name: 1.0 - cost / base if base else 0.0 for name, cost in spent.items()}


def format_saving(saved: float, interval: tuple[float, float] | None) -> str:
    """Format a saved share, with the interval if known."""
    text = f"{saved:.1%}"
    return f"{text} (95 % CI {100 * interval[0]:.1f} to {interval[1]:.1%})" if interval else text


def describe_stage(condition: str, costs: Mapping[str, Cost], device: DeviceCosts) -> str:
    """Return a sentence: the base's slowest stage, if a device has several, and what saves time.

    condition : such as "256 px"; costs : by triangulator, the base first
    """
    base, cost = next(iter(costs.items()))
    text = f"At {condition} "
    if len(device.stages) > 1:
        text += f"{base} is bound by {cost['stage']}: "
        if cost["stage"] not in REMEDIES:
            walk = 1.0 - cost["draw_walk"] / cost["draw"]
            remedy = f"use --order walk, which saves {walk:.1%}" if walk > 0 else "keep its order"
            return f"{text}the order of triangles decides; {remedy}."
        text += f"{REMEDIES[cost['stage']]}; "
    saved = compute_saved_shares({name: cost["draw"] for name, cost in costs.items()})
    if max(saved.values()) < MIN_SAVED_SHARE:
        return f"{text}keep {base}."
    best = choose_recommended(saved, {name: c.get("triangulate_s") for name, c in costs.items()})
    saving = format_saving(saved[best], costs[best].get("saved_95"))
    return f"{text}use {describe_recommended(best)}: {saving}."


BASE = Recipe("ear-clipping")

COVERING = {"area": 1 / 3, "expected_blocks": 8 / 3, "expected_quads": -2.0}

# Expected counter of a triangle, by cost term (`TERMS`): coefficients of triangle features.
EXPECTED: Mapping[str, Mapping[str, float]] = {
    "triangles": {"triangles": 1.0},
    "fragments": {"area": 1.0},
    "helper_lanes": {"expected_quads": 4.0, "area": -1.0},
    "blocks": {"expected_blocks": 1.0},
    "covering": COVERING,
    "tile_pairs": COVERING | {"half_perimeter": 1 / COARSE_SCAN_PX},
}


def compute_stage_weights(device: DeviceCosts, stage: str) -> dict[str, float]:
    """Return the expected seconds of a triangle in a stage, as coefficients of features.

    {} for a stage without costs that a triangulation changes, such as that of vertices.
    """
    weights: dict[str, float] = {}
    for term, cost in zip(TERMS, device.costs.tolist(), strict=True):
        if cost and term in FORMS[device.form][stage]:
            for feature, factor in EXPECTED.get(term, {}).items():
                weights[feature] = weights.get(feature, 0.0) + cost * factor
    return weights


def minimise_slowest_stage(
    device: DeviceCosts,
    frame: Frame,
    recipe: Recipe,
    triangulate: Callable[[Recipe], FrameTriangulation],
) -> tuple[Recipe, FrameTriangulation]:
    """Return the optimum of the stage that takes longest, with the recipe that computes it.

    recipe : `optimal:calibrated`; its calibration is replaced by the costs of a stage
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

    Triangles are put into the order of a walk if the stage of vertices is the slowest.
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
    design = make_design_rows([count_cost_terms(frame, frame.join_triangles(result.parts))])
    seconds = compute_stage_times(design, device.costs, device.form)[0]
    return dict(zip(device.stages, seconds.tolist(), strict=True))
