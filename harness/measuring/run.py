"""Carries out a plan: scene -> frame -> triangulations -> counters and times -> records."""

import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import shapely

from harness.errors import (
    HarnessError,
    IncompatibleRunsError,
    InputError,
    NothingMeasuredError,
    UsageError,
)
from harness.frame import ITS_OWN_VIEW, OWN_VIEWS, View, view_of
from harness.machine import environment, system
from harness.machine.environment import processor
from harness.measuring.loading import find_backends, find_broken, load_scene
from harness.measuring.other_version import FOLDER as BASE_FOLDER
from harness.measuring.other_version import OtherVersion
from harness.measuring.plan import Plan
from harness.measuring.pool import MeasuringPool
from harness.measuring.records import RunWriter
from harness.measuring.reference_draws import default_path, reference_draws
from harness.measuring.scene import SceneRun
from harness.metrics.decision import Decided, decide_all
from harness.metrics.processors import may_be_same, read_processor
from harness.progress import Reporter, detach_terminal
from harness.results.record import Record, RunFacts
from harness.results.run_folder import (
    FACTS,
    SCHEMA_VERSION,
    Run,
    RunFolder,
    read_counted,
    read_run,
)
from harness.stats.run_quality import judge_records
from harness.triangulating.recipes import ORIGINAL, Recipe
from harness.viewing import viewing_of
from harness.workers.worker import OpenWorker, Worker
from scenes import Scene
from scenes.spec import format_label as scene_label

TOLD = ("name", "units", "description", "licence", "credit", "dropped", "repaired", "notes")
"""What of a scene a run's facts tell as it is."""

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
    """Result of a measurement.

    run : the run, with the records of finished cases in the order written
    interrupted : whether it was stopped before all cases were done
    aborted : True if a second signal arrived: reports are skipped
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
        """The groups of the run with the decision about each."""
        return decide_all(self.run)


@dataclass(frozen=True)
class RunOptions:
    """How a run is made, besides what its plan says.

    resume : go on with the run in the folder; cases that have an ok or skipped record are left
        alone
    force : resume even where plan, code or device differ from those of the run
    split : how a study takes the scene apart; by default it is measured whole
    database : model database that triangulations are read from and written to; None for none
    beside : another version of the code to measure in the same rounds
    base : triangulator that tables and reports compare the others with
    """

    resume: bool = False
    force: bool = False
    split: Split | None = None
    database: Path | None = None
    beside: OtherVersion | None = None
    base: str | None = None


def run(
    plan: Plan,
    out: Path,
    reporter: Reporter,
    how: RunOptions | None = None,
    *,
    open_worker: OpenWorker = Worker,
) -> RunResult:
    """Measure all cases of `plan` and store them in the folder `out`.

    open_worker : how processes are made; tests run tasks in this one

    Raises
    ------
    HarnessError
        if nothing can be measured as asked, there is nothing to choose, or the folder cannot be
        written
    """
    began = time.perf_counter()
    how = how or RunOptions()
    pool = MeasuringPool(open_worker, plan.timeout_s, how.database, how.beside)
    try:
        # Names first: a scene may take long.
        broken = find_broken(plan.triangulators, pool)
        scene = load_scene(plan.scene, plan.seed, reporter, open_worker)
        if all(shapely.get_num_coordinates(each) == _CLOSED_TRIANGLE for each in scene.polygons):
            raise NothingMeasuredError(
                f"nothing to choose: every polygon of {plan.scene} is a triangle already; of a "
                "model, raster-harness triangulate MODEL --check says what turning diagonals saves"
            )
        if how.split is None:
            plan = _in_its_view(plan, scene)
        if viewing_of(scene) is None and any(each.base == ORIGINAL for each in plan.triangulators):
            raise UsageError(
                f"{ORIGINAL} is the triangulation that a model came with: give --scene "
                "model.glb:views=24, or leave it out"
            )
        return _measure(plan, scene, out, reporter, pool, broken, how, began)
    finally:
        pool.close(at_once=pool.stopping)


def _in_its_view(plan: Plan, scene: Scene) -> Plan:
    """Give the plan the view of map tiles or of a model, which they have of themselves.

    A model's own triangulation is drawn, too.
    """
    own = view_of(scene)
    if own.fit not in OWN_VIEWS:
        return plan
    if plan.views not in ((own,), (View(),)):
        raise UsageError(ITS_OWN_VIEW.format(OWN_VIEWS[own.fit]))
    if viewing_of(scene) is not None:
        first = Recipe(ORIGINAL)
        plan = replace(plan, triangulators=tuple(dict.fromkeys([first, *plan.triangulators])))
    return replace(plan, views=(own,))


def _measure(
    plan: Plan,
    scene: Scene,
    out: Path,
    reporter: Reporter,
    pool: MeasuringPool,
    broken: dict[Recipe, str],
    how: RunOptions,
    began: float,
) -> RunResult:
    # Of a file only its name: the same file elsewhere is the same scene.
    label = scene_label(plan.scene)
    parts = how.split(label, scene) if how.split else [Part(label, scene)]
    plans = [replace(plan, triangulators=p.triangulators or plan.triangulators) for p in parts]
    known = set(plan.triangulators)
    every = dict.fromkeys(chain.from_iterable(own.triangulators for own in plans))
    plan = replace(plan, triangulators=tuple(every))
    usable = find_backends(plan, pool, reporter)
    broken |= find_broken(set(plan.triangulators) - known, pool)
    base = how.base or (ORIGINAL if viewing_of(scene) is not None and not how.split else None)
    facts = _facts(plan, scene) | ({"base": base} if base else {})
    if beside := how.beside:
        facts["beside"] = {"base": beside.name, "commit": beside.commit, "twice": beside.twice}
        (own,) = plans
        others = [replace(recipe, other=True) for recipe in own.triangulators]
        plans = [replace(own, triangulators=(*own.triangulators, *others))]
    stores, records = open_stores(out, facts, reporter.warn, resume=how.resume, force=how.force)
    counted = {} if how.force else read_counted(out)
    pool.seconds["prepare"] = time.perf_counter() - began
    aborted = False
    with ExitStack() as stack:
        for store in stores:
            stack.enter_context(store)
        for warning in facts["warnings"]:
            reporter.warn(warning)
        writer = RunWriter(stores, records, reporter, with_drawings=not how.split)
        writer.write_facts({**facts, "interrupted": True})  # until it has come to its end
        # BASE's code triangulates elsewhere, in no round of HEAD's.
        rounds = not (how.split or how.beside)
        try:
            with _stopped_in_order(pool, reporter):
                for number, (part, own) in enumerate(zip(parts, plans, strict=True)):
                    if len(parts) > 1:
                        reporter.say(f"{part.label} ({number + 1} of {len(parts)})")
                    SceneRun(
                        plan=own,
                        label=part.label,
                        scene=part.scene,
                        usable=usable,
                        broken=broken,
                        pool=pool,
                        reporter=reporter,
                        writer=writer,
                        counted=counted,
                        rounds=rounds,
                    ).measure()
        except KeyboardInterrupt:
            aborted = pool.stopping = True
        finally:
            facts["frames"] = writer.frames or facts["frames"]
            facts["devices"] |= pool.describe()
            facts["seconds"] = {**pool.seconds, "all": time.perf_counter() - began}
            facts["interrupted"] = pool.stopping
            draws = reference_draws(records.values(), default_path())
            facts["state"] = {**vars(judge_records(records.values(), draws)), "draws": draws}
            writer.write_facts(facts)
        if not pool.stopping:
            stores[0].delete_counted()
    ours = [record for record in records.values() if not record.id.version]
    facts["schema_version"] = SCHEMA_VERSION
    return RunResult(Run(out, facts, ours), pool.stopping, aborted)


@contextmanager
def _stopped_in_order(pool: MeasuringPool, reporter: Reporter) -> Iterator[None]:
    """Let the first Ctrl-C finish the cases in flight.

    A second one, SIGTERM and SIGHUP, whose senders do not wait, raise KeyboardInterrupt.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread is told of signals
        return

    def stop(number: int, _: object) -> None:
        again, pool.stopping = pool.stopping, True
        if number == system.HANGUP:
            detach_terminal()
        if again or number != signal.SIGINT:
            raise KeyboardInterrupt
        reporter.say("stopping after the case in flight; press Ctrl-C again to stop at once")

    # What is ignored stays so, as nohup has it.
    with system.signals_handled_by(stop, lambda before: before != signal.SIG_IGN):
        yield


def open_stores(
    out: Path,
    facts: RunFacts,
    warn: Callable[[str], None],
    *,
    resume: bool,
    force: bool,
) -> tuple[list[RunFolder], dict[str, Record]]:
    """Return the folders to write to and the records that they have, by key.

    The first is the run's, the second, if there is one, that of another version's run in it.

    facts : content of the new run.json; what the old one had of the run so far is taken over
    warn : gets each problem of the old run, such as a damaged record
    force : go on even if plan, scene, code or machine differ

    Raises
    ------
    InputError
        if they differ, or the folder holds a run that is not to be resumed, or cannot be written
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
            _refuse_other(before.facts, facts, out)
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
    for folder in base:  # without facts where a kill came between the two
        if folder.is_symlink():
            raise InputError(f"{folder} is a link, which is not followed; copy what it names here")
        stores.append(
            (RunFolder.resume if (folder / FACTS).is_file() else RunFolder.create)(folder)
        )
        records += [record.with_id(version="base") for record in read_run(folder).records]
    return stores, {record.id.key: record for record in records}


def _refuse_other(before: RunFacts, now: RunFacts, out: Path) -> None:
    """Refuse to mix two experiments in one folder."""
    plan = before.get("plan", {})
    differences = [
        f"plan ({key}: {plan.get(key)} then, {value} now)"
        for key, value in now["plan"].items()
        if plan.get(key) != value
    ]
    compared = {
        "the scene's content": (before.get("scene", {}).get("hash"), now["scene"]["hash"]),
        "the code": (before.get("environment", {}).get("code"), now["environment"]["code"]),
        "what it is measured beside": (before.get("beside"), now.get("beside")),
    }
    differences += [what for what, (then, new) in compared.items() if then != new]
    if not may_be_same(read_processor(before), read_processor(now)):
        differences.append("the machine")
    if differences:
        raise IncompatibleRunsError(
            f"cannot resume {out}; since then changed: {', '.join(differences)}; "
            "start a new run, or add --force to mix them"
        )


def _facts(plan: Plan, scene: Scene) -> RunFacts:
    """Return the content of a new run.json."""
    machine = environment.collect(plan.seed, [recipe.base for recipe in plan.triangulators])
    return {
        "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "plan": plan.to_json(),
        "scene": {
            "hash": scene.content_hash,
            "polygons": len(scene.polygons),
            "parameters": {key: str(value) for key, value in scene.parameters.items()},
            **{name: getattr(scene, name) for name in TOLD},
        },
        "environment": machine,
        "cpu": processor(),
        "warnings": environment.list_warnings(machine),
        "frames": [],
        "devices": {},
    }
