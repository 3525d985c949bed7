"""A page that measures: what whatever browser opens it draws, counts and times.

It holds a run's frames and triangulations, or a device's draws, and what is known of them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from harness import __version__
from harness.errors import UsageError
from harness.frame import OWN_VIEWS, View
from harness.measuring.pool import MeasuringPool
from harness.metrics.groups import USUAL_BASE
from harness.metrics.registry import predictions
from harness.page.device_summaries import CRITERIA as SUMMARISED
from harness.page.result import KEPT, TOLD, counted_exactly
from harness.profile import law
from harness.profile.advice import BASE, CRITERIA, SCENES, terms_of
from harness.profile.counted import IN_PX, TERMS, counters
from harness.profile.design import DESIGN, Draw, draws, snapped
from harness.profile.law import COSTS, costs_of
from harness.profile.profile import fitted_of
from harness.profile.words import BY_SUM
from harness.rasterisers.base import shader
from harness.report.page import CHARTS, ELEMENTS, SPANS, STYLE
from harness.report.page import PACKAGE as REPORT
from harness.results import drawings
from harness.results.drawings import Geometry, view_of
from harness.results.run_folder import Record, Run
from harness.style import looks
from harness.webpages import encoded, packed, static, template, write_atomically

PACKAGE = "harness.page"
SHARED = ("figures.js", "timing.js", "grid.js", "device.js", "run.js")
SCRIPTS = (*SHARED, "show.js", "main.js")
PROFILING = (*SHARED, "design.js", "law.js", "costs.js", "costs_shown.js", "profile.js")

FORMAT, PROFILE_FORMAT = "raster-harness page", "raster-harness profile page"
VERSION = 1

Content = dict[str, Any]


def write_page(content: Content, file: Path) -> None:
    """Write a page: of a run's content, or of a profile's, which shows no charts."""
    profiling = content["format"] == PROFILE_FORMAT
    shaders = {name: shader(f"{name}.wgsl") for name in ("draw", "count")}
    styles = ("page.css", *["profile.css"] * profiling)
    scripts = PROFILING if profiling else SCRIPTS
    shared = [static(REPORT, ELEMENTS), static(REPORT, SPANS)]
    text = template(PACKAGE, "profile.html" if profiling else "page.html").render(
        version=__version__,
        scene=content.get("scene"),
        charts="" if profiling else static(REPORT, CHARTS),
        style="".join([static(REPORT, STYLE), *(static(PACKAGE, each) for each in styles)]),
        script="\n".join([*shared, *(static(PACKAGE, each) for each in scripts)]),
        data=packed(content | {"shaders": shaders}),
    )
    write_atomically(file, text)


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
    if not (views := list(_views(run))):
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


def _views(run: Run) -> Iterator[Content]:
    """Yield each view of which two triangulations or more can be drawn again.

    One sample a pixel, no work and the triangulator's own order, on whichever device; of each
    triangulator the first.
    """
    found: dict[View, dict[str, Record]] = {}
    for record in run.records:
        options = record.get("options") or {}
        plain = options.get("samples", 1) == 1 and options.get("order", "native") == "native"
        if record["status"] == "ok" and plain:
            found.setdefault(view_of(record), {}).setdefault(record["triangulator"], record)
    for view, records in found.items():
        kept = drawings.read(run, view)
        if kept is None or len(drawn := [n for n in records if n in kept.triangles]) < 2:
            continue
        yield {
            **asdict(view),
            "scene": records[drawn[0]]["scene"],
            "points": encoded(kept.points.astype("<i4")),
            "sizes": kept.grid.vertex_counts.tolist(),
            "cases": {name: _case(records[name], kept) for name in drawn},
        }


def _case(record: Record, kept: Geometry) -> Content:
    """Return one triangulation: base64 of uint32 rows, and the counts to be found, by polygon."""
    rows = kept.triangles[record["triangulator"]]
    counted = zip(TOLD, counted_exactly(kept, rows), strict=True)
    return {
        "rows": encoded(rows.astype("<u4")),
        **{name: encoded(each.astype("<u4")) for name, each in counted},
        "record": {name: record[name] for name in KEPT if name in record},
    }


SEED = 0

ABOUT = ("kind", "name", "group", "work", "aspect", "area")
"""What is told of each draw."""

STEPS = (1, 2, 4, 8, 16)
"""Grids that a browser's device may snap to, in 1/256 px; see `grid.js`."""


def content_of_profile(pool: MeasuringPool) -> Content:
    """Return everything that the page holds, JSON-ready; it makes the draws itself."""
    made = draws(SEED)
    fitted, plain = fitted_of(made)
    sums = {name: terms_of(pool, scene, (BASE, *CRITERIA)) for scene, name in SCENES.items()}
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
