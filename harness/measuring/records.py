"""Records of cases, and a file of this machine's fastest reference draws."""

import json
import math
import os
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness import atomic
from harness.frame import Frame
from harness.machine import system
from harness.machine.environment import describe_processor
from harness.measuring.timing import EMPTY, REFERENCE, TimerTest, Times
from harness.metrics.registry import MIN_QUADS, OUTLINE
from harness.metrics.run_quality import find_undisturbed
from harness.progress import Reporter
from harness.rasterisers.base import Counters
from harness.results.parsing import identify_rounds
from harness.results.record import (
    CaseId,
    LeastQuads,
    Record,
    RunFacts,
    Time,
    ViewCounters,
)
from harness.results.run_writer import RunFolder
from harness.settings import TimingSettings
from harness.triangulating.recipes import Recipe
from harness.triangulating.triangulate import FrameTriangulation

SHORT_DRAW_S = 20e-6  # duration of a draw below which the cost of the draw call dominates

MAX_SCATTER = 0.10  # maximum interquartile range, relative to the median, without a warning

Columns = Mapping[str, NDArray[Any]]  # values per polygon, (p,), by name


class RunWriter:
    """Stores frames, triangulations and records of a run, and reports finished cases.

    stores : the run's folder and, with an interleaved baseline, the folder of the baseline's run
    """

    def __init__(
        self,
        stores: Sequence[RunFolder],
        records: dict[str, Record],
        reporter: Reporter,
        *,
        with_drawings: bool,
    ) -> None:
        self.frames: list[dict[str, Any]] = []
        self._stores = stores
        self.records = records
        self._reporter = reporter
        self._with_drawings = with_drawings

    def write_facts(self, facts: RunFacts) -> None:
        """Replace `run.json` of the run and, if any, of the baseline's run."""
        head, *base_stores = self._stores
        head.write_facts(facts)
        for store in base_stores:
            baseline, environment = facts["beside"], dict(facts["environment"])
            project = {**(environment.get("project") or {}), "commit": baseline["commit"]}
            environment["project"] = {**project, "dirty": False} if baseline["commit"] else None
            beside = {**baseline, "is_base": True}
            store.write_facts({**facts, "environment": environment, "beside": beside})

    def add_frame(self, frame: Frame) -> None:
        """Add the facts of a frame, such as polygons changed by snapping, to `frames`."""
        size = {"polygons": len(frame.source), "vertices": len(frame.points)}
        broken = {"dropped": frame.dropped, "repaired": frame.repaired}
        self.frames.append({**asdict(frame.view), "scale": frame.scale, **size, **broken})

    def add_triangulations(self, frame: Frame, triangles: dict[Recipe, NDArray[np.int32]]) -> None:
        """Store a frame and its triangles (m, 3) by recipe, if `with_drawings`."""
        if not self._with_drawings:
            return
        for store, is_base in zip(self._stores, (False, True), strict=False):
            by_name = {
                str(replace(recipe, other=False)): rows
                for recipe, rows in triangles.items()
                if recipe.other == is_base
            }
            store.write_geometry(frame, by_name)

    def add_counted(self, record: Record, columns: Columns | None) -> None:
        """Store a record without time, for a run that resumes this one."""
        self._store_columns(record, columns)
        self._stores[0].append_counted(replace(record, status="counted"))

    def add_finished(self, record: Record, columns: Columns | None = None) -> None:
        """Store and report a record."""
        store, stored = self._store_columns(record, columns)
        store.append(stored)
        self.records[record.id.key] = record
        self._reporter.detail(_format_record(record))
        if record.status == "failed":
            self._reporter.warn(f"{record.name} on {record.id.device} failed: {record.reason}")

    def _store_columns(self, record: Record, columns: Columns | None) -> tuple[RunFolder, Record]:
        """Store the values per polygon; return the record's folder, and the record to store."""
        store = self._stores[0]
        if record.id.version:
            store = self._stores[1]
            record = replace(record, id=replace(record.id, version=""), key="")
        if columns is not None:
            store.write_arrays(record.key, columns)
        return store, record


def _format_record(record: Record) -> str:
    case, time = record.id, record.time
    view = f"{case.view.resolution} px, {case.view.rotation:g} degrees"
    result = record.reason or "counted"
    if time is not None and time.median_s is not None:
        result = f"{time.median_s * 1e3:.4g} ms"
    subject = f"{case.scene}, {view}: {record.name}, {case.rasteriser} on {case.device}"
    return f"{subject}: {record.status}, {result}"


def get_covered_fragments(counters: Counters, drawn: NDArray[np.bool_]) -> NDArray[np.int64] | None:
    """Return the fragments (p,) that each polygon covers, -1 if unknown; None if not counted.

    They are equal in all triangulations that use every vertex.
    """
    fragments = counters.get("fragments")
    if fragments is None or not fragments.ndim:
        return None
    return np.where(drawn, fragments, -1)


def make_counted_record(
    case: CaseId,
    frame: Frame,
    triangulation: FrameTriangulation,
    counters: Counters,
    covered: NDArray[np.int64] | None,
    limits: Mapping[str, NDArray[np.int64]],
) -> Record:
    """Return the record of a counted case, without time.

    covered : fragments (p,) that a triangulation must have; limits : lower bounds of quads, (p,)
    by name; both are -1 if unknown
    """
    parts = [part for part in triangulation.parts if part is not None]
    proven, gap = summarise_gaps(triangulation.gaps)
    return Record(
        case,
        "ok",
        describe_missing(triangulation),
        polygons=len(parts),
        polygons_skipped=len(triangulation.skipped),
        polygons_failed=len(triangulation.failed),
        vertices=len(frame.points),
        triangles=sum(len(part) for part in parts),
        predicted={name: float(values.sum()) for name, values in triangulation.predicted.items()},
        counters={name: int(values.sum()) for name, values in counters.items()},
        triangulate_s=triangulation.seconds,
        triangulate_samples_s=_round_seconds(triangulation.samples_s),
        polygons_cached=triangulation.cached,
        conforming=triangulation.conforming,
        t_junctions=sum(triangulation.t_junctions),
        proven=proven,
        largest_gap=gap,
        coverage_error=_compute_coverage_error(triangulation, counters, covered),
        outline_quads=_sum_outline_quads(triangulation.drawn, limits.get(OUTLINE)),
        least=_sum_least_quads(triangulation.drawn, counters, limits.get(MIN_QUADS)),
        views=_sum_counters_per_view(frame, counters),
    )


def summarise_gaps(gaps: Sequence[float]) -> tuple[int | None, float | None]:
    """Return the number of proven optima, and the largest gap (None if infinite)."""
    if not gaps:
        return None, None
    largest = max(gaps)
    return sum(gap == 0.0 for gap in gaps), largest if math.isfinite(largest) else None


def _compute_coverage_error(
    triangulation: FrameTriangulation, counters: Counters, covered: NDArray[np.int64] | None
) -> int | None:
    """Return the sum of |fragments - covered| over polygons with known `covered`, if any."""
    if covered is None or "fragments" not in counters:
        return None
    compared = triangulation.drawn & (covered >= 0)
    if not compared.any():
        return None
    return int(np.abs(counters["fragments"] - covered)[compared].sum())


def _sum_counters_per_view(frame: Frame, counters: Counters) -> ViewCounters | None:
    """Return each counter's sum in each tile or view, or None without tiles and views."""
    if frame.tiles is None:
        return None
    sums = {
        name: tuple(np.diff(np.concatenate([[0], np.cumsum(values)])[frame.tiles]).tolist())
        for name, values in counters.items()
        if values.ndim
    }
    return ViewCounters(sums, () if frame.viewing is None else tuple(frame.viewing.names))


def _sum_outline_quads(drawn: NDArray[np.bool_], outline: NDArray[np.int64] | None) -> int | None:
    """Return the sum of quads (p,) over `drawn` polygons, or None if any is -1."""
    if outline is None or (outline[drawn] < 0).any():
        return None
    return int(outline[drawn].sum())


def _sum_least_quads(
    drawn: NDArray[np.bool_], counters: Counters, minima: NDArray[np.int64] | None
) -> LeastQuads | None:
    """Return sums over the `drawn` polygons whose minimum quads, (p,), are not -1."""
    quads, fragments = counters.get("quads"), counters.get("fragments")
    if minima is None or quads is None or fragments is None or not (quads.ndim and fragments.ndim):
        return None
    has_minimum = drawn & (minima >= 0)
    sums = (int(values[has_minimum].sum()) for values in (minima, quads, fragments))
    return LeastQuads(int(has_minimum.sum()), *sums)


def describe_missing(triangulation: FrameTriangulation) -> str | None:
    """Return a line about skipped and failed polygons, or None if all have triangles."""
    notes = []
    for verb, entries in (("skipped", triangulation.skipped), ("failed", triangulation.failed)):
        if entries:
            number, reason = entries[0]
            more = f" and {len(entries) - 1} more" if len(entries) > 1 else ""
            notes.append(f"{verb} polygon {number}{more}: {reason}")
    return "; ".join(notes) or None


def make_time(
    group: Mapping[str, Times], key: str, test: TimerTest, settings: TimingSettings
) -> Time:
    """Return the `time` of a record: the times of the drawing `key` in a group timed together."""
    times, reference = group[key], _round_seconds(group[REFERENCE].samples_s)
    return replace(
        make_time_without_median(times, test.timer),
        median_s=times.median_s,
        ci95_s=times.ci95_s,
        repeats=times.repeats,
        epochs=tuple(times.epochs),
        precision=settings.precision,
        precision_reached=times.precision_reached,
        empty_s=_round_seconds(group[EMPTY].samples_s),
        reference_s=reference,
        round_group=identify_rounds(reference),
        warnings=tuple(list_time_warnings(times)),
    )


def make_time_without_median(times: Times, timer: str) -> Time:
    """Return a `Time` of the samples, and of waiting and other load for the CPU timer."""
    samples, processes = _round_seconds(times.samples_s), tuple(times.processes or ())
    if not times.wall_s:
        return Time(timer, samples, processes=processes)
    time = Time(
        timer,
        samples,
        wall_s=_round_seconds(times.wall_s),
        stolen_s=times.stolen_s,
        others_s=times.others_s,
        timing_s=times.timing_s,
        processes=processes,
    )
    if len(times.waited_s) != len(samples):
        return time
    time = replace(time, waited_s=_round_seconds(times.waited_s))
    return replace(time, disturbed=int((~find_undisturbed(time)).sum()))


def _round_seconds(seconds: Sequence[float]) -> tuple[float, ...]:
    """Round to six digits, which exceed any timer's resolution and halve the size on disk."""
    return tuple(float(f"{value:.6g}") for value in seconds)


def list_time_warnings(times: Times) -> list[str]:
    """Return warnings about the samples, a line each."""
    warnings = []
    median = times.median_s
    low, high = np.percentile(times.undisturbed_s, [25, 75])
    if median < SHORT_DRAW_S:
        warnings.append(f"draws are short ({median * 1e6:.1f} us): mostly the cost of a draw call")
    if high - low > MAX_SCATTER * median:
        warnings.append(f"times scatter by {(high - low) / median:.0%} of their median")
    if not times.precision_reached:
        warnings.append(f"precision not reached in {len(times.samples_s)} rounds")
    return warnings


FILE = "reference-draws.json"


class DrawId(NamedTuple):
    """Conditions, other than the machine, that determine a reference draw's time."""

    rasteriser: str
    device: str
    resolution: int
    samples: int
    work: int
    timer: str


def get_default_path() -> Path:
    """Return the path of the file, next to the cache of triangulations."""
    return system.get_cache_file(FILE)


def update_reference_draws(records: Iterable[Record], path: Path) -> list[dict[str, Any]]:
    """Add a run's reference draws (of a half-viewport triangle) to a file; compare earlier runs.

    Returns for each `DrawId` its fields and: `reference_s`, the run's median; `best_s`, the minimum
    of the medians of all `runs` on this machine; `slower`, their ratio.
    """
    times: dict[DrawId, dict[str, tuple[float, ...]]] = {}
    for record in records:
        case, options = record.id, record.id.options
        # With a texture the reference draw is slower, and a `DrawId` does not have this condition.
        if (time := record.time) is not None and time.reference_s and not options.texture:
            conditions = (case.view.resolution, options.samples, options.work, time.timer)
            draw = DrawId(case.rasteriser, case.device_name, *conditions)
            times.setdefault(draw, {})[time.round_group] = time.reference_s
    draws = {
        draw: statistics.median(second for group in groups.values() for second in group)
        for draw, groups in times.items()
    }
    best = _update_file(draws, path)
    return [
        {
            **draw._asdict(),
            "reference_s": second,
            "best_s": best[draw][0],
            "runs": best[draw][1],
            "slower": second / best[draw][0],
        }
        for draw, second in draws.items()
    ]


def _update_file(draws: Mapping[DrawId, float], path: Path) -> dict[DrawId, tuple[float, int]]:
    """Add the median times (s) to the file; return each draw's minimum (s) and number of runs.

    An unreadable file is replaced; an unwritable one is ignored, as only a warning needs the file.
    """
    machine = f"{describe_processor()['label']}, {os.cpu_count()} threads"
    names = {draw: json.dumps([machine, *draw]) for draw in draws}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.with_suffix(".lock").open("a") as stream:
            system.lock_file(stream.fileno())
            stored = _read(path)
            for draw, second in draws.items():
                best, runs = stored.get(names[draw], (second, 0))
                stored[names[draw]] = (min(best, second), runs + 1)
            atomic.write(path, json.dumps(stored, indent=1).encode())
    except OSError:
        stored = _read(path)
    return {draw: stored.get(names[draw], (second, 1)) for draw, second in draws.items()}


def _read(path: Path) -> dict[str, tuple[float, int]]:
    """Return the valid entries: (minimum in s, number of runs) by machine and draw."""
    try:
        content = json.loads(path.read_bytes())
        return {
            name: (float(best), int(runs))
            for name, (best, runs) in content.items()
            if 0 < best < math.inf and runs >= 1
        }
    except (OSError, ValueError, TypeError, AttributeError):
        return {}
