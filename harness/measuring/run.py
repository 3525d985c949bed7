"""Execution of a plan: scene, frames, triangulations, counters and times, records."""

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import shapely

from harness import atomic
from harness.errors import (
    HarnessError,
    IncompatibleRunsError,
    InputError,
    NothingMeasuredError,
    UsageError,
)
from harness.frame import FIXED_VIEW_MESSAGE, FIXED_VIEWS, View, get_scene_view, get_viewing
from harness.machine import environment, system
from harness.machine.environment import describe_processor
from harness.measuring.other_version import FOLDER as BASE_FOLDER
from harness.measuring.other_version import OtherVersion
from harness.measuring.plan import Plan, find_backends, import_third_party_triangulators, load_scene
from harness.measuring.pool import MeasuringPool
from harness.measuring.records import RunWriter, get_default_path, update_reference_draws
from harness.measuring.scene import Calibrate, SceneRun
from harness.metrics.decision import Decided, decide_run
from harness.metrics.groups import may_be_same_processor, read_processor
from harness.metrics.run_quality import assess_records
from harness.progress import Reporter, detach_terminal
from harness.results.record import Record, RunFacts
from harness.results.run_folder import (
    FACTS,
    SCHEMA_VERSION,
    STORED_PROFILE,
    Run,
    read_counted,
    read_run,
)
from harness.results.run_writer import RunFolder
from harness.supervisor import allow_cleanup
from harness.triangulating.recipes import ORIGINAL, Recipe
from harness.worker import OpenWorker, Worker
from scenes import Scene
from scenes.spec import format_label as scene_label

SCENE_FIELDS = ("name", "units", "description", "licence", "credit", "dropped", "repaired", "notes")


class ScenePart(NamedTuple):
    """A separately measured part of a scene; `triangulators` () stands for those of the plan."""

    label: str
    scene: Scene
    triangulators: tuple[Recipe, ...] = ()


Split = Callable[[str, Scene], list[ScenePart]]  # divides a scene, given its label, for a study


@dataclass(frozen=True)
class RunResult:
    """Result of a measurement: the records of finished cases, in the order of writing.

    aborted : True if stopped at once, e.g. by a second Ctrl-C, so that reports are skipped
    """

    run: Run
    interrupted: bool
    aborted: bool = False

    @property
    def path(self) -> Path:
        """The run's folder."""
        return self.run.path

    @property
    def records(self) -> Sequence[Record]:
        """The records of finished cases."""
        return self.run.records

    @cached_property
    def decided(self) -> list[Decided]:
        """The run's groups of records, each with the recommendation, or None if not measured."""
        return decide_run(self.run)


@dataclass(frozen=True)
class RunOptions:
    """Options of a run that are not part of its plan.

    resume : True to continue the folder's run, except for cases with an ok or skipped record
    force : True to resume even if plan, scene, code or machine have changed since
    base : triangulator to which tables and reports compare the others
    calibrate : function that chooses optimal:calibrated's criterion in each frame
    """

    resume: bool = False
    force: bool = False
    split: Split | None = None
    database: Path | None = None
    baseline: OtherVersion | None = None
    base: str | None = None
    profile: bytes | None = None
    calibrate: Calibrate | None = None


def run(
    plan: Plan,
    out: Path,
    reporter: Reporter,
    options: RunOptions | None = None,
    *,
    open_worker: OpenWorker = Worker,
) -> RunResult:
    """Measure all cases of `plan` and store the run in the folder `out`.

    Parameters
    ----------
    plan : Plan
        Cases to measure, and how.
    out : Path
        Folder of the run.
    reporter : Reporter
        Receives progress and warnings.
    options : RunOptions, optional
        Options that are not part of the plan.
    open_worker : callable
        Starts a worker process; tests pass a class that runs tasks in the current process.

    Returns
    -------
    RunResult

    Raises
    ------
    HarnessError
        If no case can be measured, all polygons are triangles, or the folder cannot be written.
    """
    start = time.perf_counter()
    options = options or RunOptions()
    pool = MeasuringPool(open_worker, plan.timeout_s, options.database, options.baseline)
    try:
        # Names are checked first: loading a scene may take long.
        broken = import_third_party_triangulators(plan.triangulators, pool)
        scene = load_scene(plan.scene, plan.seed, reporter, open_worker)
        # A triangle has four coordinates in shapely, which repeats the first one at the end.
        if all(shapely.get_num_coordinates(polygon) == 4 for polygon in scene.polygons):
            raise NothingMeasuredError(
                f"{plan.scene}: nothing to measure (every polygon is a triangle); for a model, "
                "raster-harness triangulate MODEL --check reports what flipping edges would save"
            )
        if options.split is None:
            plan = _set_scene_view(plan, scene)
        if get_viewing(scene) is None and any(r.base == ORIGINAL for r in plan.triangulators):
            raise UsageError(
                f"{ORIGINAL}: requires a model with views; give --scene model.glb:views=24, or "
                "omit the triangulator"
            )
        return _measure_parts(plan, scene, out, reporter, pool, broken, options, start)
    finally:
        pool.close(at_once=pool.stopping)


def _set_scene_view(plan: Plan, scene: Scene) -> Plan:
    """Return the plan with the view and triangulation (ORIGINAL) that the scene defines, if any."""
    view = get_scene_view(scene)
    if view.fit not in FIXED_VIEWS:
        return plan
    if plan.views not in ((view,), (View(),)):
        raise UsageError(FIXED_VIEW_MESSAGE.format(FIXED_VIEWS[view.fit]))
    if get_viewing(scene) is not None:
        first = Recipe(ORIGINAL)
        plan = replace(plan, triangulators=tuple(dict.fromkeys([first, *plan.triangulators])))
    return replace(plan, views=(view,))


def _measure_parts(
    plan: Plan,
    scene: Scene,
    out: Path,
    reporter: Reporter,
    pool: MeasuringPool,
    broken: dict[Recipe, str],
    options: RunOptions,
    start: float,
) -> RunResult:
    # A file's label omits the folder, as the same file in another folder is the same scene.
    label = scene_label(plan.scene)
    parts = options.split(label, scene) if options.split else [ScenePart(label, scene)]
    plans = [replace(plan, triangulators=p.triangulators or plan.triangulators) for p in parts]
    loaded = set(plan.triangulators)
    recipes = dict.fromkeys(chain.from_iterable(part.triangulators for part in plans))
    plan = replace(plan, triangulators=tuple(recipes))
    usable = find_backends(plan, pool, reporter)
    broken |= import_third_party_triangulators(set(plan.triangulators) - loaded, pool)
    base = options.base or (
        ORIGINAL if get_viewing(scene) is not None and not options.split else None
    )
    facts = _make_facts(plan, scene) | ({"base": base} if base else {})
    if baseline := options.baseline:
        facts["beside"] = {
            "base": baseline.name,
            "commit": baseline.commit,
            "twice": baseline.twice,
        }
        (head,) = plans
        base_recipes = [replace(recipe, other=True) for recipe in head.triangulators]
        plans = [replace(head, triangulators=(*head.triangulators, *base_recipes))]
    stores, records = open_stores(
        out, facts, reporter.warn, resume=options.resume, force=options.force
    )
    counted = {} if options.force else read_counted(out)
    pool.seconds["prepare"] = time.perf_counter() - start
    aborted = False
    with ExitStack() as stack:
        for store in stores:
            stack.enter_context(store)
        for warning in facts["warnings"]:
            reporter.warn(warning)
        writer = RunWriter(stores, records, reporter, with_drawings=not options.split)
        if options.profile is not None:
            atomic.write(out / STORED_PROFILE, options.profile)
        writer.write_facts({**facts, "interrupted": True})  # until the run has finished
        # Triangulation is timed in interleaved rounds, with two exceptions: --beside triangulates
        # in another process, and a study that splits the scene compares draw times only.
        rounds = not (options.split or options.baseline)
        try:
            with _handle_signals(pool, reporter):
                for number, (part, part_plan) in enumerate(zip(parts, plans, strict=True)):
                    if len(parts) > 1:
                        reporter.say(f"{part.label} ({number + 1} of {len(parts)})")
                    SceneRun(
                        plan=part_plan,
                        label=part.label,
                        scene=part.scene,
                        usable=usable,
                        broken=broken,
                        pool=pool,
                        reporter=reporter,
                        writer=writer,
                        counted=counted,
                        rounds=rounds,
                        calibrate=options.calibrate,
                    ).measure()
        except KeyboardInterrupt:
            aborted = pool.stopping = True
        finally:
            facts["frames"] = writer.frames or facts["frames"]
            facts["devices"] |= pool.describe_devices()
            facts["seconds"] = {**pool.seconds, "all": time.perf_counter() - start}
            facts["interrupted"] = pool.stopping
            draws = update_reference_draws(records.values(), get_default_path())
            facts["state"] = {**vars(assess_records(records.values(), draws)), "draws": draws}
            writer.write_facts(facts)
        if not pool.stopping:
            stores[0].delete_counted()
    head_records = [record for record in records.values() if not record.id.version]
    facts["schema_version"] = SCHEMA_VERSION
    return RunResult(Run(out, facts, head_records), pool.stopping, aborted)


@contextmanager
def _handle_signals(pool: MeasuringPool, reporter: Reporter) -> Iterator[None]:
    """During the block, let the first Ctrl-C stop the run only after the timing in progress.

    All other signals raise KeyboardInterrupt at once. So does Ctrl-C while nothing is timed,
    because a triangulation may take hours, and counters are stored already.
    """

    def stop(number: int, _: object) -> None:
        is_second, pool.stopping = pool.stopping, True
        if number == system.HANGUP:
            detach_terminal()
        at_once = is_second or number != signal.SIGINT or not pool.is_timing
        allow_cleanup(unlimited=not at_once)
        if at_once:
            raise KeyboardInterrupt
        reporter.say("stopping after the timing in progress; press Ctrl-C again to stop at once")

    with system.handle_signals(stop):
        yield


def open_stores(
    out: Path,
    facts: RunFacts,
    warn: Callable[[str], None],
    *,
    resume: bool,
    force: bool,
) -> tuple[list[RunFolder], dict[str, Record]]:
    """Create or open the run's folder; return the stores, and the records of a resumed run by key.

    With an interleaved baseline there are two stores. `facts` receives fields of a resumed run.
    """
    base = [out / BASE_FOLDER] if "beside" in facts else []
    if not resume:
        return [RunFolder.create(folder) for folder in [out, *base]], {}
    store = RunFolder.resume(out)
    before = read_run(out)
    for problem in before.problems:
        warn(problem)
    if not force:
        try:
            _refuse_differences(before.facts, facts, out)
        except HarnessError:
            store.close()
            raise
    if "base" not in facts and "base" in before.facts:
        facts["base"] = before.facts["base"]
    facts["frames"] = before.facts.get("frames", [])
    facts["devices"] = before.facts.get("devices", {})
    facts["resumed"] = [*before.facts.get("resumed", []), facts["created"]]
    facts["created"] = before.facts.get("created", facts["created"])
    stores, records = [store], list(before.records)
    for folder in base:
        if folder.is_symlink():
            raise InputError(f"{folder}: is a symbolic link; copy the target instead")
        # A run that was killed early has no run.json in the baseline's folder.
        open_folder = RunFolder.resume if (folder / FACTS).is_file() else RunFolder.create
        stores.append(open_folder(folder))
        records += [record.with_id(version="base") for record in read_run(folder).records]
    return stores, {record.id.key: record for record in records}


def _refuse_differences(before: RunFacts, facts: RunFacts, out: Path) -> None:
    """Raise IncompatibleRunsError unless a run with these facts may resume the run in `out`."""
    plan = before.get("plan", {})
    differences = [
        f"plan ({key}: {plan.get(key)} then, {value} now)"
        for key, value in facts["plan"].items()
        if plan.get(key) != value
    ]
    compared = {
        "the scene's content": (before.get("scene", {}).get("hash"), facts["scene"]["hash"]),
        "the code": (before.get("environment", {}).get("code"), facts["environment"]["code"]),
        "the baseline": (before.get("beside"), facts.get("beside")),
    }
    differences += [name for name, (then, new) in compared.items() if then != new]
    if not may_be_same_processor(read_processor(before), read_processor(facts)):
        differences.append("the machine")
    if differences:
        raise IncompatibleRunsError(
            f"{out}: cannot be resumed, as these changed: {', '.join(differences)}; start a new "
            "run, or add --force to mix the results"
        )


def _make_facts(plan: Plan, scene: Scene) -> RunFacts:
    machine = environment.collect_facts(plan.seed, [recipe.base for recipe in plan.triangulators])
    return {
        "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "plan": plan.to_json(),
        "scene": {
            "hash": scene.content_hash,
            "polygons": len(scene.polygons),
            "parameters": {key: str(value) for key, value in scene.parameters.items()},
            **{name: getattr(scene, name) for name in SCENE_FIELDS},
        },
        "environment": machine,
        "cpu": describe_processor(),
        "warnings": environment.list_warnings(machine),
        "frames": [],
        "devices": {},
    }
