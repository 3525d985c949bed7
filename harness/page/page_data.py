"""A page that measures: what whatever browser opens it draws, counts and times.

It holds a run's frames and triangulations, or a device's draws, and what is known of them.
"""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import __version__
from harness.errors import UsageError
from harness.figures.groups import USUAL_BASE
from harness.figures.registry import predictions
from harness.frame import OWN_VIEWS
from harness.measuring.processes import Bench
from harness.page.device_summaries import CRITERIA as SUMMARISED
from harness.profile import law
from harness.profile.advice import BASE, CRITERIA, SCENES, terms_of
from harness.profile.counted import IN_PX, TERMS, counters
from harness.profile.design import DESIGN, Draw, draws, snapped
from harness.profile.law import COSTS, costs_of
from harness.profile.profile import fitted_of
from harness.profile.words import BY_SUM
from harness.rasterisers.base import shader
from harness.rasterisers.reference import predict
from harness.report.page import CHARTS, ELEMENTS, SPANS, STYLE
from harness.report.page import PACKAGE as REPORT
from harness.stored import drawings
from harness.stored.drawings import Geometry, view_of
from harness.stored.folder import Record, Run
from harness.style import looks
from harness.webpages import encoded, packed, static, template, write_whole

PACKAGE = "harness.page"
SHARED = ("figures.js", "timing.js", "grid.js", "device.js", "run.js")
SCRIPTS = (*SHARED, "show.js", "main.js")
PROFILING = (*SHARED, "design.js", "law.js", "costs.js", "costs_shown.js", "profile.js")

FORMAT = "raster-harness page"
VERSION = 1

KEPT = (
    *("scene", "scene_hash", "triangulator", "resolution", "rotation", "fit"),
    *("reason", "polygons", "polygons_skipped", "polygons_failed", "vertices", "triangles"),
    *("predicted", "triangulate_s", "conforming", "t_junctions", "proven", "largest_gap"),
    "outline_quads",
)
"""Fields of a record that hold on any device."""

TOLD = ("fragments", "quads", "partial_quads")
"""What the page counts of each polygon."""

Content = dict[str, Any]


def write_page(run: Run, file: Path) -> Path:
    """Write the page that measures what `run` drew; returns where it is.

    Raises
    ------
    UsageError
        if the run kept nothing to draw, or the file cannot be written
    """
    content = content_of(run)
    charts = static(REPORT, CHARTS)
    _write(file, "page.html", SCRIPTS, content, scene=content["scene"], charts=charts)
    return file


def write_profile_page(bench: Bench, file: Path) -> Path:
    """Write the page that says what a triangle costs on the device that opens it.

    bench : what triangulates the scenes of its advice

    Raises
    ------
    UsageError
        if the file cannot be written
    """
    _write(file, "profile.html", PROFILING, content_of_profile(bench), charts="")
    return file


def _write(
    file: Path, name: str, scripts: Sequence[str], content: dict[str, Any], **shown: str
) -> None:
    content["shaders"] = {name: shader(f"{name}.wgsl") for name in ("draw", "count")}
    styles = [static(REPORT, STYLE), static(PACKAGE, "page.css"), static(PACKAGE, "profile.css")]
    shared = [static(REPORT, ELEMENTS), static(REPORT, SPANS)]
    text = template(PACKAGE, name).render(
        version=__version__,
        style="".join(styles if name == "profile.html" else styles[:2]),
        script="\n".join([*shared, *(static(PACKAGE, each) for each in scripts)]),
        data=packed(content),
        **shown,
    )
    write_whole(file, text)


def content_of(run: Run) -> Content:
    """Return everything the page of `run` holds, JSON-ready.

    Raises
    ------
    UsageError
        if the run kept nothing that can be drawn
    """
    for fit, name in OWN_VIEWS.items():
        if any(record.get("fit") == fit for record in run.records):
            raise UsageError(f"{run.path} is of {name}, which a page cannot cut: give another run")
    views = [view for records in _kept(run) if (view := _view(run, records))]
    if not views:
        raise UsageError(
            f"{run.path} kept no frame with two triangulations or more: a page has nothing to "
            "draw; run `raster-harness run` with this version, and two --triangulators"
        )
    names = list(dict.fromkeys(name for view in views for name in view["cases"]))
    return {
        "format": FORMAT,
        "version": VERSION,
        "harness": __version__,
        "created": str(run.facts.get("created") or ""),
        "scene": str(views[0]["scene"]),
        "base": USUAL_BASE if USUAL_BASE in names else names[0],
        "looks": {name: asdict(look) for name, look in looks(names).items()},
        "criteria": {name: predictions()[name].title for name in SUMMARISED},
        "views": views,
    }


def _kept(run: Run) -> list[list[Record]]:
    """Return the records that can be drawn again, by view: of each triangulator the first.

    One sample a pixel, no work and the triangulator's own order, on whichever device.
    """
    found: dict[str, dict[str, Record]] = {}
    for record in run.records:
        options = record.get("options") or {}
        plain = options.get("samples", 1) == 1 and options.get("order", "native") == "native"
        if record["status"] != "ok" or not plain:
            continue
        view = found.setdefault(drawings.name_of(view_of(record)), {})
        view.setdefault(record["triangulator"], record)
    return [list(records.values()) for records in found.values()]


def _view(run: Run, records: Sequence[Record]) -> Content | None:
    """Return one view with its triangulations, None where there are not two to compare."""
    view = view_of(records[0])
    kept = drawings.read(run, view)
    if kept is None:
        return None
    cases = {}
    for record in records:
        rows = kept.triangles.get(record["triangulator"])
        if rows is not None:
            counted = zip(TOLD, counted_exactly(kept, rows), strict=True)
            cases[record["triangulator"]] = {
                "rows": encoded(rows.astype("<u4")),
                **{name: encoded(each.astype("<u4")) for name, each in counted},
                "record": {name: record[name] for name in KEPT if name in record},
            }
    if len(cases) < 2:
        return None
    return {
        **asdict(view),
        "scene": records[0]["scene"],
        "points": encoded(kept.points.astype("<i4")),
        "sizes": np.diff(kept.offsets).tolist(),
        "cases": cases,
    }


def counted_exactly(kept: Geometry, rows: NDArray[Any]) -> tuple[NDArray[np.int64], ...]:
    """Return what the page counts of each polygon, as the CPU reference counts (m, 3) `rows`."""
    predicted = predict(kept.points, rows)
    owner = np.searchsorted(kept.offsets, rows[:, 0], side="right") - 1
    size = len(kept.offsets) - 1
    return tuple(np.bincount(owner, predicted[name], size).astype(np.int64) for name in TOLD)


PROFILE_FORMAT = "raster-harness profile page"
SEED = 0

ABOUT = ("kind", "name", "group", "work", "aspect", "area")
"""What is told of each draw."""

STEPS = (1, 2, 4, 8, 16)
"""Grids that a browser's device may snap to, in 1/256 px; see `grid.js`."""


def content_of_profile(bench: Bench) -> Content:
    """Return everything that the page holds, JSON-ready; it makes the draws itself."""
    made = draws(SEED)
    fitted, plain = fitted_of(made)
    sums = {name: terms_of(bench, scene, (BASE, *CRITERIA)) for scene, name in SCENES.items()}
    return {
        "format": PROFILE_FORMAT,
        "version": VERSION,
        "harness": __version__,
        "design": DESIGN,
        "seed": SEED,
        "draws": [{name: getattr(draw, name) for name in ABOUT} for draw in made],
        "grids": {step: grid_of([snapped(draw, step) for draw in made]) for step in STEPS},
        "fitted": _groups(made, fitted),
        "plain": _groups(made, plain),
        "terms": {name: term._asdict() for name, term in TERMS.items()},
        "sums": {
            name: {"weights": [parts.get(term, 0) for term in TERMS], "words": BY_SUM[name]}
            for name, parts in law.SUMS.items()
        },
        "in_px": IN_PX,
        "costs": COSTS,
        "base": BASE,
        "criteria": CRITERIA,
        "scenes": {
            name: {each: _short(rows) for each, rows in found.items()}
            for name, found in sums.items()
            if found is not None
        },
    }


def grid_of(made: Sequence[Draw]) -> Content:
    """Return the checksum and the exact counters of each draw, and a criterion's terms of it."""
    counted = [counters(draw) for draw in made]
    predicted = costs_of([(draw.frame, draw.triangles) for draw in made])
    return {
        "checksums": [draw.checksum for draw in made],
        "counters": {name: [each[name] for each in counted] for name in counted[0]},
        "predicted": _short(predicted),
    }


def _groups(made: Sequence[Draw], places: list[int]) -> Content:
    """Return places among the draws, with the number of the group and of the fold of each."""
    labels = np.unique([made[place].group for place in places], return_inverse=True)[1]
    folds = law.folds_of(labels, SEED).tolist()
    reach = [law.quantile(int(labels.max()) + 1, each) for each in (law.CONFIDENCE, law.OF_ALL)]
    return {"places": places, "labels": labels.tolist(), "folds": folds, "reach": reach}


def _short(rows: Any) -> list[list[float]]:
    """Return rows of numbers with digits enough for any fit."""
    return [[float(f"{value:.9g}") for value in row] for row in rows.tolist()]
