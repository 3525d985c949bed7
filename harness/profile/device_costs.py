"""Predicted times of a scene's draws on a device: the slowest stage, savings, and a remedy.

`inspect --sizes --profile` predicts from counted triangulations, the report from those stored with
a run; both use the same functions and sentences.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.frame import Frame
from harness.metrics.decision import MIN_SAVED_SHARE, choose_recommended, describe_recommended
from harness.profile.counted import TERMS, count_cost_terms, make_design_rows
from harness.profile.law import FORMS, VERTICES, Law, compute_stage_times
from harness.profile.profile import describe_origin, is_of_this_machine, read_law, read_profile
from harness.rasterisers.base import Options, order_submission
from harness.rasterisers.vertex_batches import sum_batches_of_draws
from triangulators.errors import suggest

CONTRIBUTED = Path(__file__).parents[2] / "results" / "reference" / "profiles"
"""Contributed profiles; an installed wheel has none."""

REMEDIES = {
    "triangles": "fewer covering triangles",
    "pixels": "fewer quads",
    "triangles and pixels": "fewer covering triangles and quads",
    "arithmetic": "fewer quads",
}
"""Remedies by stage, for stages that depend on the triangulation; the stage of vertices depends on
the order of triangles."""

WALK = Options(order="walk")

Cost = dict[str, Any]
"""Cost of one triangulator's triangles. `predict_draw_costs` returns `draw`, the predicted seconds
of a draw; `draw_walk`, the draw time with the triangles in walk order (from neighbour to
neighbour); `stage`, which of the device's stages is slowest; and `saved_95`, the 95 % interval of
the saved share of the base's draw time, or None."""


@dataclass(frozen=True)
class DeviceCosts:
    """A device's costs, fitted to measured draw times, from a profile.

    costs : seconds for each of `counted.TERMS`, (t,)
    form : one of `law.FORMS`
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
    """Return the file of a profile, given as a path, or by its name in `folders` or `CONTRIBUTED`.

    Raises UsageError if there is no such file.
    """
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
    """Return the costs in the content of a profile's file."""
    costs = {term["name"]: float(term["cost"]) for term in profile["terms"]}
    device, law = profile["device"], read_law(profile)
    seconds = np.array([costs[term] for term in TERMS])
    origin = describe_origin(device), is_of_this_machine(device)
    return DeviceCosts(str(device["name"]), seconds, profile["form"], law, *origin)


def count_native_and_walk(frame: Frame, triangles: NDArray[np.int32]) -> dict[str, int]:
    """Return `count_cost_terms` of triangles (m, 3), and vertex counters in walk order.

    Names in walk order, in which triangles go from neighbour to neighbour, end in _walk.
    """
    walked = sum_batches_of_draws(frame, order_submission(frame, triangles, WALK))
    counts = count_cost_terms(frame, triangles)
    return counts | {f"{name}_walk": value for name, value in walked.items()}


def predict_draw_costs(counters: Sequence[Mapping[str, int]], device: DeviceCosts) -> list[Cost]:
    """Return the predicted draw times and slowest stage of each triangulator, the base first.

    counters : of each triangulator's triangles, from `count_native_and_walk`
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
    """Return the share of the base's cost that each triangulator saves.

    spent : cost by triangulator, the base first
    """
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
