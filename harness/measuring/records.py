"""The record of a case: made of what was predicted, counted and timed, told, and kept."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.measuring.other_version import facts_of_base
from harness.measuring.plan import Case
from harness.measuring.timing import EMPTY, REFERENCE, TimerTest, Times
from harness.metrics.per_view import NAMES, VIEWS
from harness.metrics.registry import LEAST, OUTLINE
from harness.progress import Reporter
from harness.rasterisers.base import Counters
from harness.results import drawings
from harness.results.run_folder import Record, Store
from harness.settings import TimingSettings
from harness.stats.run_quality import undisturbed
from harness.triangulating.recipes import OTHER
from harness.triangulating.result import FrameTriangulation

SHORT_DRAW_S = 20e-6
"""A draw shorter than this is mostly the cost of asking for it."""

SCATTER = 0.10
"""Interquartile range, relative to the median, above which a machine is called unstable."""


Columns = Mapping[str, NDArray[Any]]
"""Figures of each polygon, (p,) each."""


class Keeper:
    """Stores what is found, and adds it to the run's records and frames.

    stores : the run's folder, and where two versions are measured that of the other one's run, in
        which its triangulators have their own names
    records : of finished cases, by key
    drawings_too : whether what was drawn is stored, too
    """

    def __init__(
        self,
        stores: Sequence[Store],
        records: dict[str, Record],
        reporter: Reporter,
        *,
        drawings_too: bool,
    ) -> None:
        self.frames: list[dict[str, Any]] = []
        self._stores = stores
        self.records = records
        self._reporter = reporter
        self._drawings_too = drawings_too

    def write_facts(self, facts: dict[str, Any]) -> None:
        """Replace what the folders tell of the run."""
        for store, told in zip(self._stores, (facts, None), strict=False):
            store.write_facts(told or facts_of_base(facts))

    def framed(self, frame: Frame) -> None:
        """Note what snapping to the grid did to the scene."""
        size = {"polygons": len(frame.source), "vertices": len(frame.points)}
        broken = {"dropped": frame.dropped, "repaired": frame.repaired}
        self.frames.append({**asdict(frame.view), "scale": frame.scale, **size, **broken})

    def triangulated(self, frame: Frame, triangles: dict[str, NDArray[np.int32]]) -> None:
        """Store what will be drawn."""
        if not self._drawings_too:
            return
        for store, of_other in zip(self._stores, (False, True), strict=False):
            own = {
                name.removeprefix(OTHER): rows
                for name, rows in triangles.items()
                if name.startswith(OTHER) == of_other
            }
            drawings.write(store, frame, own)

    def counted(self, record: Record, columns: Columns | None) -> None:
        """Store a record that lacks its time, so that a run that goes on need not count again."""
        self._placed(record, columns)
        self._stores[0].append_counted({**record, "status": "counted"})

    def finished(self, record: Record, columns: Columns | None = None) -> None:
        """Store a record, and tell the user if it failed."""
        store, own = self._placed(record, columns)
        store.append(own)
        self.records[record["key"]] = record
        self._reporter.detail(_in_short(record))
        if record["status"] == "failed":
            self._reporter.warn(
                f"{record['triangulator']} on {record['device']} failed: {record['reason']}"
            )

    def _placed(self, record: Record, columns: Columns | None) -> tuple[Store, Record]:
        """Store a case's columns; return the folder that it belongs in, and its record there."""
        store, name = self._stores[0], record["triangulator"]
        if name.startswith(OTHER):
            own = Case.of({**record, "triangulator": name.removeprefix(OTHER)})
            store, record = self._stores[1], {**record, **own.identity()}
        if columns is not None:
            store.write_arrays(record["key"], columns)
        return store, record


def _in_short(record: Record) -> str:
    view = f"{record['resolution']} px, {record['rotation']:g} degrees"
    where = f"{record['scene']}, {view}: {record['triangulator']}, {record['rasteriser']}"
    time = record.get("time")
    result = record["reason"] or "counted"
    if time:
        result = f"{time['median_s'] * 1e3:.4g} ms"
    return f"{where} on {record['device']}: {record['status']}, {result}"


def covered(counters: Counters, drawn: NDArray[np.bool_]) -> NDArray[np.int64] | None:
    """Return the fragments of each polygon that the baseline drew, (p,), -1 of the others.

    None where the device cannot say. However a polygon is triangulated, it covers as many.
    """
    fragments = counters.get("fragments")
    if fragments is None or not fragments.ndim:
        return None
    return np.where(drawn, fragments, -1)


def problem(case: Case, status: str, reason: str) -> Record:
    """Return the record of a case that was `skipped` or `failed`, and why."""
    return {**case.identity(), "status": status, "reason": reason}


def measured(
    case: Case,
    frame: Frame,
    triangulation: FrameTriangulation,
    counters: Counters,
    covered: NDArray[np.int64] | None,
    limits: Mapping[str, NDArray[np.int64]],
) -> Record:
    """Return the record of a case that was counted; its time is not in it yet.

    covered : what each polygon covers, as `covered` returns it
    limits : `OUTLINE` and `LEAST`, each (p,) quads a polygon, -1 where that is not known
    """
    done = [part for part in triangulation.parts if part is not None]
    again = triangulation.samples_s
    record: Record = {
        **case.identity(),
        "status": "ok",
        "reason": incomplete(triangulation),
        "polygons": len(done),
        "polygons_skipped": len(triangulation.skipped),
        "polygons_failed": len(triangulation.failed),
        "vertices": len(frame.points),
        "triangles": sum(len(part) for part in done),
        "predicted": {name: float(each.sum()) for name, each in triangulation.predicted.items()},
        "counters": {name: int(values.sum()) for name, values in counters.items()},
        "triangulate_s": triangulation.seconds,
        **({"triangulate_samples_s": _rounded(again)} if again else {}),
        "polygons_cached": triangulation.cached,
        "conforming": triangulation.conforming,
        "t_junctions": sum(triangulation.t_junctions),
        **proven_of(triangulation.gaps),
        "coverage_error": None,
        OUTLINE: _outline_of(triangulation.drawn, limits.get(OUTLINE)),
        **_least_of(triangulation.drawn, counters, limits.get(LEAST)),
        **_views_of(frame, counters),
    }
    if covered is not None and "fragments" in counters:
        compared = triangulation.drawn & (covered >= 0)
        if compared.any():
            wrong = np.abs(counters["fragments"] - covered)[compared]
            record["coverage_error"] = int(wrong.sum())
    return record


def _views_of(frame: Frame, counters: Counters) -> Record:
    """Return the sums of each counter a tile, or a view of a model."""
    if frame.tiles is None:
        return {}
    sums = {
        name: np.diff(np.concatenate([[0], np.cumsum(values)])[frame.tiles]).tolist()
        for name, values in counters.items()
        if values.ndim
    }
    names = {} if frame.viewing is None else {NAMES: list(frame.viewing.names)}
    return {VIEWS: {**names, **sums}}


def _outline_of(drawn: NDArray[np.bool_], outline: NDArray[np.int64] | None) -> int | None:
    """Return the quads of the outlines of what was drawn; None unless all of them are known."""
    if outline is None or (outline[drawn] < 0).any():
        return None
    return int(outline[drawn].sum())


def _least_of(
    drawn: NDArray[np.bool_], counters: Counters, least: NDArray[np.int64] | None
) -> Record:
    """Return the fewest quads of what was drawn beside its own, where both are known."""
    quads, fragments = counters.get("quads"), counters.get("fragments")
    if least is None or quads is None or fragments is None or not (quads.ndim and fragments.ndim):
        return {}
    known = drawn & (least >= 0)
    named = {"quads": least, "shaded": quads, "fragments": fragments}
    sums = {name: int(values[known].sum()) for name, values in named.items()}
    return {LEAST: {"polygons": int(known.sum()), **sums}}


def proven_of(gaps: Sequence[float]) -> Record:
    """Return how many polygons are proven optimal, and the largest gap of the others.

    The gap is None where a polygon has no bound; nothing where the triangulator is no optimum.
    """
    if not gaps:
        return {}
    largest = max(gaps)
    return {
        "proven": sum(gap == 0.0 for gap in gaps),
        "largest_gap": largest if math.isfinite(largest) else None,
    }


def incomplete(triangulation: FrameTriangulation) -> str | None:
    """Say in one line which polygons a triangulator left out, or None if it did all."""
    notes = []
    for verb, entries in (("skipped", triangulation.skipped), ("failed", triangulation.failed)):
        if entries:
            number, reason = entries[0]
            more = f" and {len(entries) - 1} more" if len(entries) > 1 else ""
            notes.append(f"{verb} polygon {number}{more}: {reason}")
    return "; ".join(notes) or None


def time_fields(
    group: Mapping[str, Times], key: str, test: TimerTest, settings: TimingSettings
) -> dict[str, Any]:
    """Return a record's `time` for the drawing `key` of a group timed together.

    Sample r of every record of the group, and of its `empty_s` and `reference_s`, comes from the
    same round, so records can be compared in pairs.
    """
    times = group[key]
    return {
        "timer": test.timer,
        "samples_s": _rounded(times.samples_s),
        **waiting_of(times),
        "median_s": times.median_s,
        "ci95_s": list(times.ci95_s),
        "repeats": times.repeats,
        "epochs": times.epochs,
        **({"processes": times.processes} if times.processes else {}),
        "precision": settings.precision,
        "precision_reached": times.precision_reached,
        "empty_s": _rounded(group[EMPTY].samples_s),
        "reference_s": _rounded(group[REFERENCE].samples_s),
        "warnings": time_warnings(times),
    }


def waiting_of(times: Times) -> dict[str, Any]:
    """Return what is kept beside CPU time: the wall clock, waiting, and how many samples waited."""
    if not times.wall_s:
        return {}
    found: dict[str, Any] = {"wall_s": _rounded(times.wall_s)}
    if len(times.waited_s) == len(times.samples_s):
        found["waited_s"] = _rounded(times.waited_s)
        found["disturbed"] = int((~undisturbed({**found, "samples_s": times.samples_s})).sum())
    told = {name: getattr(times, name) for name in ("stolen_s", "others_s", "timing_s")}
    return {**found, **told}


def _rounded(seconds: Sequence[float]) -> list[float]:
    """Round to six digits: more than any timer resolves, and half the size on disk."""
    return [float(f"{value:.6g}") for value in seconds]


def time_warnings(times: Times) -> list[str]:
    """Say, a line each, what makes these samples less trustworthy."""
    found = []
    median = times.median_s
    low, high = np.percentile(times.undisturbed_s, [25, 75])
    if median < SHORT_DRAW_S:
        found.append(f"draws are short ({median * 1e6:.1f} us): mostly the cost of a draw call")
    if high - low > SCATTER * median:
        found.append(f"times scatter by {(high - low) / median:.0%} of their median")
    if not times.precision_reached:
        found.append(f"precision not reached in {len(times.samples_s)} rounds")
    return found
