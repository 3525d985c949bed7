"""Import of a measuring page's result as a run folder; the file is untrusted."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, StringConstraints
from pydantic import model_validator as validator

from harness.errors import IncompatibleRunsError, InputError
from harness.frame import View
from harness.grid import SUBPIXEL
from harness.measuring import records
from harness.measuring.timing import EMPTY, REFERENCE, TimerTest, Times
from harness.metrics.registry import PREDICTED
from harness.page.saved import (
    Count,
    Finite,
    Measured,
    Name,
    NonNegative,
    SavedModel,
    Text,
    check_rounds,
    list_warnings,
)
from harness.page.saved import Times as SavedTimes
from harness.rasterisers.reference import count_per_triangle
from harness.results.parsing import parse_record, record_to_json
from harness.results.record import Record, RunFacts, Time
from harness.results.run_folder import (
    FRAMES,
    Geometry,
    Run,
    get_view_file_stem,
    read_arrays,
    read_geometry,
)
from harness.results.run_writer import RunFolder
from harness.settings import RESOLUTIONS, TimingSettings

FORMAT = "raster-harness device result"
RASTERISER = "webgpu"
CONTROLS = (EMPTY, REFERENCE, "(the base again)")  # timed in addition to the cases


class _Page(SavedModel):
    harness: Text
    scene: Name
    created: Text


class _Record(SavedModel):
    """Fields of a record that do not depend on the device."""

    scene: Name
    scene_hash: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
    triangulator: Name
    resolution: Annotated[int, Field(ge=RESOLUTIONS[0], le=RESOLUTIONS[1])]
    rotation: Finite
    fit: Literal["box", "circle"] = "box"
    reason: Annotated[str, StringConstraints(max_length=10_000)] | None = None
    polygons: Count
    polygons_skipped: Count = 0
    polygons_failed: Count = 0
    vertices: Count
    triangles: Count
    predicted: dict[Name, Finite]
    triangulate_s: NonNegative | None = None
    conforming: bool | None = None
    t_junctions: Count = 0
    proven: Count | None = None
    largest_gap: NonNegative | None = None
    outline_quads: Count | None = None


class _Counters(SavedModel):
    fragments: list[Count]
    quads: list[Count]
    partial_quads: list[Count]
    covering_triangles: list[Count] | None = None

    def to_arrays(self) -> dict[str, NDArray[np.int64]]:
        """Return the counters (p,) by name; results of older pages lack the last counter."""
        return {name: np.array(values, np.int64) for name, values in self if values is not None}


RECORD_FIELDS, COUNTERS = tuple(_Record.model_fields), tuple(_Counters.model_fields)


def count_per_polygon(geometry: Geometry, rows: NDArray[Any]) -> tuple[NDArray[np.int64], ...]:
    """Return the exact `COUNTERS` of each polygon, (p,) each; rows : (m, 3) vertex indices."""
    predicted = count_per_triangle(geometry.points, rows)
    owner = np.searchsorted(geometry.grid.vertex_offsets, rows[:, 0], side="right") - 1
    size = len(geometry.grid)
    return tuple(np.bincount(owner, predicted[name], size).astype(np.int64) for name in COUNTERS)


class _Case(SavedModel):
    record: _Record
    counters: _Counters
    differing: Count

    @validator(mode="after")
    def _check_counters(self) -> Self:
        record = self.record
        polygons = record.polygons + record.polygons_skipped + record.polygons_failed
        counters = self.counters.to_arrays()
        for values in counters.values():
            if len(values) != polygons:
                raise ValueError(f"counters of {len(values)} polygons, expected {polygons}")
        fragments, quads, partial = (counters[name] for name in COUNTERS[:3])
        covering = counters.get(COUNTERS[3], np.sign(fragments))
        if ((quads > fragments) | (4 * quads < fragments)).any():
            raise ValueError("quads of fewer than one pixel, or more than four")
        lanes = 4 * quads - fragments
        if ((partial > lanes) | (lanes > 3 * partial) | (partial > quads)).any():
            raise ValueError("partial quads without a helper lane, or with more than three")
        if ((covering > quads) | ((covering == 0) != (fragments == 0))).any():
            raise ValueError("covering triangles without a quad, or more of them than quads")
        if polygons and not fragments.any():
            raise ValueError("nothing was drawn: all counters are zero")
        if (record.proven or 0) > record.polygons:
            raise ValueError(f"{record.proven} of {record.polygons} polygons proven optimal")
        if record.triangles < record.polygons or record.vertices < 3 * record.polygons:
            raise ValueError("too few triangles or vertices for the polygons")
        return self


class _View(SavedModel):
    resolution: Annotated[int, Field(ge=RESOLUTIONS[0], le=RESOLUTIONS[1])]
    rotation: Finite
    fit: Literal["box", "circle"]
    scene: Name
    cases: dict[Name, _Case]
    times: dict[Name, SavedTimes] | None
    epochs: list[Annotated[int, Field(ge=0)]]

    @validator(mode="after")
    def _check_consistency(self) -> Self:
        for name, case in self.cases.items():
            record = case.record
            if name != record.triangulator or _identify_view(record) != _identify_view(self):
                raise ValueError(f"the record of {name} belongs to a different case")
        cases = self.cases.values()
        if len({(case.record.scene_hash, len(case.counters.quads)) for case in cases}) > 1:
            raise ValueError("cases have different scenes or numbers of polygons")
        times = self.times or {}
        if not set(times) <= {*self.cases, *CONTROLS}:
            raise ValueError("a timed case was not counted")
        check_rounds(times, self.epochs)
        return self


def _identify_view(part: _Record | _View) -> tuple[Any, ...]:
    return part.scene, part.resolution, part.rotation, part.fit


class Result(Measured):
    """Result of a page that measured a run's triangulations."""

    format: Literal["raster-harness device result"]
    page: _Page
    views: Annotated[list[_View], Field(min_length=1, max_length=1000)]

    @validator(mode="after")
    def _check_views(self) -> Self:
        if len(set(map(_identify_view, self.views))) < len(self.views):
            raise ValueError("a view occurs twice")
        return self


def import_result(result: Result, folder: Path, device: str, run: Run | None = None) -> Path:
    """Write a page's result as a run folder; return the folder.

    run : the run from which the page was made, whose frames and predictions are copied

    Raises InputError or IncompatibleRunsError if `run` has other polygons or contradicts the
    result.
    """
    if run is not None:
        for case in (case for view in result.views for case in view.cases.values()):
            _raise_if_contradicting(run, case, exact_grid=result.device.step == 1)
    remedy = f"remove {folder} and run the same command again"
    with RunFolder.create(folder, remedy) as writer:
        writer.write_facts(_make_facts(result, device))
        for view in result.views:
            for record, counters in _make_records(view, device, result):
                if run is not None:
                    _write_polygon_arrays(writer, run, record, counters)
                writer.append(record)
    return folder


def _make_facts(result: Result, device: str) -> RunFacts:
    cases = [case for view in result.views for case in view.cases.values()]
    names = dict.fromkeys(case.record.triangulator for case in cases)
    differing = sum(case.differing for case in cases)
    warnings = [f"counters differ from the run's in {differing} polygons"] if differing else []
    step = result.device.step
    details = {
        **result.device.model_dump(),
        "subpixel_bits": None if step is None else (SUBPIXEL // step).bit_length() - 1,
        "renderer": result.device.description or device,
        "version": f"WebGPU in {result.browser}",
    }
    return {
        "created": result.started,
        "imported": True,
        "plan": {"scene": result.page.scene, "triangulators": list(names), "seed": 0},
        "scene": {
            "name": result.page.scene,
            "hash": cases[0].record.scene_hash if cases else "",
            "polygons": cases[0].record.polygons if cases else 0,
        },
        "environment": {"harness": result.page.harness, "browser": result.browser},
        "warnings": list_warnings(result, warnings, "polygons"),
        "frames": [],
        "devices": {
            f"{RASTERISER} on {device}": {
                "details": details,
                "timer": result.timer.model_dump() if result.timer else None,
            }
        },
    }


def _make_records(
    view: _View, device: str, result: Result
) -> Iterator[tuple[Record, Mapping[str, np.ndarray]]]:
    """Yield the record of each case of a view, with counters per polygon."""
    base = max(view.cases.values(), key=lambda case: case.record.polygons, default=None)
    for name, case in view.cases.items():
        counters = case.counters.to_arrays()
        fragments = counters["fragments"]
        counters["helper_lanes"] = 4 * counters["quads"] - fragments
        error = None
        if base and case.record.polygons == base.record.polygons:
            error = int(np.abs(fragments - np.array(base.counters.fragments)).sum())
        values_of_record = {
            **case.record.model_dump(exclude_unset=True),
            "key": "0" * 16,
            "rasteriser": RASTERISER,
            "device": device,
            "status": "ok",
            "counters": {counter: int(sums.sum()) for counter, sums in counters.items()},
            "coverage_error": error,
        }
        record = parse_record(values_of_record)
        yield replace(record, key=record.id.key, time=_make_time(view, name, result)), counters


def _make_time(view: _View, name: str, result: Result) -> Time | None:
    """Return a record's `time`, or None if the case was timed in fewer than two rounds."""
    times = view.times or {}
    rounds = sum(view.epochs)
    if result.timer is None or rounds < 2 or not {name, EMPTY, REFERENCE} <= set(times):
        return None
    settings = TimingSettings(budget_s=result.budget_s)
    group = {}
    epochs = [count for count in view.epochs if count]
    for draw in (name, EMPTY, REFERENCE):
        group[draw] = Times(times[draw].repeats, times[draw].samples_s, epochs)
        group[draw].precision_reached = group[draw].is_precise(settings.precision)
    test = TimerTest(**result.timer.model_dump(exclude={"asking_s"}))
    return records.make_time(group, name, test, settings)


def _raise_if_contradicting(run: Run, case: _Case, *, exact_grid: bool) -> None:
    """Raise an error if a case contradicts the run's polygons or triangles.

    exact_grid : True if counters must equal the reference's, whose grid the device has
    """
    saved = case.record
    name = saved.triangulator
    view = View(saved.resolution, float(saved.rotation), saved.fit)
    stored = _find_record(run, name, saved.scene_hash, view)
    if stored is None:
        raise IncompatibleRunsError(
            f"{run.path}: no {name} of the page's polygons at {saved.resolution} px; give the run "
            "from which the page was made"
        )
    expected, actual = record_to_json(stored), saved.model_dump(exclude_unset=True)
    common = [field for field in RECORD_FIELDS if field in expected and field in actual]
    different = [f for f in common if f != "triangulator" and expected[f] != actual[f]]
    if different:
        raise IncompatibleRunsError(
            f"{name}: {', '.join(different)} contradict {run.path}; give the run from which the "
            "page was made"
        )
    geometry = read_geometry(run, view)
    if not exact_grid or geometry is None or name not in geometry.triangles:
        return
    counters = case.counters.to_arrays()
    counted = np.array(list(counters.values()))
    exact = np.array(count_per_polygon(geometry, geometry.triangles[name])[: len(counted)])
    if counted.shape != exact.shape or (counted != exact).any(axis=0).sum() != case.differing:
        raise InputError(
            f"{name}: the number of polygons whose counters differ from the exact reference is not "
            f"{case.differing}, as the file states; measure again"
        )


def _find_record(run: Run, name: str, scene_hash: str, view: View) -> Record | None:
    key = name, scene_hash, view
    records = (r for r in run.records if r.is_ok)
    return next((r for r in records if (r.id.name, r.id.scene_hash, r.id.view) == key), None)


def _write_polygon_arrays(
    writer: RunFolder, run: Run, record: Record, counters: Mapping[str, np.ndarray]
) -> None:
    name = get_view_file_stem(record.id.view)
    if not (writer.path / FRAMES / f"{name}.npz").exists():
        arrays = read_arrays(run, name, FRAMES)
        if arrays is not None:
            writer.write_arrays(name, arrays, FRAMES)
    stored = _find_record(run, record.name, record.id.scene_hash, record.id.view)
    columns = (stored and read_arrays(run, stored.key)) or {}
    predicted = {name: column for name, column in columns.items() if name.startswith(PREDICTED)}
    if {len(column) for column in predicted.values()} == {len(counters["quads"])}:
        writer.write_arrays(record.key, {**predicted, **counters})
