"""Works through the cases of a run, view by view and device by device."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import psutil
from numpy.typing import NDArray

from harness import measure, records
from harness.errors import HarnessError
from harness.frame import Frame, View, make_frame
from harness.plan import Case, Plan
from harness.progress import Reporter
from harness.rasterisers.base import Counters, Device
from harness.store import Record, Store
from harness.timing import Times
from harness.triangulation import FrameTriangulation, is_builtin, triangulate_polygons
from harness.worker import Executor, TaskFailed
from scenes import Scene

BASELINE = "delaunay"
"""Its fragments say what each polygon covers on a device: it leaves no vertex out."""

MEMORY_SHARE = 0.75
"""Of the memory that is free, what a triangulator that others wrote may take."""


class OpenWorker(Protocol):
    """Makes the processes of a run."""

    def __call__(
        self, name: str, environment: Mapping[str, str], memory_bytes: int | None = None
    ) -> Executor:
        """Return an executor called `name`; see `harness.worker.Worker`."""
        ...


@dataclass(frozen=True)
class Target:
    """A rasteriser on a device."""

    rasteriser: str
    device: Device

    @property
    def label(self) -> str:
        """Name for messages."""
        return f"{self.rasteriser} on {self.device.name}"


@dataclass
class Prepared:
    """A triangulator's result for one view, ready to be measured on every device."""

    triangulation: FrameTriangulation
    prediction: records.Prediction
    triangles: NDArray[np.int32]


@dataclass
class Runner:
    """One run in progress."""

    plan: Plan
    scene: Scene
    targets: list[Target]
    store: Store
    reporter: Reporter
    open_worker: OpenWorker
    done: dict[str, Record] = field(default_factory=dict)
    devices: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    frames: list[dict[str, Any]] = field(default_factory=list)
    stopping: bool = False
    _workers: dict[str, Executor] = field(default_factory=dict)
    _opened: dict[str, measure.Opened] = field(default_factory=dict)

    def go(self) -> None:
        """Measure every case that is not done, view by view."""
        for view in self.plan.views:
            pending = self._pending(view)
            if not pending or self.stopping:
                continue
            with self._clocked("frame"):
                frame = make_frame(self.scene.polygons, view)
            self._report_frame(view, frame)
            names = [name for name in self.plan.triangulators if any(name in p for p in pending)]
            with self._clocked("triangulate"):
                prepared = self._triangulate(names, frame, pending)
            for target, cases in zip(self.targets, pending, strict=True):
                if cases and not self.stopping:
                    self._measure(target, frame, cases, prepared)

    def close(self) -> None:
        """End all worker processes."""
        for worker in self._workers.values():
            worker.close()

    def _pending(self, view: View) -> list[dict[str, Case]]:
        """For each target, triangulator -> case of what has no good record yet."""
        return [
            {
                name: case
                for name in self.plan.triangulators
                if self.done.get((case := self._case(view, name, target)).key, {}).get("status")
                not in ("ok", "skipped")
            }
            for target in self.targets
        ]

    def _case(self, view: View, name: str, target: Target) -> Case:
        return Case(
            # Of a file only its name: the same file elsewhere is the same scene.
            scene=Path(self.plan.scene).name,
            scene_hash=self.scene.content_hash,
            view=view,
            triangulator=name,
            rasteriser=target.rasteriser,
            device=target.device.name,
            options=self.plan.options,
        )

    def _worker(
        self, name: str, environment: Mapping[str, str], memory_bytes: int | None = None
    ) -> Executor:
        if name not in self._workers:
            self._workers[name] = self.open_worker(name, environment, memory_bytes)
        return self._workers[name]

    def _triangulating_worker(self, name: str) -> Executor:
        if is_builtin(name):
            return self._worker("triangulators", {})
        # What others wrote may crash or devour memory: it gets a process that nothing else needs.
        free = psutil.virtual_memory().available
        return self._worker(f"triangulator {name}", {}, int(MEMORY_SHARE * free))

    def _triangulate(
        self, names: list[str], frame: Frame, pending: list[dict[str, Case]]
    ) -> dict[str, Prepared]:
        """Run each triangulator over the frame; write records for those that give nothing."""
        prepared = {}
        wanted = names if BASELINE in names else [BASELINE, *names]
        with self.reporter.stage("triangulating", len(wanted)) as stage:
            for name in wanted:
                try:
                    result = self._triangulating_worker(name).call(
                        triangulate_polygons,
                        name,
                        frame.polygons,
                        self.plan.seed,
                        timeout_s=self.plan.timeout_s,
                    )
                except TaskFailed as error:
                    self._give_up(name, pending, "failed", str(error))
                else:
                    triangles = frame.join(result.parts)
                    if len(triangles):
                        prediction = records.predict_frame(frame, result.parts)
                        prepared[name] = Prepared(result, prediction, triangles)
                    else:
                        status = "failed" if result.failed else "skipped"
                        reason = records.incomplete(result) or "no polygon is left"
                        self._give_up(name, pending, status, reason)
                stage.advance()
        return prepared

    def _give_up(self, name: str, pending: list[dict[str, Case]], status: str, reason: str) -> None:
        for cases in pending:
            if name in cases:
                self._write(records.problem(cases.pop(name), status, reason))

    def _measure(
        self,
        target: Target,
        frame: Frame,
        cases: dict[str, Case],
        prepared: Mapping[str, Prepared],
    ) -> None:
        """Count all cases of one target, time them together, write their records."""
        # Workers need coordinates, not geometries, and those are slow to send.
        bare = replace(frame, polygons=())
        try:
            opened = self._open(target)
        except HarnessError as error:
            for case in cases.values():
                self._write(records.problem(case, "failed", str(error)))
            return
        counted = self._count(target, bare, cases, prepared)
        expected = self._expected_fragments(counted, prepared)
        drawn = {name: prepared[name].triangles for name in counted if name in cases}
        timing = self._time(target, bare, drawn, opened, cases)
        for name in drawn:
            if name in timing:
                record = records.measured(
                    cases[name],
                    frame,
                    prepared[name].triangulation,
                    prepared[name].prediction,
                    counted[name],
                    expected,
                    timing[name],
                )
                columns = prepared[name].prediction.columns
                self.store.write_arrays(
                    cases[name].key,
                    {f"predicted_{key}": column for key, column in columns.items()}
                    | {key: column for key, column in counted[name].items() if column.ndim},
                )
                self._write(record)

    def _open(self, target: Target) -> measure.Opened:
        """Open the device in its worker, and note what it is; once a run."""
        if target.label in self._opened:
            return self._opened[target.label]
        with self._clocked("open"):
            opened = self._call(target, measure.open_device)
        self._opened[target.label] = opened
        test = opened.timer
        self.devices[target.label] = {
            "details": opened.details,
            "timer": None if test is None else asdict(test),
        }
        if test is not None and test.gpu_s is not None and test.timer == "wall":
            self.reporter.say(f"{target.label}: timed by the wall clock ({test.reason})")
        return opened

    def _count(
        self,
        target: Target,
        frame: Frame,
        cases: dict[str, Case],
        prepared: Mapping[str, Prepared],
    ) -> dict[str, Counters]:
        """Count the cases and the baseline; a case that fails gets its record at once."""
        counted = {}
        names = [name for name in prepared if name in cases or name == BASELINE]
        title = f"counting: {target.label}"
        with self._clocked("count"), self.reporter.stage(title, len(names)) as stage:
            for name in names:
                arguments = (frame, prepared[name].triangles, self.plan.options)
                try:
                    counted[name] = self._call(target, measure.count, *arguments)
                except HarnessError as error:
                    if name in cases:
                        self._write(records.problem(cases[name], "failed", str(error)))
                stage.advance()
        return counted

    def _expected_fragments(
        self, counted: Mapping[str, Counters], prepared: Mapping[str, Prepared]
    ) -> NDArray[np.int64] | None:
        """Return (p,) fragments of each polygon by the baseline, -1 where it has none."""
        fragments = counted.get(BASELINE, {}).get("fragments")
        if fragments is None or not fragments.ndim:
            return None
        parts = prepared[BASELINE].triangulation.parts
        return np.where([part is not None for part in parts], fragments, -1)

    def _time(
        self,
        target: Target,
        frame: Frame,
        drawn: Mapping[str, NDArray[np.int32]],
        opened: measure.Opened,
        cases: Mapping[str, Case],
    ) -> dict[str, dict[str, Any] | None]:
        """Time the triangulations in `drawn` together; {name: a record's `time`}.

        If the device crashes under them, each is tried alone, so that only the one which brings
        it down fails.
        """
        if opened.timer is None or not drawn:
            return dict.fromkeys(drawn)
        try:
            group = self._time_group(target, frame, drawn, opened)
        except HarnessError as error:
            if len(drawn) == 1:
                self._write(records.problem(cases[next(iter(drawn))], "failed", str(error)))
                return {}
            alone: dict[str, dict[str, Any] | None] = {}
            for name, triangles in drawn.items():
                alone |= self._time(target, frame, {name: triangles}, opened, cases)
            return alone
        return {
            name: records.time_fields(group, name, opened.timer, self.plan.timing) for name in drawn
        }

    def _time_group(
        self,
        target: Target,
        frame: Frame,
        drawn: Mapping[str, NDArray[np.int32]],
        opened: measure.Opened,
    ) -> dict[str, Times]:
        settings = self.plan.timing
        likely_s = settings.budget_s * (len(drawn) + 2)
        title = f"timing: {target.label}"
        with self._clocked("time"), self.reporter.stage(title, likely_s) as stage:
            return self._call(
                target,
                measure.time_group,
                frame,
                dict(drawn),
                self.plan.options,
                settings,
                opened.timer,
                self.plan.seed,
                timeout_s=self.plan.timeout_s + 2 * likely_s,
                tick=lambda waited: stage.complete(min(waited, likely_s)),
            )

    def _call(
        self,
        target: Target,
        function: Callable[..., Any],
        *arguments: Any,
        timeout_s: float | None = None,
        tick: Callable[[float], None] | None = None,
    ) -> Any:
        worker = self._worker(target.label, target.device.environment)
        try:
            return worker.call(
                function,
                target.rasteriser,
                target.device,
                *arguments,
                timeout_s=timeout_s or self.plan.timeout_s,
                tick=tick,
            )
        except TaskFailed:
            # A context that was lost stays lost: what comes next gets a fresh process.
            self._workers.pop(target.label).close()
            raise

    def _write(self, record: Record) -> None:
        self.store.append(record)
        self.done[record["key"]] = record
        if record["status"] == "failed":
            self.reporter.warn(
                f"{record['triangulator']} on {record['device']} failed: {record['reason']}"
            )

    def _report_frame(self, view: View, frame: Frame) -> None:
        """Keep, and show, what snapping to the grid did to the scene."""
        self.frames.append(
            {
                "resolution": view.resolution,
                "rotation": view.rotation,
                "fit": view.fit,
                "scale": frame.scale,
                "polygons": len(frame.polygons),
                "vertices": len(frame.points),
                "dropped": [list(entry) for entry in frame.dropped],
                "repaired": [list(entry) for entry in frame.repaired],
            }
        )
        for verb, entries in (("dropped", frame.dropped), ("repaired", frame.repaired)):
            if entries:
                number, reason = entries[0]
                self.reporter.say(
                    f"snapping {verb} {len(entries)} of {len(self.scene.polygons)} polygons "
                    f"at {view.resolution} px, e.g. polygon {number}: {reason}"
                )

    @contextmanager
    def _clocked(self, stage: str) -> Iterator[None]:
        """Add the time spent inside to `seconds[stage]`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - start
