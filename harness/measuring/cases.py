"""Works through the cases of a plan: view by view, device by device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import rasterisers
from harness.errors import HarnessError
from harness.frame import Frame, View, make_frame
from harness.measuring import records
from harness.measuring.plan import Case, Plan
from harness.measuring.processes import Bench, Target
from harness.measuring.worker import TaskFailed, TaskTimedOut
from harness.progress import Reporter
from harness.rasterisers.base import Counters, Options
from harness.stored import drawings
from harness.stored.folder import Record, Store
from harness.triangulating.frames import BEFORE_TURNING, FrameTriangulation, carry_over, is_builtin
from scenes import Scene

BASELINE = "delaunay"
"""Its fragments say what each polygon covers on a device: it leaves no vertex out."""


@dataclass
class Prepared:
    """A triangulator's result for one view, ready to be measured on every device."""

    triangulation: FrameTriangulation
    prediction: records.Prediction
    triangles: NDArray[np.int32]


@dataclass(frozen=True)
class Group:
    """Cases that are timed together: they differ in the triangulator alone."""

    target: Target
    options: Options
    cases: dict[str, Case]


@dataclass
class Runner:
    """Measures the cases of one plan and scene that have no record yet; writes their records.

    label : the scene's name in records
    done : records by key; those that are ok or skipped are left alone
    frames : what snapping did to the scene, one entry a view, JSON-ready
    """

    plan: Plan
    label: str
    scene: Scene
    targets: list[Target]
    store: Store
    reporter: Reporter
    bench: Bench
    done: dict[str, Record] = field(default_factory=dict)
    frames: list[dict[str, Any]] = field(default_factory=list)

    def go(self, *, keep_geometry: bool = True) -> None:
        """Measure until all is done, or `bench.stopping` is set.

        keep_geometry : store what was drawn, for pictures; a study of many parts does not
        """
        for view in self.plan.views:
            groups = [group for group in self._groups(view) if group.cases]
            if not groups or self.bench.stopping:
                continue
            # Drivers take a second to load; meanwhile another process can triangulate.
            self.bench.open_soon(groups[0].target)
            frame = make_frame(self.scene.polygons, view)
            self._report_frame(view, frame)
            prepared = self._triangulate(frame, groups)
            if keep_geometry:
                triangles = {name: ready.triangles for name, ready in prepared.items()}
                drawings.write(self.store, frame, triangles)
            for group in groups:
                if group.cases and not self.bench.stopping:
                    self._measure(group, frame, prepared)

    def _groups(self, view: View) -> list[Group]:
        groups = []
        for target in self.targets:
            kind = rasterisers.get(target.rasteriser)
            for options in filter(kind.supports, self.plan.options):
                cases = {
                    name: self._case(view, name, target, options)
                    for name in self.plan.triangulators
                }
                pending = {name: case for name, case in cases.items() if not self._is_done(case)}
                groups.append(Group(target, options, pending))
        return groups

    def _is_done(self, case: Case) -> bool:
        return self.done.get(case.key, {}).get("status") in ("ok", "skipped")

    def _case(self, view: View, name: str, target: Target, options: Options) -> Case:
        return Case(
            scene=self.label,
            scene_hash=self.scene.content_hash,
            view=view,
            triangulator=name,
            rasteriser=target.rasteriser,
            device=target.device.name,
            options=options,
        )

    def _triangulate(self, frame: Frame, groups: list[Group]) -> dict[str, Prepared]:
        """Run each triangulator over the frame; write records for those that give nothing."""
        needed = [name for name in self.plan.triangulators if any(name in g.cases for g in groups)]
        wanted = list(dict.fromkeys([BASELINE, *needed]))
        prepared = {}
        with self.reporter.stage("triangulating", len(wanted)) as stage:
            for name in wanted:
                try:
                    result = self._cut(name, frame)
                except TaskTimedOut as error:
                    self._give_up(name, groups, *self._too_slow(name, error))
                except TaskFailed as error:
                    self._give_up(name, groups, "failed", str(error))
                else:
                    for note in result.notes:
                        self.reporter.warn_once(note)
                    triangles = frame.join(result.parts)
                    if len(triangles):
                        prediction = records.predict_frame(frame, result.parts)
                        prepared[name] = Prepared(result, prediction, triangles)
                    else:
                        status = "failed" if result.failed else "skipped"
                        reason = records.incomplete(result) or "no polygon is left"
                        self._give_up(name, groups, status, reason)
                stage.advance()
        return prepared

    def _cut(self, name: str, frame: Frame) -> FrameTriangulation:
        """Run one triangulator over the frame, or, as `name@0`, over the scene not yet turned."""
        base, mark, _ = name.partition(BEFORE_TURNING)
        if not mark:
            polygons = frame.polygons
            return self.bench.triangulate(name, polygons, self.plan.seed, self.plan.calibration)
        upright = make_frame(self.scene.polygons, replace(frame.view, rotation=0.0))
        before = self.bench.triangulate(
            base, upright.polygons, self.plan.seed, self.plan.calibration
        )
        return carry_over(before, upright, frame)

    def _too_slow(self, name: str, error: TaskTimedOut) -> tuple[str, str]:
        """Return status and reason: ours are slow by design, others may have hung."""
        if not is_builtin(name):
            return "failed", str(error)
        return "skipped", (
            f"triangulating took more than {self.plan.timeout_s:g} s; give it longer with "
            "--timeout, or a smaller scene (limit=)"
        )

    def _give_up(self, name: str, groups: list[Group], status: str, reason: str) -> None:
        for group in groups:
            if name in group.cases:
                self._write(records.problem(group.cases.pop(name), status, reason))

    def _measure(self, group: Group, frame: Frame, prepared: Mapping[str, Prepared]) -> None:
        """Count the group's cases, time them together, write their records."""
        try:
            opened = self.bench.open(group.target)
        except HarnessError as error:
            for case in group.cases.values():
                self._write(records.problem(case, "failed", str(error)))
            return
        counted = self._count(group, frame, prepared)
        coverage = self._coverage(counted, prepared)
        drawn = {name: prepared[name].triangles for name in counted if name in group.cases}
        fields: dict[str, Any] = dict.fromkeys(drawn)
        if opened.timer is not None and drawn:
            fields = self._time(group, frame, drawn)
        for name, timing in fields.items():
            ready = prepared[name]
            if len(frame.polygons) > 1:  # one polygon's columns are its record's totals
                self._keep_columns(group.cases[name], ready.prediction, counted[name])
            self._write(
                records.measured(
                    group.cases[name],
                    frame,
                    ready.triangulation,
                    ready.prediction,
                    counted[name],
                    coverage,
                    timing,
                )
            )

    def _keep_columns(self, case: Case, prediction: records.Prediction, counters: Counters) -> None:
        predicted = {f"predicted_{name}": column for name, column in prediction.columns.items()}
        counted = {name: column for name, column in counters.items() if column.ndim}
        self.store.write_arrays(case.key, predicted | counted)

    def _count(
        self, group: Group, frame: Frame, prepared: Mapping[str, Prepared]
    ) -> dict[str, Counters]:
        """Count the cases and the baseline; a case that fails gets its record at once."""
        counted = {}
        names = [name for name in prepared if name in group.cases or name == BASELINE]
        with self.reporter.stage(f"counting: {group.target.label}", len(names)) as stage:
            for name in names:
                triangles = prepared[name].triangles
                try:
                    counted[name] = self.bench.count(group.target, frame, triangles, group.options)
                except HarnessError as error:
                    if name in group.cases:
                        self._write(records.problem(group.cases[name], "failed", str(error)))
                stage.advance()
        return counted

    def _coverage(
        self, counted: Mapping[str, Counters], prepared: Mapping[str, Prepared]
    ) -> records.Coverage | None:
        """Return what the baseline drew of each polygon, None where the device cannot say."""
        fragments = counted.get(BASELINE, {}).get("fragments")
        if fragments is None or not fragments.ndim:
            return None
        parts = prepared[BASELINE].triangulation.parts
        return records.Coverage(fragments, records.drawn_polygons(parts))

    def _time(
        self, group: Group, frame: Frame, drawn: Mapping[str, NDArray[np.int32]]
    ) -> dict[str, dict[str, Any]]:
        """Time the triangulations in `drawn` together; {name: a record's `time`}."""
        settings = self.plan.timing
        test = self.bench.open(group.target).timer
        assert test is not None
        if test.gpu_s is not None and test.timer == "wall":
            self.reporter.once(f"{group.target.label}: timed by the wall clock ({test.reason})")
        likely_s = settings.budget_s * (len(drawn) + 2)
        with self.reporter.stage(f"timing: {group.target.label}", likely_s) as stage:
            groups, failures = self.bench.time(
                group.target,
                {name: (frame, triangles) for name, triangles in drawn.items()},
                group.options,
                settings,
                self.plan.seed,
                lambda waited: stage.complete(min(waited, likely_s)),
            )
        for name, reason in failures.items():
            self._write(records.problem(group.cases[name], "failed", reason))
        return {
            name: records.time_fields(times, name, test, settings) for name, times in groups.items()
        }

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
