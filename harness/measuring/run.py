"""Carries out a plan: scene -> frame -> triangulations -> counters and times -> records."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import shapely

from harness.errors import NothingMeasured
from harness.machine import environment
from harness.machine.processor import processor
from harness.machine.state import default_path, state_of
from harness.measuring.backends import find_backends
from harness.measuring.cases import Job, measure_scene
from harness.measuring.findings import Counted, Finding, Finished, Framed, Triangulated
from harness.measuring.loading import load_scene
from harness.measuring.plan import Plan
from harness.measuring.processes import Bench
from harness.measuring.resuming import open_store
from harness.measuring.signals import stopped_in_order
from harness.measuring.two_versions import Beside, head_records
from harness.measuring.worker import OpenWorker, TaskFailed, Worker
from harness.progress import Reporter
from harness.stored import drawings
from harness.stored.folder import Record, Store, read_counted
from harness.triangulating.recipes import Recipe
from scenes import Scene
from scenes.spec import label as scene_label

_CLOSED_TRIANGLE = 4
"""Coordinates that shapely counts of a triangle, whose first vertex is there twice."""


class Part(NamedTuple):
    """A part of a scene that is measured by itself.

    label : the scene's name in its records
    triangulators : its own; () for those of the plan
    """

    label: str
    scene: Scene
    triangulators: tuple[Recipe, ...] = ()


Split = Callable[[str, Scene], list[Part]]
"""(label, scene) -> the parts that a study takes it into."""


@dataclass(frozen=True)
class RunResult:
    """What became of a run.

    path : its folder
    records : of finished cases, in the order written
    interrupted : whether it was stopped before all were done
    hurried : whether whoever stopped it does not wait
    """

    path: Path
    records: list[Record]
    interrupted: bool
    hurried: bool = False


def run(
    plan: Plan,
    out: Path,
    reporter: Reporter,
    *,
    resume: bool = False,
    force: bool = False,
    open_worker: OpenWorker = Worker,
    split: Split | None = None,
    database: Path | None = None,
    beside: Beside | None = None,
    base: str | None = None,
) -> RunResult:
    """Measure all cases of `plan` and store them in the folder `out`.

    resume : go on with the run in `out`; cases that have an ok or skipped record are left alone
    force : resume even where plan, code or device differ from those of the run
    open_worker : how processes are made; tests give `Inline` ones
    split : how a study takes the scene apart; by default it is measured whole
    database : model database that triangulations are read from and written to; None for none
    beside : another version of the code to measure in the same rounds
    base : triangulator that tables and reports compare the others with

    Raises
    ------
    HarnessError
        if nothing can be measured as asked, there is nothing to choose, or the folder cannot be
        written
    """
    began = time.perf_counter()
    bench = (beside.bench if beside else Bench)(open_worker, plan.timeout_s, database)
    try:
        find_broken(plan.triangulators, bench)  # names first: a scene may take long
        scene = load_scene(plan.scene, plan.seed, reporter, open_worker)
        if (shapely.get_num_coordinates(scene.polygons) == _CLOSED_TRIANGLE).all():
            raise NothingMeasured(
                f"nothing to choose: every polygon of {plan.scene} is a triangle already"
            )
        return _run(plan, scene, out, reporter, bench, began, resume, force, split, beside, base)
    finally:
        bench.close(at_once=bench.stopping)


def _run(
    plan: Plan,
    scene: Scene,
    out: Path,
    reporter: Reporter,
    bench: Bench,
    began: float,
    resume: bool,
    force: bool,
    split: Split | None,
    beside: Beside | None,
    base: str | None,
) -> RunResult:
    # Of a file only its name: the same file elsewhere is the same scene.
    label = scene_label(plan.scene)
    parts = split(label, scene) if split else [Part(label, scene)]
    plans = [_plan_of(part, plan) for part in parts]
    plan = replace(plan, triangulators=_union(plans))
    usable = find_backends(plan, bench, reporter)
    broken = find_broken(plan.triangulators, bench)
    facts = _facts(plan, scene) | ({"base": base} if base else {})
    if beside:
        facts["beside"] = beside.facts()
        plans = [replace(own, triangulators=beside.recipes(own.triangulators)) for own in plans]
    store, records = open_store(out, facts, resume=resume, force=force)
    counted = {} if force else read_counted(out)
    bench.seconds["prepare"] = time.perf_counter() - began
    hurried = False
    with store:
        for warning in facts["warnings"]:
            reporter.warn(warning)
        store.write_facts({**facts, "interrupted": True})  # until it has come to its end
        frames: list[dict[str, Any]] = []
        try:
            with stopped_in_order(bench, reporter):
                for number, (part, own) in enumerate(zip(parts, plans, strict=True)):
                    if len(parts) > 1:
                        reporter.say(f"{part.label} ({number + 1} of {len(parts)})")
                    job = Job(own, part.label, part.scene, usable, broken, bench, reporter)
                    # BASE's code triangulates elsewhere, in no round of HEAD's.
                    job = job if split or beside else replace(job, rounds=True)
                    for finding in measure_scene(job, records, counted):
                        _keep(finding, store, records, frames, reporter, drawings_too=not split)
        except KeyboardInterrupt:
            hurried = bench.stopping = True
        finally:
            facts["frames"] = frames or facts["frames"]
            facts["devices"] |= bench.describe()
            facts["seconds"] = {**bench.seconds, "all": time.perf_counter() - began}
            facts["interrupted"] = bench.stopping
            facts["state"] = state_of(records.values(), default_path())
            store.write_facts(facts)
        if not bench.stopping:
            store.drop_counted()
    return RunResult(out, head_records(records.values()), bench.stopping, hurried)


def _keep(
    finding: Finding,
    store: Store,
    records: dict[str, Record],
    frames: list[dict[str, Any]],
    reporter: Reporter,
    *,
    drawings_too: bool,
) -> None:
    """Store what was found, and add it to the run's records and frames."""
    match finding:
        case Framed():
            frames.append(finding.facts())
        case Triangulated(frame, triangles) if drawings_too:
            drawings.write(store, frame, triangles)
        case Counted(record, columns):
            if columns is not None:
                store.write_arrays(record["key"], columns)
            store.append_counted({**record, "status": "counted"})
        case Finished(record, columns):
            if columns is not None:
                store.write_arrays(record["key"], columns)
            store.append(record)
            records[record["key"]] = record
            reporter.detail(_in_short(record))
            if record["status"] == "failed":
                reporter.warn(
                    f"{record['triangulator']} on {record['device']} failed: {record['reason']}"
                )


def _in_short(record: Record) -> str:
    view = f"{record['resolution']} px, {record['rotation']:g} degrees"
    where = f"{record['scene']}, {view}: {record['triangulator']}, {record['rasteriser']}"
    time = record.get("time")
    result = f"{time['median_s'] * 1e3:.4g} ms" if time else record["reason"] or "counted"
    return f"{where} on {record['device']}: {record['status']}, {result}"


def find_broken(recipes: Iterable[Recipe], bench: Bench) -> dict[Recipe, str]:
    """Load every third party's triangulator; return those that die of it, and how.

    Raises
    ------
    UsageError
        if one is not there, or cannot be imported: nothing is measured then
    """
    broken = {}
    for recipe in recipes:
        if not recipe.builtin:
            try:
                bench.load(recipe)
            except TaskFailed as error:
                broken[recipe] = str(error)
    return broken


def _plan_of(part: Part, plan: Plan) -> Plan:
    return replace(plan, triangulators=part.triangulators or plan.triangulators)


def _union(plans: Sequence[Plan]) -> tuple[Recipe, ...]:
    return tuple(dict.fromkeys(chain.from_iterable(plan.triangulators for plan in plans)))


def _facts(plan: Plan, scene: Scene) -> dict[str, Any]:
    """Return the content of a new run.json."""
    machine = environment.collect(plan.seed, [recipe.base for recipe in plan.triangulators])
    return {
        "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "plan": plan.to_json(),
        "scene": {
            "name": scene.name,
            "hash": scene.content_hash,
            "polygons": len(scene.polygons),
            "units": scene.units,
            "description": scene.description,
            "licence": scene.licence,
            "credit": scene.credit,
            "parameters": {key: str(value) for key, value in scene.parameters.items()},
            "dropped": [list(note) for note in scene.dropped],
            "repaired": [list(note) for note in scene.repaired],
            "notes": list(scene.notes),
        },
        "environment": machine,
        "cpu": processor(),
        "warnings": environment.warnings(machine),
        "frames": [],
        "devices": {},
    }
