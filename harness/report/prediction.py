"""Predicted draw times of a run's triangulations on a device: the slowest stage, and a remedy."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypedDict

import numpy as np

from harness.errors import InputError
from harness.frame import FIXED_VIEWS, View, make_grid_frame
from harness.metrics.decision import Decided
from harness.profile.device_costs import (
    DeviceCosts,
    compute_saved_shares,
    count_native_and_walk,
    describe_stage,
    format_saving,
    predict_draw_costs,
    read_costs,
)
from harness.results import drawings
from harness.results.drawings import Geometry
from harness.results.run_folder import STORED_PROFILE, Run


class PredictedRow(TypedDict):
    """Predicted cost of a triangulator.

    draw_ms, walk_ms : draw time with the triangles in native order, and in the order of a walk
    saved : saved share of the base's time, with the interval, as text; "" for the base
    stage : the device's stage that takes longest
    """

    name: str
    draw_ms: float
    walk_ms: float
    saved: str
    stage: str


class PredictedView(TypedDict):
    """Predicted costs in one view, the triangulator with the shortest draw first."""

    view: str
    advice: str
    base: str
    rows: list[PredictedRow]


class Prediction(TypedDict):
    """Predicted costs of a run on a device.

    device : the device on which the profile was measured, with the processor if it is software
    has_stages : True if the device's cost model (law) has several stages
    skipped : why views are missing, or ""
    """

    device: str
    has_stages: bool
    views: list[PredictedView]
    skipped: str


def predict_run(run: Run, decided: Sequence[Decided], device: DeviceCosts) -> Prediction:
    """Return the predicted costs of a run's stored triangulations, JSON-ready."""
    views: dict[View, PredictedView | None] = {}
    for group, decision in decided:
        view = group.id.view
        if views.get(view) is None and decision is not None and view.fit not in FIXED_VIEWS:
            seconds = {record.name: record.triangulate_s for record in group.measured}
            if (geometry := drawings.read(run, view)) is not None:
                base = decision.base.name
                views[view] = _predict_view(geometry, view, base, seconds, device)
        views.setdefault(view, None)
    predicted = [content for content in views.values() if content]
    missing = len(views) - len(predicted)
    return {
        "device": device.origin,
        "has_stages": len(device.stages) > 1,
        "views": predicted,
        "skipped": f"Not predicted: {missing} of {len(views)} views, whose triangulations are not "
        "stored, or which are map tiles or views of a model."
        if missing
        else "",
    }


def _predict_view(
    geometry: Geometry,
    view: View,
    base: str,
    seconds: Mapping[str, float | None],
    device: DeviceCosts,
) -> PredictedView | None:
    """Return predicted costs of the triangulators that drew the same polygons as the base."""
    frame = replace(make_grid_frame(view.resolution, geometry.grid), view=view)
    drawn = {name: np.unique(frame.find_owners(rows)) for name, rows in geometry.triangles.items()}
    if base not in drawn:
        return None
    names = [base, *(n for n in seconds if n != base and n in drawn)]
    names = [name for name in names if np.array_equal(drawn[name], drawn[base])]
    draws = predict_draw_costs(
        [count_native_and_walk(frame, geometry.triangles[n]) for n in names], device
    )
    costs: dict[str, dict[str, Any]] = {
        name: draw | {"triangulate_s": seconds.get(name)}
        for name, draw in zip(names, draws, strict=True)
    }
    saved = compute_saved_shares({name: cost["draw"] for name, cost in costs.items()})
    rotation = f", turned {view.rotation:g}°" if view.rotation else ""
    rows: list[PredictedRow] = [
        {
            "name": name,
            "draw_ms": 1e3 * cost["draw"],
            "walk_ms": 1e3 * cost["draw_walk"],
            "saved": "" if name == base else format_saving(saved[name], cost["saved_95"]),
            "stage": cost["stage"],
        }
        for name, cost in sorted(costs.items(), key=lambda pair: float(pair[1]["draw"]))
    ]
    condition = f"{view.resolution} px{rotation}"
    advice = describe_stage(condition, costs, device)
    return {"view": condition, "advice": advice, "base": base, "rows": rows}


def make_prediction(
    run: Run, decided: Sequence[Decided], device: DeviceCosts | None
) -> tuple[Prediction | None, list[str]]:
    """Return the prediction for a device, and warnings; None without a usable profile.

    device : costs given with the command; if None, those of the profile stored in the run, if any
    """
    stored = run.folder / STORED_PROFILE
    try:
        if device is None and stored.is_file():
            device = read_costs(stored)
    except InputError as error:
        return None, [f"no predicted draw times: {error}"]
    return (predict_run(run, decided, device) if device else None), []
