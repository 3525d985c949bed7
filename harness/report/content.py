"""Content of a run's report, as JSON-ready values."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from harness.machine.git import get_commit
from harness.metrics.decision import Decided, Decision, decide_run, format_advice
from harness.metrics.groups import (
    Columns,
    RecordGroup,
    describe_views,
    pair_ratios,
    read_columns,
    read_processor,
)
from harness.metrics.registry import (
    PREDICTED,
    find_metric,
    find_metrics,
    list_costs,
    list_predictions,
)
from harness.metrics.run_quality import get_run_state
from harness.metrics.statistics import compute_rank_correlation, compute_rms_error
from harness.rasterisers.counters import ESTIMATES, compute_estimates
from harness.report import matrix
from harness.report.matrix import (
    format_best_criterion,
    format_best_criterion_of_study,
    make_run_matrices,
    read_study_matrices,
)
from harness.results.record import Record
from harness.results.run_folder import Geometry, Run, get_view_file_stem, read_geometry
from harness.study.subjects import MEASURES
from harness.style import choose_looks, flatten
from harness.summary import make_row
from harness.webpages import encode_array
from triangulators.polygon_arrays import concatenate_ranges

MAX_MARKS = 6_000  # maximum number of marks in a chart: polygons times triangulators
MAX_VALUES = 600_000  # maximum number of per-polygon values in a report
MIN_POLYGONS = 12  # sampled in each view, if the view has as many
MAX_TRIANGLES = 1_500_000  # in a report's heatmaps, over all triangulators and views


METRIC_FIELDS = ("title", "label", "unit", "kind", "better", "description")  # in a report


# JSON-ready data of a report, or of a part of it, as `static/main.js` reads it.
class PackedTriangles(TypedDict):
    """Triangles of the sampled polygons.

    counts : number of triangles of each polygon
    rows : base64 of uint32 vertex indices, which start at 0 in each polygon
    """

    counts: list[int]
    rows: str


class Drawing(TypedDict):
    """Polygons and their triangulations, see `pack_drawing`."""

    points: str
    sizes: list[int]
    source: list[int]
    triangles: dict[str, PackedTriangles]


class ViewContent(TypedDict):
    """A view: indices of sampled polygons, and each triangulator's predictions for the sample."""

    polygons: int
    sampled: list[int]
    predicted: dict[str, dict[str, list[float]]]
    drawing: Drawing | None


class GroupContent(TypedDict):
    """A group of comparable cases, which differ in the triangulator alone.

    correlations : measure -> criterion -> rank correlation
    estimated : estimate -> rank correlation (`rank`) and RMS error (`error`) of ratios to the base
    answer, judged : sentences about the recommended triangulator, and about the best criterion
    """

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
    """A case: index of its group, its row of summary.csv, and counters of the sampled polygons."""

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
    environment: list[tuple[str, str, str]]
    key_facts: list[tuple[str, str]]
    warnings: list[str]


def make_content(run: Run, decided: Sequence[Decided] | None = None) -> Content:
    """Return the content of the report of `run`; decided : `decide_run(run)` if already known."""
    # The most useful groups first: timed GPUs, other timed devices, the rest as measured.
    position = {id(record): number for number, record in enumerate(run.records)}
    decided = sorted(
        decide_run(run) if decided is None else decided,
        key=lambda pair: (
            _get_display_key(pair[0]),
            min(position[id(record)] for record in pair[0].records),
        ),
    )
    polygons = _Polygons(run, [group for group, _ in decided])
    names = _list_triangulators(run)
    metrics = find_metrics(run.records)
    scenes = [run.facts.get("scene", {}).get("name"), *(r.id.scene for r in run.records[:1])]
    groups: list[GroupContent] = []
    cases: list[CaseContent] = []
    for number, (group, decision) in enumerate(decided):
        groups.append(_make_group(group, decision, polygons))
        cases += [_make_case(number, record, decision, polygons) for record in group.records]
    study = read_study_matrices(run.folder)
    return {
        "name": next(filter(None, scenes), run.path.name),
        "figures": {
            name: {field: getattr(metric, field) for field in METRIC_FIELDS}
            | {"percent": "%}" in metric.form}
            for name, metric in (metrics | {name: find_metric(name) for name in ESTIMATES}).items()
        },
        "criteria": [name for name, metric in metrics.items() if metric.kind == "prediction"],
        "estimates": {name: estimate.measure for name, estimate in ESTIMATES.items()},
        "measures": list_costs(metrics, of_order=True),
        "triangulators": names,
        "looks": {name: asdict(look) for name, look in choose_looks(names).items()},
        "groups": groups,
        "cases": cases,
        "views": polygons.views,
        "matrices": study or make_run_matrices(groups),
        "study": format_best_criterion_of_study(study),
        "environment": list_facts(run),
        "key_facts": list_key_facts(run),
        "warnings": [*run.facts.get("warnings", []), *get_run_state(run).warnings, *run.problems],
    }


class _Polygons:
    """Per-polygon columns of the run's cases, and the content of views made from them."""

    def __init__(self, run: Run, groups: Sequence[RecordGroup]) -> None:
        self.run = run
        self.views: dict[str, ViewContent] = {}
        cases = sum(len(group.measured) for group in groups)
        share = MAX_VALUES // max(1, 8 * cases)  # a case has about eight columns
        widest = max((len(group.records) for group in groups), default=1)
        self._max = max(MIN_POLYGONS, min(share, MAX_MARKS // widest))
        self._samples: dict[str, NDArray[np.int64]] = {}

    def read_case(self, record: Record) -> Columns | None:
        """Return a case's columns; add the case's predictions, and its view if new, to `views`."""
        columns = read_columns(self.run, record) if record.is_ok else None
        if columns is None:
            return None
        view = get_view_file_stem(record.id.view)
        if view not in self._samples:
            self._add_view(view, record, len(columns[f"{PREDICTED}triangles"]))
        predicted = self.views[view]["predicted"]
        if record.name not in predicted:
            sample = self._samples[view]
            predicted[record.name] = {
                name.removeprefix(PREDICTED): list(map(_round_number, column[sample].tolist()))
                for name, column in columns.items()
                if name.startswith(PREDICTED)
            }
        return columns

    def _add_view(self, name: str, record: Record, polygons: int) -> None:
        sample = self._samples[name] = choose_sample(polygons, self._max)
        view: ViewContent = {
            "polygons": polygons,
            "sampled": sample.tolist(),
            "predicted": {},
            "drawing": None,
        }
        geometry = read_geometry(self.run, record.id.view)
        if geometry is not None and len(geometry.grid) == polygons:
            share = len(sample) / max(1, polygons)
            triangles = sum(len(rows) for rows in geometry.triangles.values())
            if triangles * share <= MAX_TRIANGLES / (1 + len(self.views)):
                view["drawing"] = pack_drawing(geometry, sample)
        self.views[name] = view

    def sample_counters(self, record: Record, columns: Columns) -> dict[str, list[int]]:
        """Return a case's counters of the polygons that are sampled in the case's view."""
        sample = self._samples[get_view_file_stem(record.id.view)]
        return {name: columns[name][sample].astype(int).tolist() for name in list_costs(columns)}


def _make_group(group: RecordGroup, decision: Decision | None, polygons: _Polygons) -> GroupContent:
    """Return the content of cases that differ in the triangulator alone; add their view."""
    columns = {
        record.name: values
        for record in group.records
        if (values := polygons.read_case(record)) is not None
    }
    base = group.base
    base_name = base.name if base is not None else next(iter(columns), None)
    counted = list_costs(columns[base_name]) if base_name in columns else []
    correlations = {
        measure: {
            criterion: _round_number(compute_rank_correlation(*pairs))
            for criterion in list_predictions()
            if base_name and f"{PREDICTED}{criterion}" in columns[base_name]
            for pairs in [pair_ratios(columns, base_name, criterion, measure)]
        }
        for measure in counted
        if base_name is not None
    }
    # A single polygon has no columns; the record has the counters.
    totals = list_costs((base or group.records[0]).counters)
    main = next(iter([*counted, *totals]), None)
    spread = matrix.read_spread(polygons.run, group.id.view) if main in MEASURES else None
    return {
        "scene": group.id.scene,
        "rasteriser": group.id.rasteriser,
        "device": group.id.device_name,
        "view": get_view_file_stem(group.id.view),
        "condition": group.id.condition,
        "base": base_name,
        "measures": counted,
        "main": main,
        "correlations": correlations,
        "estimated": {
            name: {
                "rank": _round_number(compute_rank_correlation(*pairs)),
                "error": _round_number(compute_rms_error(*pairs)),
            }
            for name, estimate in ESTIMATES.items()
            if estimate.measure in counted and base_name
            for pairs in [pair_ratios(columns, base_name, name, estimate.measure)]
        },
        "answer": format_advice(decision),
        "judged": format_best_criterion(main, correlations, spread),
        "views": describe_views(group),
    }


def _make_case(
    number: int, record: Record, decision: Decision | None, polygons: _Polygons
) -> CaseContent:
    row = make_row(record, decision) | {"polygons": record.polygons}
    predicted: dict[str, Any] = {PREDICTED + name: v for name, v in record.predicted.items()}
    predicted |= compute_estimates(predicted, PREDICTED)
    columns = polygons.read_case(record)
    standings = enumerate(decision.standings if decision else (), start=1)
    rank, complete = next(
        ((rank, s.complete) for rank, s in standings if s.record is record), (None, False)
    )
    return {
        "group": number,
        "row": {name: _round_number(value) for name, value in (row | predicted).items()},
        "rank": rank,
        "complete": complete,
        "warnings": list(record.time.warnings) if record.time else [],
        "counted": None if columns is None else polygons.sample_counters(record, columns),
    }


def _get_display_key(group: RecordGroup) -> tuple[bool, bool, bool]:
    """Return a sort key: timed GPUs first, then timed opengl devices, then other timed devices."""
    timed = any(record.time for record in group.measured)
    is_gpu, is_main = group.id.device.startswith("gpu"), group.id.rasteriser == "opengl"
    return not (timed and is_gpu), not (timed and is_main), not timed


def _list_triangulators(run: Run) -> list[str]:
    planned = run.facts.get("plan", {}).get("triangulators", [])
    measured = dict.fromkeys(record.name for record in run.records)
    return list(dict.fromkeys([*(name for name in planned if name in measured), *measured]))


def _round_number(value: Any) -> Any:
    """Return a value rounded to 7 significant digits; NaN and infinity become None."""
    if isinstance(value, float):
        return float(f"{value:.7g}") if math.isfinite(value) else None
    return value


def choose_sample(polygons: int, limit: int) -> NDArray[np.int64]:
    """Return sorted indices of at most `limit` polygons: all, or a fixed random sample."""
    sample = np.random.default_rng(0).choice(polygons, min(polygons, limit), replace=False)
    return np.sort(sample).astype(np.int64)


def pack_drawing(geometry: Geometry, numbers: NDArray[np.int64]) -> Drawing:
    """Return points and triangles of the polygons `numbers`, JSON-ready.

    `points` is base64 of int32 x, y in 1/256 px, y up, polygon by polygon; `rows` of uint32
    indices, from 0 in each polygon; `sizes` and `counts` are numbers of vertices and triangles.
    """
    offsets = geometry.grid.vertex_offsets
    starts, sizes = offsets[numbers], geometry.grid.vertex_counts[numbers]
    vertices = concatenate_ranges(starts, sizes)
    packed: Drawing = {
        "points": encode_array(geometry.points[vertices].astype("<i4")),
        "sizes": sizes.tolist(),
        "source": geometry.source[numbers].tolist(),
        "triangles": {},
    }
    for name, triangles in geometry.triangles.items():
        owner = np.searchsorted(offsets, triangles[:, 0], side="right") - 1
        first = np.searchsorted(owner, numbers, side="left")
        counts = np.searchsorted(owner, numbers, side="right") - first
        rows = triangles[concatenate_ranges(first, counts)] - np.repeat(starts, counts)[:, None]
        packed["triangles"][name] = {
            "counts": counts.tolist(),
            "rows": encode_array(rows.astype("<u4")),
        }
    return packed


def list_facts(run: Run) -> list[tuple[str, str, str]]:
    """Return all facts of `run.json` as (section, name, value), flattened."""
    facts: Mapping[str, Any] = {**run.facts}
    names = ("created", "schema_version", "interrupted", "resumed")
    rows = [("run", name, _format_value(facts[name])) for name in names if name in facts]
    for section in ("scene", "environment", "cpu", "state", "plan", "devices", "frames", "seconds"):
        values = facts.get(section)
        if isinstance(values, list):
            values = {str(number): value for number, value in enumerate(values)}
        if isinstance(values, dict):
            rows += [(section, name, _format_value(v)) for name, v in flatten(values).items()]
    return rows


def list_key_facts(run: Run) -> list[tuple[str, str]]:
    """Return (name, value) of the facts that affect times most, and of the run's origin."""
    machine = run.facts.get("environment") or {}
    scene = run.facts.get("scene") or {}
    rows = [("processor", read_processor(run.facts)), ("system", machine.get("kernel"))]
    for label, device in (run.facts.get("devices") or {}).items():
        details = device.get("details") or {}
        timer = (device.get("timer") or {}).get("timer", "not timed")
        names = [details.get("renderer"), details.get("version"), f"timer: {timer}"]
        rows.append((label, ", ".join(str(name) for name in names if name)))
    gpus = machine.get("gpus") or []
    rows += [("GPU", ", ".join(str(value) for value in gpu.values())) for gpu in gpus]
    if scene:
        size = f"{scene.get('polygons', 0):,} polygons; {scene.get('licence', '')}"
        rows.append(("scene", f"{scene.get('description') or scene.get('name')}: {size}"))
    rows.append(("commit", get_commit(run.facts)))
    harness = f"{machine.get('harness', '')} {get_commit(run.facts, 'git')}"
    rows.append(("harness", harness.strip()))
    rows.append(("command", " ".join(map(str, machine.get("command") or []))))
    return [(name, str(value)) for name, value in rows if value]


def _format_value(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
