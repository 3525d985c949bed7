"""What the report of a run shows, as plain values."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from harness.machine.git import commit_of
from harness.metrics.advice import advice
from harness.metrics.decision import Decided, Decision, Standing, decide_all
from harness.metrics.groups import RecordGroup
from harness.metrics.per_polygon import (
    Columns,
    columns_of,
    error_of,
    rank_correlation,
    ratio_pairs,
)
from harness.metrics.per_view import describe_views
from harness.metrics.registry import (
    PREDICTED,
    Metric,
    find_metric,
    measures,
    metrics_of,
    predictions,
)
from harness.rasterisers.counters import ESTIMATES, compute_estimates
from harness.report import matrix
from harness.report.matrix import answer_of_study, criteria_of, from_run, from_study
from harness.results import drawings
from harness.results.drawings import Geometry
from harness.results.processors import processor_label
from harness.results.record import Record
from harness.results.run_folder import Run
from harness.stats.run_quality import state_of
from harness.study.subjects import MEASURES
from harness.style import flat, looks
from harness.summary import row_of
from harness.webpages import encoded
from triangulators.polygon_arrays import ranges

MAX_MARKS = 6_000
"""Marks of one chart: a polygon under one triangulator each."""

MAX_VALUES = 600_000
"""Per-polygon numbers that one report carries."""

MIN_POLYGONS = 12

MAX_TRIANGLES = 1_500_000
"""Triangles that one report carries for its heatmaps, over all triangulators and views."""


class PackedTriangles(TypedDict):
    """Triangles of each polygon, and base64 of uint32 indices into the polygon's points."""

    counts: list[int]
    rows: str


class Drawing(TypedDict):
    """Polygons and their triangulations, see `pack`."""

    points: str
    sizes: list[int]
    source: list[int]
    triangles: dict[str, PackedTriangles]


class ViewContent(TypedDict):
    """A view: which of its polygons are shown, and each triangulator's predictions of them."""

    polygons: int
    chosen: list[int]
    predicted: dict[str, dict[str, list[float]]]
    drawing: Drawing | None


class GroupContent(TypedDict):
    """A group of comparable cases; correlations : measure -> criterion -> rank correlation."""

    scene: str
    rasteriser: str
    device: str
    view: str
    condition: str
    base: str | None
    measures: list[str]
    main: str | None
    correlations: dict[str, dict[str, float | None]]
    estimated: dict[str, dict[str, float | None]]
    answer: str
    judged: str
    views: list[str]


class CaseContent(TypedDict):
    """A case: the number of its group, its row of summary.csv, counters of the shown polygons."""

    group: int
    row: dict[str, Any]
    rank: int | None
    complete: bool
    warnings: list[str]
    counted: dict[str, list[int]] | None


class Content(TypedDict):
    """Data of the report, read by `static/main.js`."""

    name: str
    figures: dict[str, dict[str, Any]]
    criteria: list[str]
    estimates: dict[str, str]
    measures: list[str]
    triangulators: list[str]
    looks: dict[str, dict[str, Any]]
    groups: list[GroupContent]
    cases: list[CaseContent]
    views: dict[str, ViewContent]
    matrices: list[dict[str, Any]]
    study: str | None
    environment: list["Row"]
    key_facts: list[tuple[str, str]]
    warnings: list[str]


def content_of(run: Run, decided: Sequence[Decided] | None = None) -> Content:
    """Return everything the report of `run` shows, JSON-ready.

    decided : what `decide_all` returned for the run; None: decide now
    """
    decided = list(decide_all(run) if decided is None else decided)
    # A GPU is what most readers ask about, then what was timed; else in the order measured.
    position = {id(record): number for number, record in enumerate(run.records)}
    decided.sort(key=lambda each: (_interest(each[0]), _first_position(each[0], position)))
    polygons = _Polygons(run, [group for group, _ in decided])
    names = _triangulators(run)
    shown = metrics_of(run.records)
    scenes = [run.facts.get("scene", {}).get("name"), *(r.id.scene for r in run.records[:1])]
    groups: list[GroupContent] = []
    cases: list[CaseContent] = []
    for number, (group, decision) in enumerate(decided):
        groups.append(_group(group, decision, polygons))
        ranks = {id(each.record): rank for rank, each in enumerate(_standings(decision), start=1)}
        cases += [
            _case(number, record, ranks.get(id(record)), decision, polygons)
            for record in group.records
        ]
    study = from_study(run.folder)
    return {
        "name": next(filter(None, scenes), run.path.name),
        "figures": {
            name: _described(metric)
            for name, metric in (shown | {name: find_metric(name) for name in ESTIMATES}).items()
        },
        "criteria": [name for name, metric in shown.items() if metric.kind == "prediction"],
        "estimates": {name: each.measure for name, each in ESTIMATES.items()},
        "measures": measures(shown),
        "triangulators": names,
        "looks": {name: asdict(each) for name, each in looks(names).items()},
        "groups": groups,
        "cases": cases,
        "views": polygons.views,
        "matrices": study or from_run(_correlations_of_first_view(groups)),
        "study": answer_of_study(study),
        "environment": rows(run),
        "key_facts": key_rows(run),
        "warnings": [*run.facts.get("warnings", []), *state_of(run).words, *run.problems],
    }


def _first_position(group: RecordGroup, position: Mapping[int, int]) -> int:
    return min(position.get(id(record), 0) for record in group.records)


def _standings(decision: Decision | None) -> Sequence[Standing]:
    return decision.standings if decision else ()


def _correlations_of_first_view(
    groups: Sequence[GroupContent],
) -> Iterator[tuple[tuple[str, str, str], Mapping[str, float | None]]]:
    """Yield ((rasteriser, device, measure), criterion -> rank correlation) of the first view."""
    for group in groups:
        if group["view"] == groups[0]["view"]:
            for measure, values in group["correlations"].items():
                yield (group["rasteriser"], group["device"], measure), values


class _Polygons:
    """Per-polygon columns of the run's cases, and the views that are drawn from them."""

    def __init__(self, run: Run, groups: Sequence[RecordGroup]) -> None:
        self.run = run
        self.views: dict[str, ViewContent] = {}
        cases = sum(len(group.measured) for group in groups)
        share = MAX_VALUES // max(1, 8 * cases)  # a case holds some eight columns
        widest = max((len(group.records) for group in groups), default=1)
        self._max = max(MIN_POLYGONS, min(share, MAX_MARKS // widest))
        self._chosen: dict[str, NDArray[np.int64]] = {}

    def read(self, record: Record) -> Columns | None:
        """Return a case's columns; the first time, add its view with drawings and predictions."""
        columns = columns_of(self.run, record) if record.is_ok else None
        if columns is None:
            return None
        view = drawings.name_of(record.id.view)
        if view not in self._chosen:
            self._add_view(view, record, len(columns[f"{PREDICTED}triangles"]))
        predicted = self.views[view]["predicted"]
        if record.name not in predicted:
            chosen = self._chosen[view]
            predicted[record.name] = {
                name.removeprefix(PREDICTED): list(map(_rounded, column[chosen].tolist()))
                for name, column in columns.items()
                if name.startswith(PREDICTED)
            }
        return columns

    def _add_view(self, name: str, record: Record, polygons: int) -> None:
        chosen = self._chosen[name] = choose(polygons, self._max)
        view: ViewContent = {
            "polygons": polygons,
            "chosen": chosen.tolist(),
            "predicted": {},
            "drawing": None,
        }
        geometry = drawings.read(self.run, record.id.view)
        if geometry is not None and len(geometry.grid) == polygons:
            share = len(chosen) / max(1, polygons)
            triangles = sum(len(rows) for rows in geometry.triangles.values())
            if triangles * share <= MAX_TRIANGLES / (1 + len(self.views)):
                view["drawing"] = pack(geometry, chosen)
        self.views[name] = view

    def counted(self, record: Record, columns: Columns) -> dict[str, list[int]]:
        """Return the counters of the chosen polygons."""
        chosen = self._chosen[drawings.name_of(record.id.view)]
        return {name: columns[name][chosen].astype(int).tolist() for name in measures(columns)}


def _group(group: RecordGroup, decision: Decision | None, polygons: _Polygons) -> GroupContent:
    columns = {
        record.name: values
        for record in group.records
        if (values := polygons.read(record)) is not None
    }
    base = group.base
    base_name = base.name if base is not None else next(iter(columns), None)
    counted = measures(columns[base_name]) if base_name in columns else []
    correlations = {
        measure: {
            criterion: _rounded(rank_correlation(*pairs))
            for criterion in predictions()
            if base_name and f"{PREDICTED}{criterion}" in columns[base_name]
            for pairs in [ratio_pairs(columns, base_name, criterion, measure)]
        }
        for measure in counted
        if base_name is not None
    }
    # One polygon has no columns: its record's totals are its counters.
    totals = measures((base or group.records[0]).counters)
    main = next(iter([*counted, *totals]), None)
    spread = matrix.read(polygons.run, group.id.view) if main in MEASURES else None
    return {
        "scene": group.id.scene,
        "rasteriser": group.id.rasteriser,
        "device": group.id.device_name,
        "view": drawings.name_of(group.id.view),
        "condition": group.id.condition,
        "base": base_name,
        "measures": counted,
        "main": main,
        "correlations": correlations,
        "estimated": {
            name: {"rank": _rounded(rank_correlation(*pairs)), "error": _rounded(error_of(*pairs))}
            for name, each in ESTIMATES.items()
            if each.measure in counted and base_name
            for pairs in [ratio_pairs(columns, base_name, name, each.measure)]
        },
        "answer": advice(decision),
        "judged": criteria_of(main, correlations, spread),
        "views": describe_views(group),
    }


def _case(
    number: int,
    record: Record,
    rank: int | None,
    decision: Decision | None,
    polygons: _Polygons,
) -> CaseContent:
    row = row_of(record, decision) | {"polygons": record.polygons}
    predicted: dict[str, Any] = {PREDICTED + name: v for name, v in record.predicted.items()}
    predicted |= compute_estimates(predicted, PREDICTED)
    columns = polygons.read(record)
    complete = any(each.complete for each in _standings(decision) if each.record is record)
    return {
        "group": number,
        "row": {name: _rounded(value) for name, value in (row | predicted).items()},
        "rank": rank,
        "complete": complete,
        "warnings": list(record.time.warnings) if record.time else [],
        "counted": None if columns is None else polygons.counted(record, columns),
    }


def _interest(group: RecordGroup) -> tuple[bool, bool, bool]:
    timed = any(record.time for record in group.measured)
    gpu = bool(group.measured) and group.id.device.startswith("gpu")
    main = bool(group.measured) and group.id.rasteriser == "opengl"
    return not (gpu and timed), not (main and timed), not timed


def _described(metric: Metric) -> dict[str, Any]:
    names = ("title", "label", "unit", "kind", "better", "description")
    return {name: getattr(metric, name) for name in names} | {"percent": "%}" in metric.form}


def _triangulators(run: Run) -> list[str]:
    """Return the names in the order of the plan, then those that only records have."""
    planned = run.facts.get("plan", {}).get("triangulators", [])
    seen = list(dict.fromkeys(record.name for record in run.records))
    return [name for name in planned if name in seen] + [n for n in seen if n not in planned]


def _rounded(value: Any) -> Any:
    """Return a value with at most 7 significant digits; what JSON cannot hold becomes None."""
    if isinstance(value, float):
        return float(f"{value:.7g}") if math.isfinite(value) else None
    return value


def choose(polygons: int, most: int) -> NDArray[np.int64]:
    """Return the numbers, in order, of at most `most` polygons: all, or a fixed random sample."""
    chosen = np.random.default_rng(0).choice(polygons, min(polygons, most), replace=False)
    return np.sort(chosen).astype(np.int64)


def pack(geometry: Geometry, chosen: NDArray[np.int64]) -> Drawing:
    """Return the `chosen` polygons' points and triangles, JSON-ready.

    points : base64 of int32 x, y in 1/256 px, y up, polygon by polygon; `sizes` vertices each
    triangles : triangulator -> {"counts", "rows"}: triangles of each polygon, and base64 of
        uint32 indices into that polygon's own points
    """
    offsets = geometry.grid.vertex_offsets
    starts, sizes = offsets[chosen], geometry.grid.vertex_counts[chosen]
    take = ranges(starts, sizes)
    packed: Drawing = {
        "points": encoded(geometry.points[take].astype("<i4")),
        "sizes": sizes.tolist(),
        "source": geometry.source[chosen].tolist(),
        "triangles": {},
    }
    for name, triangles in geometry.triangles.items():
        owner = np.searchsorted(offsets, triangles[:, 0], side="right") - 1
        first = np.searchsorted(owner, chosen, side="left")
        counts = np.searchsorted(owner, chosen, side="right") - first
        rows = triangles[ranges(first, counts)] - np.repeat(starts, counts)[:, None]
        packed["triangles"][name] = {
            "counts": counts.tolist(),
            "rows": encoded(rows.astype("<u4")),
        }
    return packed


Row = tuple[str, str, str]


def rows(run: Run) -> list[Row]:
    """Return every fact of `run.json` as (section, name, value); lists and nesting flattened."""
    facts: Mapping[str, Any] = {**run.facts}
    known = ("created", "schema_version", "interrupted", "resumed")
    found = [("run", name, _text(facts[name])) for name in known if name in facts]
    for section in ("scene", "environment", "cpu", "state", "plan", "devices", "frames", "seconds"):
        values = facts.get(section)
        if isinstance(values, list):
            values = {str(number): value for number, value in enumerate(values)}
        if isinstance(values, dict):
            told = flat(values, ": ").items()
            found += [(section, name, _text(value)) for name, value in told]
    return found


def key_rows(run: Run) -> list[tuple[str, str]]:
    """Return (name, value) of the few facts that times depend on most, where they are known."""
    machine = run.facts.get("environment") or {}
    scene = run.facts.get("scene") or {}
    found = [("processor", processor_label(run.facts)), ("system", machine.get("kernel"))]
    for label, device in (run.facts.get("devices") or {}).items():
        details = device.get("details") or {}
        timer = (device.get("timer") or {}).get("timer", "not timed")
        names = [details.get("renderer"), details.get("version"), f"timer: {timer}"]
        found.append((label, ", ".join(str(name) for name in names if name)))
    gpus = machine.get("gpus") or []
    found += [("GPU", ", ".join(str(value) for value in gpu.values())) for gpu in gpus]
    if scene:
        size = f"{scene.get('polygons', 0):,} polygons; {scene.get('licence', '')}"
        found.append(("scene", f"{scene.get('description') or scene.get('name')}: {size}"))
    found.append(("commit", commit_of(run.facts)))
    harness = f"{machine.get('harness', '')} {commit_of(run.facts, 'git')}"
    found.append(("harness", harness.strip()))
    found.append(("command", " ".join(map(str, machine.get("command") or []))))
    return [(name, str(value)) for name, value in found if value]


def _text(value: Any) -> str:
    """Return a text as it is, and anything else as run.json has it."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
