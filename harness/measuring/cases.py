"""Works through the cases of a plan, view by view and device by device, and tells what it finds.

Nothing is kept in here: what is found is yielded, and whoever asked stores it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.frame import Frame, View, frame_of
from harness.measuring import records
from harness.measuring.backends import Usable
from harness.measuring.count_cases import Counted, Finished, count_cases
from harness.measuring.plan import Case, Plan
from harness.measuring.preparing import Prepared, prepare
from harness.measuring.processes import Backend, Bench
from harness.progress import Reporter
from harness.rasterisers.base import Options
from harness.stored.folder import Record
from harness.triangulating.recipes import ORIGINAL, Recipe
from scenes import Scene

DONE = ("ok", "skipped")
"""Records of cases that a resumed run leaves alone; what failed is tried again."""


@dataclass(frozen=True)
class Framed:
    """A view's frame was made."""

    frame: Frame

    def facts(self) -> dict[str, Any]:
        """Return what snapping to the grid did to the scene, JSON-ready."""
        frame, view = self.frame, self.frame.view
        return {
            "resolution": view.resolution,
            "rotation": view.rotation,
            "fit": view.fit,
            "scale": frame.scale,
            "polygons": len(frame.source),
            "vertices": len(frame.points),
            "dropped": [list(entry) for entry in frame.dropped],
            "repaired": [list(entry) for entry in frame.repaired],
        }


@dataclass(frozen=True)
class Triangulated:
    """A frame was triangulated; `triangles` (m, 3) by triangulator, rows of `frame.points`."""

    frame: Frame
    triangles: dict[str, NDArray[np.int32]]


Finding = Framed | Triangulated | Counted | Finished
"""What measuring a scene brings to light."""


@dataclass(frozen=True)
class Job:
    """One scene and what is to be measured of it, and with what.

    label : the scene's name in records
    broken : triangulators that cannot be run at all, and why
    rounds : whether to triangulate in rounds, as drawings are timed
    """

    plan: Plan
    label: str
    scene: Scene
    usable: Sequence[Usable]
    broken: Mapping[Recipe, str]
    bench: Bench
    reporter: Reporter
    rounds: bool = False


@dataclass(frozen=True)
class Group:
    """Cases that are timed together: they differ in the triangulator alone."""

    backend: Backend
    options: Options
    cases: dict[Recipe, Case]


def measure_scene(
    job: Job, finished: Mapping[str, Record], counted: Mapping[str, Record]
) -> Iterator[Finding]:
    """Measure the cases of one scene until all are done, or `bench.stopping` is set.

    finished : records by key; those that are ok or skipped are left alone
    counted : records by key of cases that need only be timed
    """
    for view in job.plan.views:
        groups = [group for group in _groups(job, view, finished) if group.cases]
        if not groups or job.bench.stopping:
            continue
        # Drivers take a second to load; meanwhile another process can triangulate.
        job.bench.open_soon(groups[0].backend)
        frame = frame_of(job.scene, view)
        _tell_of_snapping(job, frame)
        yield Framed(frame)
        prepared: dict[Recipe, Prepared] = {}
        needed = dict.fromkeys(recipe for group in groups for recipe in group.cases)
        in_order = [recipe for recipe in job.plan.triangulators if recipe in needed]
        for recipe, result in prepare(
            job.scene, frame, in_order, job.broken, job.bench, job.reporter
        ):
            if isinstance(result, Prepared):
                prepared[recipe] = result
            else:
                yield from _not_measured(groups, recipe, *result)
        if job.rounds:
            _time_triangulating(job, frame, prepared)
        triangles = {str(recipe): ready.triangles for recipe, ready in prepared.items()}
        yield Triangulated(frame, triangles)
        for group in groups:
            left = {recipe: case for recipe, case in group.cases.items() if recipe in prepared}
            if left and not job.bench.stopping:
                yield from _measure(job, replace(group, cases=left), frame, prepared, counted)


def _time_triangulating(job: Job, frame: Frame, prepared: Mapping[Recipe, Prepared]) -> None:
    """Triangulate again in rounds, so that it is known how much the time of it scatters."""
    once = {
        recipe: ready.triangulation.seconds
        for recipe, ready in prepared.items()
        if not recipe.upright and recipe.base != ORIGINAL
    }
    settings = job.plan.timing
    polygons = (frame.flat or frame).polygons
    found = job.bench.time_triangulating(once, polygons, settings.budget_s, job.plan.seed)
    for recipe, samples in found.items():
        triangulation = prepared[recipe].triangulation
        triangulation.samples_s, triangulation.seconds = samples, float(np.median(samples))


def _groups(job: Job, view: View, finished: Mapping[str, Record]) -> Iterator[Group]:
    for each in job.usable:
        for options in each.options:
            cases = {
                recipe: _case(job, view, recipe, each.backend, options)
                for recipe in job.plan.triangulators
            }
            yield Group(
                each.backend,
                options,
                {
                    recipe: case
                    for recipe, case in cases.items()
                    if finished.get(case.key, {}).get("status") not in DONE
                },
            )


def _case(job: Job, view: View, recipe: Recipe, backend: Backend, options: Options) -> Case:
    return Case(
        scene=job.label,
        scene_hash=job.scene.content_hash,
        view=view,
        triangulator=str(recipe),
        rasteriser=backend.rasteriser,
        device=backend.device.name,
        options=options,
    )


def _not_measured(
    groups: Iterable[Group], recipe: Recipe, status: str, reason: str
) -> Iterator[Finished]:
    for group in groups:
        if recipe in group.cases:
            yield Finished(records.problem(group.cases[recipe], status, reason))


def _measure(
    job: Job,
    group: Group,
    frame: Frame,
    prepared: Mapping[Recipe, Prepared],
    counted: Mapping[str, Record],
) -> Iterator[Finding]:
    """Count the group's cases, then time them together."""
    try:
        opened = job.bench.open(group.backend)
    except HarnessError as error:
        for case in group.cases.values():
            yield Finished(records.problem(case, "failed", str(error)))
        return
    timed = opened.timer is not None
    ready = {
        recipe: {**counted[case.key], "status": "ok"}
        for recipe, case in group.cases.items()
        if timed and case.key in counted
    }
    cases = {recipe: case for recipe, case in group.cases.items() if recipe not in ready}
    for recipe, finding in count_cases(
        cases, group.backend, group.options, frame, prepared, job.bench, job.reporter
    ):
        if isinstance(finding, Finished) or not timed:
            yield Finished(finding.record, finding.columns)
        else:
            yield finding
            ready[recipe] = finding.record
    in_order = {recipe: ready[recipe] for recipe in group.cases if recipe in ready}
    if in_order:
        yield from _time(job, group, frame, prepared, in_order)


def _time(
    job: Job,
    group: Group,
    frame: Frame,
    prepared: Mapping[Recipe, Prepared],
    ready: Mapping[Recipe, Record],
) -> Iterator[Finished]:
    """Time the counted cases together; `ready` are their records but for the time."""
    settings, backend = job.plan.timing, group.backend
    test = job.bench.open(backend).timer
    assert test is not None
    if test.gpu_s is not None and test.timer == "wall":
        job.reporter.detail(f"{backend.label}: times are the wall clock's; {test.reason}")
    likely_s = settings.processes * settings.budget_s * (len(ready) + 2)
    with job.reporter.stage(f"timing: {backend.label}", likely_s) as stage:
        groups, failures = job.bench.time(
            backend,
            {str(recipe): (frame, prepared[recipe].triangles) for recipe in ready},
            group.options,
            settings,
            job.plan.seed,
            lambda waited: stage.complete(min(waited, likely_s)),
        )
    for recipe, record in ready.items():
        name = str(recipe)
        if name in failures:
            yield Finished(records.problem(group.cases[recipe], "failed", failures[name]))
        else:
            times = records.time_fields(groups[name], name, test, settings)
            yield Finished({**record, "time": times})


def _tell_of_snapping(job: Job, frame: Frame) -> None:
    for verb, entries in (("dropped", frame.dropped), ("repaired", frame.repaired)):
        if entries:
            number, reason = entries[0]
            job.reporter.say(
                f"snapping {verb} {len(entries)} of {len(job.scene.polygons)} polygons "
                f"at {frame.view.resolution} px, e.g. polygon {number}: {reason}"
            )
