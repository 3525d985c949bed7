"""The report of a run as one self-contained HTML page."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness import __version__, atomic
from harness.errors import InputError
from harness.frame import FIXED_VIEWS, View, make_grid_frame
from harness.metrics.decision import Decided, decide_run
from harness.profile.device_costs import (
    DeviceCosts,
    compute_saved_shares,
    count_native_and_walk,
    describe_stage,
    format_saving,
    predict_draw_costs,
    read_costs,
)
from harness.report.content import make_content
from harness.results.run_folder import STORED_PROFILE, Geometry, Run, read_geometry
from harness.webpages import load_template, pack_json, read_static

PACKAGE = "harness.report"
# Scripts of reports and of measuring pages, which share `CHARTS` and `STYLE`.
ELEMENTS, SPANS = "elements.js", "spans.js"
FILE = "report.html"
STYLE = "report.css"

SCRIPTS = (
    ELEMENTS,
    "page.js",
    "csv.js",
    "chart.js",
    "ranking.js",
    SPANS,
    "raster.js",
    "heatmap.js",
    "matrix.js",
    "cases.js",
    "main.js",
)
CHARTS = "echarts.common.min.js"


def write_report(
    run: Run,
    file: Path | None = None,
    decided: Sequence[Decided] | None = None,
    device: DeviceCosts | None = None,
) -> Path:
    """Write the report of a run as one HTML file.

    Parameters
    ----------
    run : Run
        Run or study, see `harness.results.run_folder.read_run`.
    file : Path, optional
        File to write, by default `report.html` in the run's folder.
    decided : sequence of Decided, optional
        Result of `decide_run` for the run, computed by default.
    device : DeviceCosts, optional
        Costs by which draw times are predicted, by default those of the stored profile.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the run has no case and no study.
    """
    decided = list(decide_run(run) if decided is None else decided)
    content = make_content(run, decided)
    stored = run.folder / STORED_PROFILE
    try:
        if device is None and stored.is_file():
            device = read_costs(stored)
    except InputError as error:
        content["warnings"].append(f"no predicted draw times: {error}")
    if not content["cases"] and not content["matrices"]:
        detail = f" ({run.problems[0]})" if run.problems else ""
        raise InputError(f"{run.path}: neither a case nor a study{detail}; run or --resume first")
    target = file or run.folder / FILE
    first = content["groups"][0] if content["groups"] else None
    text = load_template(PACKAGE, "report.html").render(
        content=content,
        answer=content["study"] or (first["answer"] if first else "The study has no correlation."),
        failed=sum(case["row"]["status"] == "failed" for case in content["cases"]),
        key_facts=content["key_facts"],
        prediction=predict_run(run, decided, device) if device else None,
        created=run.facts.get("created", ""),
        version=__version__,
        style=read_static(PACKAGE, STYLE),
        charts=read_static(PACKAGE, CHARTS),
        script="\n".join(read_static(PACKAGE, name) for name in SCRIPTS),
        data=pack_json(content),
    )
    atomic.write_output(target, text)
    return target


def predict_run(run: Run, decided: Sequence[Decided], device: DeviceCosts) -> dict[str, Any]:
    """Return the predicted costs of a run's stored triangulations, JSON-ready."""
    views: dict[View, dict[str, Any] | None] = {}
    for group, decision in decided:
        view = group.id.view
        if views.get(view) is None and decision is not None and view.fit not in FIXED_VIEWS:
            seconds = {record.name: record.triangulate_s for record in group.measured}
            if (geometry := read_geometry(run, view)) is not None:
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
) -> dict[str, Any] | None:
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
    rows: list[dict[str, Any]] = [
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
