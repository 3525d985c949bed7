"""What the report of a run shows, as plain values."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.machine.git import commit_of
from harness.metrics import per_view
from harness.metrics.decision import Decision, Standing, advice, decide
from harness.metrics.groups import base_of, condition, groups
from harness.metrics.per_polygon import (
    Columns,
    columns_of,
    error_of,
    rank_correlation,
    ratio_pairs,
)
from harness.metrics.registry import PREDICTED, Figure, figures_of, find, measures, predictions
from harness.rasterisers.counters import ESTIMATES, compute_estimates
from harness.report import matrix
from harness.report.matrix import answer_of_study, criteria_of, from_run, from_study
from harness.results import drawings
from harness.results.drawings import Geometry, view_of
from harness.results.processors import processor_label
from harness.results.run_folder import Record, Run
from harness.results.schema import flat
from harness.stats.run_quality import state_of
from harness.study.subjects import MEASURES
from harness.style import looks
from harness.summary import row_of
from harness.webpages import encoded
from triangulators.polygon_arrays import ranges

MOST_MARKS = 6_000
"""Marks of one chart: a polygon under one triangulator each."""

MOST_VALUES = 600_000
"""Per-polygon numbers that one report carries."""

FEWEST_POLYGONS = 12

MOST_TRIANGLES = 1_500_000
"""Triangles that one report carries for its heatmaps, over all triangulators and views."""

Content = dict[str, Any]


def content_of(run: Run) -> Content:
    """Return everything the report of `run` shows, JSON-ready."""
    # The oldest runs do not say how many polygons they drew.
    records = [{**record, "polygons": record.get("polygons") or 0} for record in run.records]
    run = replace(run, records=records)
    found = groups(run.records)
    # A GPU is what most readers ask about, then what was timed; else in the order measured.
    place = {record["key"]: number for number, record in enumerate(run.records)}
    found.sort(key=lambda members: (_interest(members), min(place[r["key"]] for r in members)))
    columns = _Polygons(run, found)
    names = _triangulators(run)
    shown = figures_of(run.records)
    names_of_scene = [run.facts.get("scene", {}).get("name"), *(r["scene"] for r in records[:1])]
    content: Content = {
        "name": next(filter(None, names_of_scene), run.path.name),
        "figures": {
            name: _described(figure)
            for name, figure in (shown | {name: find(name) for name in ESTIMATES}).items()
        },
        "criteria": [name for name, figure in shown.items() if figure.kind == "prediction"],
        "estimates": {name: each.measure for name, each in ESTIMATES.items()},
        "measures": measures(shown),
        "triangulators": names,
        "looks": {name: asdict(each) for name, each in looks(names).items()},
        "groups": [],
        "cases": [],
        "views": columns.views,
    }
    told = []
    for number, members in enumerate(found):
        decision = decide(members)
        group, correlations = _group(members, decision, columns)
        content["groups"].append(group)
        places = enumerate(decision.standings if decision else (), start=1)
        ranked = {each.record["key"]: (place, each) for place, each in places}
        content["cases"] += [
            _case(number, record, ranked.get(record["key"]), members, columns) for record in members
        ]
        for measure, values in correlations.items():
            told.append(((group["rasteriser"], group["device"], measure), values, group["view"]))
    folder = run.path if run.path.is_dir() else run.path.parent
    study = from_study(folder)
    first = content["groups"][0]["view"] if content["groups"] else ""
    content["matrices"] = study or from_run(
        (where, values) for where, values, view in told if view == first
    )
    content["study"] = answer_of_study(study)
    content["environment"] = rows(run)
    content["key_facts"] = key_rows(run)
    content["warnings"] = [
        *run.facts.get("warnings", []),
        *state_of(run.facts, run.records).words,
        *run.problems,
    ]
    return content


class _Polygons:
    """Per-polygon columns of the run's cases, and the views that are drawn from them."""

    def __init__(self, run: Run, found: Sequence[Sequence[Record]]) -> None:
        self.run = run
        self.views: dict[str, Content] = {}
        kept = [r for members in found for r in members if r["status"] == "ok"]
        share = MOST_VALUES // max(1, 8 * len(kept))  # a case holds some eight columns
        widest = max((len(members) for members in found), default=1)
        self._most = max(FEWEST_POLYGONS, min(share, MOST_MARKS // widest))
        self._chosen: dict[str, Any] = {}

    def read(self, record: Record) -> Columns | None:
        """Return a case's columns; its view gets its drawings and predictions on the way."""
        columns = columns_of(self.run, record) if record["status"] == "ok" else None
        if columns is None:
            return None
        key = drawings.name_of(view_of(record))
        if key not in self._chosen:
            self._add_view(key, record, len(columns[f"{PREDICTED}triangles"]))
        predicted = self.views[key]["predicted"]
        if record["triangulator"] not in predicted:
            chosen = self._chosen[key]
            predicted[record["triangulator"]] = {
                name.removeprefix(PREDICTED): list(map(_rounded, column[chosen].tolist()))
                for name, column in columns.items()
                if name.startswith(PREDICTED)
            }
        return columns

    def _add_view(self, key: str, record: Record, polygons: int) -> None:
        chosen = self._chosen[key] = choose(polygons, self._most)
        view = {"polygons": polygons, "chosen": chosen.tolist(), "predicted": {}, "drawing": None}
        kept = drawings.read(self.run, view_of(record))
        if kept is not None and len(kept.grid) == polygons:
            share = len(chosen) / max(1, polygons)
            triangles = sum(len(rows) for rows in kept.triangles.values())
            if triangles * share <= MOST_TRIANGLES / (1 + len(self.views)):
                view["drawing"] = pack(kept, chosen)
        self.views[key] = view

    def counted(self, record: Record, columns: Columns) -> Content:
        """Return the counters of the chosen polygons."""
        chosen = self._chosen[drawings.name_of(view_of(record))]
        return {name: columns[name][chosen].astype(int).tolist() for name in measures(columns)}


def _group(
    members: Sequence[Record], decision: Decision | None, polygons: _Polygons
) -> tuple[Content, dict[str, dict[str, float | None]]]:
    """Return what is said of one group, and measure -> criterion -> rank correlation."""
    columns = {
        record["triangulator"]: kept
        for record in members
        if (kept := polygons.read(record)) is not None
    }
    first = members[0]
    base = base_of(members)
    base_name = base["triangulator"] if base is not None else next(iter(columns), None)
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
    # One polygon has no columns of its own: its record's totals are its counters.
    totals = measures((base or first).get("counters") or ())
    main = next(iter([*counted, *totals]), None)
    spread = matrix.read(polygons.run, view_of(first)) if main in MEASURES else None
    return {
        "scene": first["scene"],
        "rasteriser": first["rasteriser"],
        "device": first["device"],
        "view": drawings.name_of(view_of(first)),
        "condition": condition(first),
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
        "views": per_view.said(members),
    }, correlations


def _case(
    number: int,
    record: Record,
    ranked: tuple[int, Standing] | None,
    members: Sequence[Record],
    polygons: _Polygons,
) -> Content:
    row = row_of(record, base_of(members))
    told = record.get("predicted") or {}
    predicted = {PREDICTED + name: value for name, value in told.items()}
    predicted |= compute_estimates(predicted, PREDICTED)
    columns = polygons.read(record)
    return {
        "group": number,
        "row": {name: _rounded(value) for name, value in (row | predicted).items()},
        "rank": ranked[0] if ranked else None,
        "complete": bool(ranked and ranked[1].complete),
        "warnings": (record.get("time") or {}).get("warnings", []),
        "counted": None if columns is None else polygons.counted(record, columns),
    }


def _interest(members: Sequence[Record]) -> tuple[bool, bool, bool]:
    good = [record for record in members if record["status"] == "ok"]
    timed = any(record.get("time") for record in good)
    gpu = any(str(record["device"]).startswith("gpu") for record in good)
    main = any(record["rasteriser"] == "opengl" for record in good)
    return not (gpu and timed), not (main and timed), not timed


def _described(figure: Figure) -> Content:
    names = ("title", "label", "unit", "kind", "better", "description")
    return {name: getattr(figure, name) for name in names} | {"percent": "%}" in figure.form}


def _triangulators(run: Run) -> list[str]:
    """Return the names in the order of the plan, then those that only records have."""
    planned = run.facts.get("plan", {}).get("triangulators", [])
    seen = list(dict.fromkeys(record["triangulator"] for record in run.records))
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


def pack(geometry: Geometry, chosen: NDArray[np.int64]) -> dict[str, Any]:
    """Return the `chosen` polygons' points and triangles, JSON-ready.

    points : base64 of int32 x, y in 1/256 px, y up, polygon by polygon; `sizes` vertices each
    triangles : triangulator -> {"counts", "rows"}: triangles of each polygon, and base64 of
        uint32 indices into that polygon's own points
    """
    offsets = geometry.grid.vertex_offsets
    starts, sizes = offsets[chosen], geometry.grid.vertex_counts[chosen]
    take = ranges(starts, sizes)
    packed = {
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
    known = ("created", "schema_version", "interrupted", "resumed")
    found = [("run", name, _text(run.facts[name])) for name in known if name in run.facts]
    for section in ("scene", "environment", "cpu", "state", "plan", "devices", "frames", "seconds"):
        values = run.facts.get(section)
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
