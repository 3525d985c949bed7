"""What a measuring page holds: frames, triangulations, and what is known of them already."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import __version__
from harness.errors import UsageError
from harness.figures.groups import USUAL_BASE
from harness.figures.polygons import columns_of
from harness.figures.registry import predictions
from harness.frame import OWN_VIEWS
from harness.page.device_summaries import CRITERIA
from harness.rasterisers.reference import predict
from harness.stored import drawings
from harness.stored.drawings import Geometry, view_of
from harness.stored.folder import Record, Run
from harness.style import looks
from harness.webpages import encoded

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
    found = [_view(run, records) for records in _kept(run).values()]
    views = [view for view in found if view is not None]
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
        "criteria": {name: predictions()[name].title for name in CRITERIA},
        "views": views,
    }


def _kept(run: Run) -> dict[str, list[Record]]:
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
        # One that counted its polygons is better than one that did not.
        known = view.get(record["triangulator"])
        if known is None or _counts(run, known) is None:
            view[record["triangulator"]] = record
    return {name: list(records.values()) for name, records in found.items()}


def _view(run: Run, records: Sequence[Record]) -> Content | None:
    """Return one view with its triangulations, None where there are not two to compare."""
    view = view_of(records[0])
    kept = drawings.read(run, view)
    if kept is None:
        return None
    cases = {
        record["triangulator"]: _case(run, record, kept)
        for record in records
        if record["triangulator"] in kept.triangles
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


def _case(run: Run, record: Record, kept: Geometry) -> Content:
    """Return one triangulation: base64 of uint32 rows, and the counts to be found, by polygon."""
    rows = kept.triangles[record["triangulator"]]
    counted = _counts(run, record)
    if counted is None:
        counted = counted_exactly(kept, rows)
    return {
        "rows": encoded(rows.astype("<u4")),
        **{name: encoded(each.astype("<u4")) for name, each in zip(TOLD, counted, strict=True)},
        "record": {name: record[name] for name in KEPT if name in record},
    }


def counted_exactly(kept: Geometry, rows: NDArray[Any]) -> tuple[NDArray[np.int64], ...]:
    """Return what the page counts of each polygon, as the CPU reference counts (m, 3) `rows`."""
    predicted = predict(kept.points, rows)
    owner = np.searchsorted(kept.offsets, rows[:, 0], side="right") - 1
    size = len(kept.offsets) - 1
    return tuple(np.bincount(owner, predicted[name], size).astype(np.int64) for name in TOLD)


def _counts(run: Run, record: Record) -> tuple[NDArray[np.int64], ...] | None:
    """Return the same as the run counted it, None if it did not."""
    columns = columns_of(run, record)
    if columns is None or not {*TOLD} <= set(columns):
        return None
    return tuple(np.rint(columns[name]).astype(np.int64) for name in TOLD)
