"""Content and HTML of pages that draw, count and time a run or a profile in a browser."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from harness import __version__, atomic
from harness.errors import InputError
from harness.frame import FIXED_VIEWS, View
from harness.measuring.pool import MeasuringPool
from harness.metrics.groups import DEFAULT_BASE
from harness.metrics.registry import list_predictions
from harness.page.device_summaries import CRITERIA as SUMMARISED
from harness.page.result import RECORD_FIELDS, count_per_polygon
from harness.profile import law
from harness.profile.advice import BASE, CRITERIA, SCENES, sum_scene_features
from harness.profile.cost_terms import PX_TERMS, TERMS, count_draw
from harness.profile.design import DESIGN_VERSION, make_draws, snap_draw
from harness.profile.law import COSTS, make_cost_rows
from harness.profile.placing import Draw
from harness.profile.profile import select_draws_to_fit
from harness.rasterisers.base import read_shader
from harness.report.page import CHARTS, ELEMENTS, SPANS, STYLE
from harness.report.page import PACKAGE as REPORT
from harness.results.parsing import record_to_json
from harness.results.record import Record
from harness.results.run_folder import Geometry, Run, read_geometry
from harness.style import choose_looks
from harness.webpages import encode_array, load_template, pack_json, read_static

PACKAGE = "harness.page"
SHARED = ("figures.js", "timing.js", "grid.js", "device.js", "run.js")
SCRIPTS = (*SHARED, "show.js", "main.js")
FITTING = ("design.js", "stage_draws.js", "law.js", "costs.js", "costs_shown.js")
PROFILING = (*SHARED, *FITTING, "profile.js")

FORMAT, PROFILE_FORMAT = "raster-harness page", "raster-harness profile page"
VERSION = 1


class CaseContent(TypedDict):
    """A triangulation: base64 of uint32 triangles (`rows`) and of exact counters per polygon."""

    rows: str
    fragments: str
    quads: str
    partial_quads: str
    covering_triangles: str
    record: dict[str, Any]


class ViewContent(TypedDict):
    """A view; points : base64 of int32 x, y in 1/256 px; sizes : vertices of each polygon."""

    resolution: int
    rotation: float
    fit: str
    scene: str
    points: str
    sizes: list[int]
    cases: dict[str, CaseContent]


class PageContent(TypedDict):
    """Data of the page that measures a run's triangulations, read by `static/main.js`."""

    format: str
    version: int
    harness: str
    created: str
    scene: str
    base: str
    looks: dict[str, dict[str, Any]]
    criteria: dict[str, str]
    views: list[ViewContent]


class GridContent(TypedDict):
    """Draws on a vertex grid: checksum, exact counters and `law.COSTS` (predicted) of each draw."""

    checksums: list[int]
    counters: dict[str, list[int]]
    predicted: list[list[float]]


class GroupsContent(TypedDict):
    """The draws of a fit.

    places : indices of the draws
    labels, folds : number of each draw's group, and of its cross-validation fold
    reach : half-widths of intervals in standard errors: of a single interval, and of one of a
        family of intervals that hold together
    standard_errors : `law.STANDARD_ERRORS`
    """

    places: list[int]
    labels: list[int]
    folds: list[int]
    reach: list[float]
    standard_errors: dict[str, float]


class ProfileContent(TypedDict):
    """Data of the page that fits a device's cost model (law), read by `static/profile.js`.

    grids : exact results by the step of the device's vertex grid, in 1/256 px
    fitted, plain : draws of the law, and of the coefficients for criteria, see `select_fitted`
    forms, vertices, in_px, costs : `law.FORMS`, `law.VERTICES`, `PX_TERMS` and `law.COSTS`
    scenes : scene -> triangulator -> terms per polygon, for the recommendation
    """

    format: str
    version: int
    harness: str
    design: Any
    seed: int
    draws: list[dict[str, Any]]
    grids: dict[int, GridContent]
    fitted: GroupsContent
    plain: GroupsContent
    terms: dict[str, dict[str, Any]]
    forms: dict[str, dict[str, tuple[str, ...]]]
    vertices: tuple[str, ...]
    in_px: Any
    costs: Any
    base: str
    criteria: dict[str, str]
    scenes: dict[str, dict[str, list[list[float]]]]


def write_page(content: PageContent | ProfileContent, file: Path) -> None:
    """Write the page for the content of a run, with charts, or of a profile, without charts."""
    profiling = content["format"] == PROFILE_FORMAT
    shaders = {name: read_shader(f"{name}.wgsl") for name in ("draw", "count")}
    styles = ("page.css", *["profile.css"] * profiling)
    scripts = PROFILING if profiling else SCRIPTS
    shared = [read_static(REPORT, ELEMENTS), read_static(REPORT, SPANS)]
    text = load_template(PACKAGE, "profile.html" if profiling else "page.html").render(
        version=__version__,
        scene=content.get("scene"),
        charts="" if profiling else read_static(REPORT, CHARTS),
        style="".join(
            [read_static(REPORT, STYLE), *(read_static(PACKAGE, name) for name in styles)]
        ),
        script="\n".join([*shared, *(read_static(PACKAGE, name) for name in scripts)]),
        data=pack_json({**content, "shaders": shaders}),
    )
    atomic.write_output(file, text)


def make_page_content(run: Run) -> PageContent:
    """Return the content of the page of `run`, or raise InputError without a drawable frame."""
    for fit, name in FIXED_VIEWS.items():
        if any(record.id.view.fit == fit for record in run.records):
            raise InputError(f"{run.path}: pages do not support {name}; give another run")
    if not (views := list(_make_views(run))):
        raise InputError(
            f"{run.path}: no stored frame with two or more triangulations; measure again with "
            "this version and several --triangulators"
        )
    names = list(dict.fromkeys(name for view in views for name in view["cases"]))
    return {
        "format": FORMAT,
        "version": VERSION,
        "harness": __version__,
        "created": str(run.facts.get("created") or ""),
        "scene": str(views[0]["scene"]),
        "base": DEFAULT_BASE if DEFAULT_BASE in names else names[0],
        "looks": {name: asdict(look) for name, look in choose_looks(names).items()},
        "criteria": {name: list_predictions()[name].title for name in SUMMARISED},
        "views": views,
    }


def _make_views(run: Run) -> Iterator[ViewContent]:
    """Yield views with two or more drawable triangulations, with one sample and native order."""
    by_view: dict[View, dict[str, Record]] = {}
    for record in run.records:
        options = record.id.options
        if record.is_ok and options.samples == 1 and options.order == "native":
            by_view.setdefault(record.id.view, {}).setdefault(record.name, record)
    for view, records in by_view.items():
        geometry = read_geometry(run, view)
        if geometry is None or len(drawn := [n for n in records if n in geometry.triangles]) < 2:
            continue
        yield {
            "resolution": view.resolution,
            "rotation": view.rotation,
            "fit": view.fit,
            "scene": records[drawn[0]].id.scene,
            "points": encode_array(geometry.points.astype("<i4")),
            "sizes": geometry.grid.vertex_counts.tolist(),
            "cases": {name: _encode_triangulation(records[name], geometry) for name in drawn},
        }


def _encode_triangulation(record: Record, geometry: Geometry) -> CaseContent:
    """Return triangles and exact counters per polygon, as base64 of uint32, and the record."""
    rows = geometry.triangles[record.name]
    fields = record_to_json(record) | {"triangulator": record.name}
    fragments, quads, partial, covering = (
        encode_array(counts.astype("<u4")) for counts in count_per_polygon(geometry, rows)
    )
    return {
        "rows": encode_array(rows.astype("<u4")),
        "fragments": fragments,
        "quads": quads,
        "partial_quads": partial,
        "covering_triangles": covering,
        "record": {name: fields[name] for name in RECORD_FIELDS if name in fields},
    }


SEED = 0

# Fields of a draw that the page receives.
DRAW_FIELDS = ("kind", "name", "group", "work", "aspect", "area")

GRID_STEPS = (1, 2, 4, 8, 16)  # steps of devices' vertex grids, in 1/256 px; see `grid.js`


def make_profile_content(pool: MeasuringPool) -> ProfileContent:
    """Return the content of the profiling page, which generates the draws."""
    draws = make_draws(SEED)
    fitted, plain = select_draws_to_fit(draws)
    sums = {
        name: sum_scene_features(pool, scene, (BASE, *CRITERIA)) for scene, name in SCENES.items()
    }
    return {
        "format": PROFILE_FORMAT,
        "version": VERSION,
        "harness": __version__,
        "design": DESIGN_VERSION,
        "seed": SEED,
        "draws": [{name: getattr(draw, name) for name in DRAW_FIELDS} for draw in draws],
        "grids": {
            step: _make_grid_content([snap_draw(draw, step) for draw in draws])
            for step in GRID_STEPS
        },
        "fitted": _make_groups(draws, fitted),
        "plain": _make_groups(draws, plain),
        "terms": {name: term._asdict() for name, term in TERMS.items()},
        "forms": law.FORMS,
        "vertices": law.VERTICES,
        "in_px": PX_TERMS,
        "costs": COSTS,
        "base": BASE,
        "criteria": CRITERIA,
        "scenes": {
            name: {criterion: _round_rows(rows) for criterion, rows in predicted.items()}
            for name, predicted in sums.items()
            if predicted is not None
        },
    }


def _make_grid_content(draws: Sequence[Draw]) -> GridContent:
    """Return checksums, exact counters and `law.COSTS` of draws whose points are on one grid."""
    counted = [count_draw(draw) for draw in draws]
    predicted = make_cost_rows([(draw.frame, draw.triangles) for draw in draws])
    return {
        "checksums": [draw.checksum for draw in draws],
        "counters": {name: [counts[name] for counts in counted] for name in counted[0]},
        "predicted": _round_rows(predicted),
    }


def _make_groups(draws: Sequence[Draw], positions: list[int]) -> GroupsContent:
    """Return each draw's group and fold, and the half-widths of intervals in standard errors."""
    groups = [draws[position].group for position in positions]
    labels = np.unique(groups, return_inverse=True)[1]
    return {
        "places": positions,
        "labels": labels.tolist(),
        "folds": law.assign_folds(groups).tolist(),
        "reach": [
            law.compute_interval_reach(int(labels.max()) + 1, confidence)
            for confidence in (law.CONFIDENCE, law.FAMILY_CONFIDENCE)
        ],
        "standard_errors": law.STANDARD_ERRORS,
    }


def _round_rows(rows: Any) -> list[list[float]]:
    """Round to 9 significant digits, enough for any fit."""
    return [[float(f"{value:.9g}") for value in row] for row in rows.tolist()]
