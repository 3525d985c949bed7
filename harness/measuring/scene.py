"""Measurement of one scene, view by view: framing, triangulation, counting, timing."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.frame import Frame, View, make_scene_frame
from harness.measuring import records
from harness.measuring.plan import Plan, UsableBackend
from harness.measuring.pool import Backend, MeasuringPool, collect_bounds
from harness.measuring.tasks import EXACT_QUADS
from harness.metrics.registry import PREDICTED
from harness.progress import Reporter
from harness.rasterisers.base import Counters, Options, order_submission
from harness.rasterisers.vertex_batches import sum_batches_of_draws
from harness.results.record import CaseId, Record, Status
from harness.triangulating.carrying import (
    carry_to_rotated_frame,
    carry_to_views,
    make_original_triangulation,
)
from harness.triangulating.recipes import ORIGINAL, Recipe
from harness.triangulating.triangulate import FrameTriangulation
from harness.worker import TaskError, TaskTimeoutError
from scenes import Scene

DONE_STATUSES = ("ok", "skipped")  # statuses of records that a resumed run does not measure again

COVERAGE_RECIPE = Recipe("delaunay")  # it uses every vertex: all must cover its fragments

MESSAGE_AFTER_S = 2.0  # seconds of waiting before a message; loading compiled kernels takes less


@dataclass(frozen=True)
class Group:
    """Cases that are timed together and differ only in the triangulator."""

    backend: Backend
    options: Options
    cases: dict[Recipe, CaseId]


@dataclass
class _ViewState:
    """Frame of one view, and results in that frame that all groups share.

    limits : lower bounds of quads, (p,) by name, see `start_bounds`; {} if `COVERAGE_RECIPE` failed
    vertices : vertex batches and transformed vertices by recipe, order and seed
    calibrated : by recipe of the plan, the recipe that `SceneRun.calibrate` chose for this view
    """

    frame: Frame
    triangulations: dict[Recipe, FrameTriangulation] = field(default_factory=dict)
    triangles: dict[Recipe, NDArray[np.int32]] = field(default_factory=dict)
    limits: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    vertices: dict[tuple[Recipe, str, int], Counters] = field(default_factory=dict)
    calibrated: dict[Recipe, Recipe] = field(default_factory=dict)

    def get_batch_counters(self, recipe: Recipe, options: Options) -> Counters:
        """Return vertex batches and transformed vertices, equal in all rasterisers."""
        key = (recipe, options.order, options.seed)
        if key not in self.vertices:
            ordered = order_submission(self.frame, self.triangles[recipe], options)
            counts = sum_batches_of_draws(self.frame, ordered)
            self.vertices[key] = {name: np.array(value) for name, value in counts.items()}
        return self.vertices[key]


Calibrate = Callable[
    [Frame, Recipe, Callable[[Recipe], FrameTriangulation]], tuple[Recipe, FrameTriangulation]
]
"""Function of a frame, the recipe optimal:calibrated, and a function that triangulates the frame;
returns the recipe with the weights for this frame, and its triangulation."""


@dataclass(frozen=True)
class SceneRun:
    """The measurement of a scene, whose name in records is `label`.

    broken : triangulators that cannot run, with the reasons
    counted : records, by key, of cases that an earlier run counted but did not time
    rounds : True to time triangulation in rounds, like drawings
    calibrate : chooses the criterion that optimal:calibrated minimises in a frame; None if the
        recipe is the same for all frames
    """

    plan: Plan
    label: str
    scene: Scene
    usable: Sequence[UsableBackend]
    broken: Mapping[Recipe, str]
    pool: MeasuringPool
    reporter: Reporter
    writer: records.RunWriter
    counted: Mapping[str, Record]
    rounds: bool = False
    calibrate: Calibrate | None = None

    def measure(self) -> None:
        """Measure the cases until all are done, or `pool.stopping` is set."""
        for view in self.plan.views:
            groups = [group for group in self._make_groups(view) if group.cases]
            if not groups or self.pool.stopping:
                continue
            current = _ViewState(make_scene_frame(self.scene, view))
            self._report_snapping(current.frame)
            self.writer.add_frame(current.frame)
            self._triangulate_all(current, groups)
            if self.rounds:
                self._time_triangulating(current)
            self.writer.add_triangulations(current.frame, current.triangles)
            for group in groups:
                cases = {r: case for r, case in group.cases.items() if r in current.triangulations}
                if cases and not self.pool.stopping:
                    self._measure_group(current, replace(group, cases=cases))

    def _make_groups(self, view: View) -> Iterator[Group]:
        """Yield a group for each backend and its options; groups omit cases that are done."""
        for backend, supported in self.usable:
            for options in supported:
                cases = {
                    recipe: CaseId(
                        scene=self.label,
                        view=view,
                        triangulator=recipe.base,
                        rasteriser=backend.rasteriser,
                        device=backend.device.name,
                        options=options,
                        number=recipe.number,
                        upright=recipe.upright,
                        version="base" if recipe.other else "",
                        scene_hash=self.scene.content_hash,
                    )
                    for recipe in self.plan.triangulators
                }
                missing = {r: case for r, case in cases.items() if not self._is_done(case)}
                yield Group(backend, options, missing)

    def _is_done(self, case: CaseId) -> bool:
        record = self.writer.records.get(case.key)
        return record is not None and record.status in DONE_STATUSES

    def _add_unmeasured(self, case: CaseId, status: Status, reason: str) -> None:
        self.writer.add_finished(Record(case, status, reason))

    def _report_snapping(self, frame: Frame) -> None:
        for verb, entries in (("dropped", frame.dropped), ("repaired", frame.repaired)):
            if entries:
                number, reason = entries[0]
                self.reporter.say(
                    f"snapping {verb} {len(entries)} of {len(self.scene.polygons)} polygons "
                    f"at {frame.view.resolution} px, e.g. polygon {number}: {reason}"
                )

    # -- triangulations --------------------------------------------------------------------------

    def _triangulate_all(self, current: _ViewState, groups: Sequence[Group]) -> None:
        """Triangulate with the groups' recipes, and compute lower bounds.

        Cases whose recipe gives no triangles are recorded as failed or skipped.
        """
        needed = {recipe for group in groups for recipe in group.cases}
        requested = [recipe for recipe in self.plan.triangulators if recipe in needed]
        recipes = list(dict.fromkeys([COVERAGE_RECIPE, *requested]))
        compiled = [
            recipe
            for recipe in recipes
            if recipe not in self.broken and not recipe.other and recipe.base != ORIGINAL
        ]
        self.pool.compile_ahead([*compiled, EXACT_QUADS])
        limits: Mapping[str, Future[NDArray[np.int64]]] = {}
        with self.reporter.stage("triangulating", len(recipes)) as stage:
            for recipe in recipes:
                result = self._triangulate_one(current, recipe, stage.refresh)
                if isinstance(result, FrameTriangulation):
                    current.triangulations[recipe] = result
                    current.triangles[recipe] = current.frame.join_triangles(result.parts)
                    if recipe == COVERAGE_RECIPE:
                        limits = self.pool.start_bounds(current.frame, result.parts)
                else:
                    for group in groups:
                        if recipe in group.cases:
                            self._add_unmeasured(group.cases[recipe], *result)
                stage.advance()
        message = "computing minimum quad counts (for regret) ..."
        with self.reporter.say_if_long(message, MESSAGE_AFTER_S):
            current.limits = collect_bounds(limits)

    def _triangulate_one(
        self, current: _ViewState, recipe: Recipe, tick: Callable[[float], None]
    ) -> FrameTriangulation | tuple[Status, str]:
        """Compile and run a triangulator; return its result, or (status, reason) without a result.

        If the baseline's built-in triangulators equal the current ones, both use one result.
        """
        if recipe in self.broken:
            return "failed", self.broken[recipe]

        def report_wait(waited: float) -> None:
            if waited > MESSAGE_AFTER_S:
                self.reporter.say_once(
                    f"compiling {recipe.base}, once on each machine ..."
                    if recipe.builtin
                    else f"still waiting for the first polygons of {recipe.base} ..."
                )

        try:
            head = replace(recipe, other=False)
            other = self.pool.other
            if recipe.other and head.builtin and other and other.has_same_builtins:
                recipe = head
                if head in current.triangulations:
                    return current.triangulations[head]
            if recipe.base != ORIGINAL:
                self.pool.compile_kernels(recipe, report_wait)
            if self.calibrate is not None and recipe.calibration is not None:
                current.calibrated[recipe], result = self.calibrate(
                    current.frame, recipe, lambda r: self._triangulate(current.frame, r, tick)
                )
            else:
                result = self._triangulate(current.frame, recipe, tick)
        except TaskTimeoutError as error:
            # Built-in triangulators may be slow by design; third-party code may have hung.
            return ("skipped" if recipe.builtin else "failed"), str(error)
        except TaskError as error:
            self.reporter.detail(error.detail)
            return "failed", str(error)
        self.reporter.detail(result.trace)
        for note in result.notes:
            self.reporter.say_once(note, warn=True)
        if not any(part is not None and len(part) for part in result.parts):
            status: Status = "failed" if result.failed else "skipped"
            return (
                status,
                records.describe_missing(result)
                or "all polygons vanish on the grid of 1/256 px; increase --resolution",
            )
        return result

    def _triangulate(
        self, frame: Frame, recipe: Recipe, tick: Callable[[float], None]
    ) -> FrameTriangulation:
        """Run a triangulator over the frame's polygons, and return triangles of the frame.

        An `upright` recipe triangulates the scene before its rotation, and any recipe triangulates
        a model's faces in their planes.
        """
        plain_recipe = replace(recipe, upright=False)
        if frame.flat is not None:
            if recipe.base == ORIGINAL:
                return make_original_triangulation(frame)
            faces = frame.flat.polygons
            flat = self.pool.triangulate(plain_recipe, faces, tick)
            return carry_to_views(frame, flat, recipe)
        if not recipe.upright:
            return self.pool.triangulate(recipe, frame.polygons, tick)
        upright = make_scene_frame(self.scene, replace(frame.view, rotation=0.0))
        before = self.pool.triangulate(plain_recipe, upright.polygons, tick)
        return carry_to_rotated_frame(before, upright, frame)

    def _time_triangulating(self, current: _ViewState) -> None:
        plan_recipes = {
            current.calibrated.get(recipe, recipe): recipe
            for recipe in current.triangulations
            if not recipe.upright and recipe.base != ORIGINAL
        }
        seconds_by_recipe = {
            recipe: current.triangulations[original].seconds
            for recipe, original in plan_recipes.items()
        }
        polygons = (current.frame.flat or current.frame).polygons
        budget_s, seed = self.plan.timing.budget_s, self.plan.seed
        samples_s = self.pool.time_triangulating(seconds_by_recipe, polygons, budget_s, seed)
        for recipe, samples in samples_s.items():
            triangulation = current.triangulations[plan_recipes[recipe]]
            triangulation.samples_s, triangulation.seconds = samples, float(np.median(samples))

    # -- counts and times ------------------------------------------------------------------------

    def _measure_group(self, current: _ViewState, group: Group) -> None:
        try:
            opened = self.pool.open_device(group.backend)
        except HarnessError as error:
            for case in group.cases.values():
                self._add_unmeasured(case, "failed", str(error))
            return
        timed = opened.timer is not None
        ready: dict[Recipe, Record] = {
            recipe: replace(self.counted[case.key], status="ok")
            for recipe, case in group.cases.items()
            if timed and case.key in self.counted
        }
        cases = {recipe: case for recipe, case in group.cases.items() if recipe not in ready}
        if cases:
            ready |= self._count_group(current, replace(group, cases=cases), timed=timed)
        in_order = {recipe: ready[recipe] for recipe in group.cases if recipe in ready}
        if in_order:
            self.pool.is_timing = True
            self._time_group(current, group, in_order)
            self.pool.is_timing = False

    def _count_group(
        self, current: _ViewState, group: Group, *, timed: bool
    ) -> dict[Recipe, Record]:
        """Count the group's cases, store the counters; return the records to be timed.

        `COVERAGE_RECIPE` is counted first, to get each polygon's fragments.
        """
        ready: dict[Recipe, Record] = {}
        covered = None
        frame, backend, options, cases = current.frame, group.backend, group.options, group.cases
        limits = current.limits if options.samples == 1 else {}  # bounds are for pixel centres
        recipes = [
            recipe
            for recipe in dict.fromkeys([COVERAGE_RECIPE, *cases])
            if recipe in current.triangulations
        ]
        with self.reporter.stage(f"counting: {backend.label}", len(recipes)) as stage:
            for recipe in recipes:
                triangulation, triangles = current.triangulations[recipe], current.triangles[recipe]
                try:
                    counters = self.pool.draw_and_count(backend, frame, triangles, options)
                except HarnessError as error:
                    if recipe in cases:
                        self._add_unmeasured(cases[recipe], "failed", str(error))
                else:
                    if recipe == COVERAGE_RECIPE:
                        covered = records.get_covered_fragments(counters, triangulation.drawn)
                    if recipe in cases:
                        if self.pool.open_device(backend).draws_indexed:
                            counters |= current.get_batch_counters(recipe, options)
                        fields = (frame, triangulation, counters, covered, limits)
                        record = records.make_counted_record(cases[recipe], *fields)
                        columns = _make_columns(current, triangulation, counters, limits)
                        if timed:
                            ready[recipe] = record
                        add = self.writer.add_counted if timed else self.writer.add_finished
                        add(record, columns)
                stage.advance()
        return ready

    def _time_group(
        self, current: _ViewState, group: Group, ready: Mapping[Recipe, Record]
    ) -> None:
        settings, backend = self.plan.timing, group.backend
        test = self.pool.open_device(backend).timer
        assert test is not None
        if test.timer == "wall" and (test.gpu_s or test.cpu_s) is not None:
            self.reporter.detail(f"{backend.label}: timed by the wall clock, as {test.reason}")
        drawn_as = {recipe: self._choose_drawing(current, recipe, ready) for recipe in ready}
        likely_s = settings.processes * settings.budget_s * (len(ready) + 2)
        with self.reporter.stage(f"timing: {backend.label}", likely_s) as stage:
            groups, failures = self.pool.time_drawings(
                backend,
                {
                    str(drawn): (current.frame, current.triangles[drawn], group.options)
                    for drawn in drawn_as.values()
                },
                settings,
                self.plan.seed,
                lambda waited: stage.complete(min(waited, likely_s)),
            )
        for recipe, record in ready.items():
            name = str(drawn_as[recipe])
            if name in failures:
                self._add_unmeasured(group.cases[recipe], "failed", failures[name])
            else:
                time = records.make_time(groups[name], name, test, settings)
                self.writer.add_finished(replace(record, time=time))

    def _choose_drawing(
        self, current: _ViewState, recipe: Recipe, ready: Mapping[Recipe, Record]
    ) -> Recipe:
        """Return the recipe whose triangles are drawn and timed for a case.

        If the baseline has the same triangles as the current version, both get the same times,
        except with `OtherVersion.twice`.
        """
        head, other = replace(recipe, other=False), self.pool.other
        if other is None or other.twice or not recipe.other or head not in ready:
            return recipe
        equal = np.array_equal(current.triangles[recipe], current.triangles[head])
        return head if equal else recipe


def _make_columns(
    current: _ViewState,
    triangulation: FrameTriangulation,
    counters: Counters,
    limits: Mapping[str, NDArray[np.int64]],
) -> records.Columns | None:
    """Return predictions, counters and lower bounds per polygon, or None for a single polygon."""
    if len(current.frame.source) == 1:
        return None
    predicted = {PREDICTED + name: column for name, column in triangulation.predicted.items()}
    return predicted | {n: column for n, column in counters.items() if column.ndim} | dict(limits)
