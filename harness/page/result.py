"""Reads what a measuring page saved, and makes a run folder of it.

The file comes from anywhere, so nothing in it is believed before it is checked: its digest, which
tells damage; its shape, sizes and ranges; and that its parts agree with each other.
"""

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
    Finite,
    Measured,
    Name,
    Part,
    Share,
    Text,
    Whole,
    check_rounds,
    warnings_of,
)
from harness.page.saved import Times as Told
from harness.rasterisers.reference import SHADED, predict
from harness.results import drawings
from harness.results.drawings import Geometry
from harness.results.parsing import parse_record, record_to_json
from harness.results.record import Record, RunFacts, Time
from harness.results.run_folder import Run, RunFolder, read_arrays
from harness.settings import RESOLUTIONS, TimingSettings

FORMAT = "raster-harness device result"
RASTERISER = "webgpu"
BESIDE = (EMPTY, REFERENCE, "(the base again)")
"""What is timed beside the cases; the last is compared with itself."""


class _Page(Part):
    harness: Text
    scene: Name
    created: Text


class _Record(Part):
    """Fields of a record that hold on any device."""

    scene: Name
    scene_hash: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
    triangulator: Name
    resolution: Annotated[int, Field(ge=RESOLUTIONS[0], le=RESOLUTIONS[1])]
    rotation: Finite
    fit: Literal["box", "circle"] = "box"
    reason: Annotated[str, StringConstraints(max_length=10_000)] | None = None
    polygons: Whole
    polygons_skipped: Whole = 0
    polygons_failed: Whole = 0
    vertices: Whole
    triangles: Whole
    predicted: dict[Name, Finite]
    triangulate_s: Share | None = None
    conforming: bool | None = None
    t_junctions: Whole = 0
    proven: Whole | None = None
    largest_gap: Share | None = None
    outline_quads: Whole | None = None


class _Counters(Part):
    """What the page counts of each polygon."""

    fragments: list[Whole]
    quads: list[Whole]
    partial_quads: list[Whole]


KEPT, TOLD = tuple(_Record.model_fields), tuple(_Counters.model_fields)


def counted_exactly(kept: Geometry, rows: NDArray[Any]) -> tuple[NDArray[np.int64], ...]:
    """Return what the page counts of each polygon, as the CPU reference counts (m, 3) `rows`."""
    predicted = predict(kept.points, rows)
    owner = np.searchsorted(kept.grid.vertex_offsets, rows[:, 0], side="right") - 1
    size = len(kept.grid)
    return tuple(np.bincount(owner, predicted[name], size).astype(np.int64) for name in TOLD)


class _Case(Part):
    record: _Record
    counters: _Counters
    differing: Whole

    @validator(mode="after")
    def _possible(self) -> Self:
        """Whether it can be true, whatever the polygons are."""
        record = self.record
        polygons = record.polygons + record.polygons_skipped + record.polygons_failed
        for _, values in self.counters:
            if len(values) != polygons:
                raise ValueError(f"{polygons} polygons and counters of {len(values)}")
        fragments, quads, partial = (np.array(values) for _, values in self.counters)
        if ((quads > fragments) | (4 * quads < fragments)).any():
            raise ValueError("quads of fewer than one pixel, or more than four")
        lanes = 4 * quads - fragments
        if ((partial > lanes) | (lanes > 3 * partial) | (partial > quads)).any():
            raise ValueError("partial quads without a helper lane, or with more than three")
        if polygons and not fragments.any():
            raise ValueError("nothing was drawn: all counters are zero")
        if (record.proven or 0) > record.polygons:
            raise ValueError(f"{record.proven} of {record.polygons} polygons proven")
        if record.triangles < record.polygons or record.vertices < 3 * record.polygons:
            raise ValueError("triangles or vertices too few for its polygons")
        return self


class _View(Part):
    resolution: Annotated[int, Field(ge=RESOLUTIONS[0], le=RESOLUTIONS[1])]
    rotation: Finite
    fit: Literal["box", "circle"]
    scene: Name
    cases: dict[Name, _Case]
    times: dict[Name, Told] | None
    epochs: list[Annotated[int, Field(ge=0)]]

    @validator(mode="after")
    def _agrees(self) -> Self:
        """Whether its cases are of one frame and its times of the same rounds."""
        for name, case in self.cases.items():
            told = case.record
            if name != told.triangulator or _place(told) != _place(self):
                raise ValueError(f"the record of {name} is of another case")
        cases = self.cases.values()
        if len({(case.record.scene_hash, len(case.counters.quads)) for case in cases}) > 1:
            raise ValueError("its cases are of different scenes or numbers of polygons")
        times = self.times or {}
        if not set(times) <= {*self.cases, *BESIDE}:
            raise ValueError("something was timed that was not counted")
        check_rounds(times, self.epochs)
        return self


def _place(of: _Record | _View) -> tuple[Any, ...]:
    return of.scene, of.resolution, of.rotation, of.fit


class Result(Measured):
    """What a page saved that measured a run's triangulations."""

    format: Literal["raster-harness device result"]
    page: _Page
    views: Annotated[list[_View], Field(min_length=1, max_length=1000)]

    @validator(mode="after")
    def _once(self) -> Self:
        """Whether each view is there once."""
        if len(set(map(_place, self.views))) < len(self.views):
            raise ValueError("one view is there twice")
        return self


def import_result(result: Result, folder: Path, device: str, run: Run | None = None) -> Path:
    """Make a run folder of a page's result; returns it.

    device : the name that the device gets
    run : the run that the page was made of, if it is at hand; the imported one then keeps its
        frames and each polygon's predictions, too

    Raises
    ------
    UsageError
        if the folder holds a run already, or `run` is of other polygons or says otherwise of them
    """
    for case in (case for view in result.views for case in view.cases.values()):
        if run is not None:
            _refuse_other_figures(run, case, exact_grid=result.device.step == 1)
    again = f"remove {folder} and give the same command again"
    with RunFolder.create(folder, again) as writer:
        writer.write_facts(_facts(result, device))
        for view in result.views:
            for record, counters in _records(view, device, result):
                if run is not None:
                    _add_polygons(writer, run, record, counters)
                writer.append(record)
    return folder


def _facts(result: Result, device: str) -> RunFacts:
    cases = [case for view in result.views for case in view.cases.values()]
    names = dict.fromkeys(case.record.triangulator for case in cases)
    differing = sum(case.differing for case in cases)
    more = [f"counters differ from the run's in {differing} polygons"] if differing else []
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
        "warnings": warnings_of(result, more, "polygons"),
        "frames": [],
        "devices": {
            f"{RASTERISER} on {device}": {
                "details": details,
                "timer": result.timer.model_dump() if result.timer else None,
            }
        },
    }


def _records(
    view: _View, device: str, result: Result
) -> Iterator[tuple[Record, Mapping[str, np.ndarray]]]:
    """Yield the record of each case of a view, with its counters by polygon."""
    base = max(view.cases.values(), key=lambda case: case.record.polygons, default=None)
    for name, case in view.cases.items():
        fragments, quads, partial = (np.array(values, np.int64) for _, values in case.counters)
        values = (fragments, quads, 4 * quads - fragments, partial)
        counters = dict(zip(SHADED, values, strict=True))
        error = None
        if base and case.record.polygons == base.record.polygons:
            error = int(np.abs(fragments - np.array(base.counters.fragments)).sum())
        values_of_record = {
            **case.record.model_dump(exclude_unset=True),
            "key": "0" * 16,
            "rasteriser": RASTERISER,
            "device": device,
            "status": "ok",
            "counters": {each: int(sums.sum()) for each, sums in counters.items()},
            "coverage_error": error,
        }
        record = parse_record(values_of_record)
        yield replace(record, key=record.id.key, time=_time(view, name, result)), counters


def _time(view: _View, name: str, result: Result) -> Time | None:
    """Return a record's `time`, None where the case was not timed to the end of a round."""
    times = view.times or {}
    rounds = sum(view.epochs)
    if result.timer is None or rounds < 2 or not {name, EMPTY, REFERENCE} <= set(times):
        return None
    settings = TimingSettings(budget_s=result.budget_s)
    group = {}
    epochs = [count for count in view.epochs if count]
    for each in (name, EMPTY, REFERENCE):
        group[each] = Times(times[each].repeats, times[each].samples_s, epochs)
        group[each].precision_reached = group[each].is_precise(settings.precision)
    test = TimerTest(**result.timer.model_dump(exclude={"asking_s"}))
    return records.make_time(group, name, test, settings)


def _refuse_other_figures(run: Run, case: _Case, *, exact_grid: bool) -> None:
    """What the run's polygons and triangles say of a case, the page's file must say, too.

    exact_grid : the device draws polygons where they are, so that the reference counts the same
    """
    own = case.record
    view = View(own.resolution, float(own.rotation), own.fit)
    known = _find_record(run, own.triangulator, own.scene_hash, view)
    if known is None:
        raise IncompatibleRunsError(
            f"{run.path} has no {own.triangulator} of the page's polygons at {own.resolution} px"
        )
    stored, told = record_to_json(known), own.model_dump(exclude_unset=True)
    both = {name for name in KEPT if name in stored and name in told} - {"triangulator"}
    wrong = [name for name in KEPT if name in both and stored[name] != told[name]]
    if wrong:
        raise IncompatibleRunsError(f"{own.triangulator}: {', '.join(wrong)} contradict {run.path}")
    kept = drawings.read(run, view)
    if not exact_grid or kept is None or own.triangulator not in kept.triangles:
        return
    counted = np.array([values for _, values in case.counters])
    exact = np.array(counted_exactly(kept, kept.triangles[own.triangulator]))
    if counted.shape != exact.shape or (counted != exact).any(axis=0).sum() != case.differing:
        raise InputError(
            f"{own.triangulator}: its counters do not differ from the exact reference in "
            f"{case.differing} polygons, as the file says"
        )


def _find_record(run: Run, name: str, scene_hash: str, view: View) -> Record | None:
    """Return the run's record of these polygons, triangulator and view, or None."""
    wanted = (name, scene_hash, view)
    measured = (record for record in run.records if record.is_ok)
    return next(
        (each for each in measured if (each.name, each.id.scene_hash, each.id.view) == wanted), None
    )


def _add_polygons(
    writer: RunFolder, run: Run, record: Record, counters: Mapping[str, np.ndarray]
) -> None:
    """Keep the frame, and the predictions of each polygon beside what was counted of it."""
    name = drawings.view_name(record.id.view)
    if not (writer.path / drawings.FOLDER / f"{name}.npz").exists():
        arrays = read_arrays(run, name, drawings.FOLDER)
        if arrays is not None:
            writer.write_arrays(name, arrays, drawings.FOLDER)
    known = _find_record(run, record.name, record.id.scene_hash, record.id.view)
    columns = (known and read_arrays(run, known.key)) or {}
    predicted = {each: kept for each, kept in columns.items() if each.startswith(PREDICTED)}
    if {len(kept) for kept in predicted.values()} == {len(counters["quads"])}:
        writer.write_arrays(record.key, {**predicted, **counters})
