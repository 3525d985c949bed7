"""Carries out a plan: scene -> frame -> triangulations -> counters and times -> records."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from harness import environment, rasterisers
from harness.errors import UsageError
from harness.measuring.beside import Beside, Halves, done_before, head_records
from harness.measuring.cases import Runner
from harness.measuring.plan import Plan
from harness.measuring.processes import Bench, OpenWorker, Target
from harness.measuring.worker import Worker
from harness.progress import Reporter
from harness.stored.folder import Record, Store, read_run
from harness.triangulating.frames import BEFORE_TURNING, NUMBERED, SEED_MARK, is_builtin
from scenes import Scene, SceneError, load
from triangulators import UnknownName, full_name


class Part(NamedTuple):
    """A part of a scene that is measured by itself.

    label : the scene's name in its records
    triangulators : its own; () for those of the plan
    """

    label: str
    scene: Scene
    triangulators: tuple[str, ...] = ()


Split = Callable[[str, Scene], list[Part]]
"""(label, scene) -> the parts that a study takes it into."""


@dataclass
class Outcome:
    """What became of a run: its folder, its records in the order written, and how it ended."""

    path: Path
    records: list[Record]
    interrupted: bool


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
) -> Outcome:
    """Measure all cases of `plan` and store them in the folder `out`.

    resume : go on with the run in `out`; cases that have an ok or skipped record are left alone
    force : resume even where plan, code or device differ from those of the run
    open_worker : how processes are made; tests give `Inline` ones
    split : how a study takes the scene apart; by default it is measured whole
    database : model database that triangulations are read from and written to; None for none
    beside : another version of the code to measure in the same rounds

    Raises
    ------
    HarnessError
        if nothing can be measured as asked, or the folder cannot be written
    """
    began = time.perf_counter()
    plan = replace(plan, triangulators=full_names(plan.triangulators))
    scene = load_scene(plan.scene, plan.seed, reporter)
    targets = find_targets(plan)
    # Of a file only its name: the same file elsewhere is the same scene.
    label = Path(plan.scene).name
    parts = split(label, scene) if split else [Part(label, scene)]
    plans = [_plan_of(part, plan) for part in parts]
    plan = replace(plan, triangulators=_union(plans))
    facts = _facts(plan, scene)
    if beside:
        facts = beside.facts(facts)
        plans = [replace(own, triangulators=beside.names(own.triangulators)) for own in plans]
    store, done = _open_store(out, facts, resume=resume, force=force)
    with store:
        for warning in facts["warnings"]:
            reporter.warn(warning)
        bench = (beside.bench if beside else Bench)(open_worker, plan.timeout_s, database)
        frames: list[dict[str, Any]] = []
        bench.seconds["prepare"] = time.perf_counter() - began
        store.write_facts(facts)
        try:
            with stop_on_interrupt(bench, reporter):
                for number, (part, own) in enumerate(zip(parts, plans, strict=True)):
                    if len(parts) > 1:
                        reporter.say(f"{part.label} ({number + 1} of {len(parts)})")
                    runner = Runner(
                        own, part.label, part.scene, targets, store, reporter, bench, done, frames
                    )
                    runner.go(keep_geometry=split is None)
        finally:
            bench.close()
            facts["frames"] = frames or facts["frames"]
            facts["devices"] |= bench.describe()
            facts["seconds"] = {**bench.seconds, "all": time.perf_counter() - began}
            facts["interrupted"] = bench.stopping
            store.write_facts(facts)
    return Outcome(out, head_records(done.values()), bench.stopping)


def _plan_of(part: Part, plan: Plan) -> Plan:
    own = full_names(part.triangulators) if part.triangulators else plan.triangulators
    return replace(plan, triangulators=own)


def _union(plans: Sequence[Plan]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(chain.from_iterable(plan.triangulators for plan in plans)))


def full_names(triangulators: Sequence[str]) -> tuple[str, ...]:
    """Return each triangulator's full name once, e.g. optimal:overdraw for optimal.

    Raises
    ------
    UsageError
        if a name is unknown, or there is none
    """
    try:
        names = tuple(_full_name(name) for name in triangulators)
    except UnknownName as error:
        raise UsageError(str(error)) from error
    if not names:
        raise UsageError("no triangulator is named; give --triangulators fan,ear-clipping")
    return tuple(dict.fromkeys(names))


def _full_name(name: str) -> str:
    if name.endswith(f"{BEFORE_TURNING}0"):
        return _full_name(name[:-2]) + f"{BEFORE_TURNING}0"
    base, mark, number = name.partition(SEED_MARK)
    if mark and not (base in NUMBERED and number.isdecimal()):
        raise UsageError(
            f"triangulator '{name}': a seed is written random{SEED_MARK}7, "
            f"a point of the Pareto front pareto{SEED_MARK}3"
        )
    if _is_foreign(name):
        return name
    if base == "pareto" and not mark:
        mark, number = SEED_MARK, "0"
    return full_name(base) + (f"{mark}{int(number)}" if mark else "")


def _is_foreign(name: str) -> bool:
    """Whether `name` is "module:function" of an existing module, which only a worker imports."""
    module, colon, _ = name.partition(":")
    try:
        return bool(colon) and not is_builtin(name) and find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def load_scene(name: str, seed: int, reporter: Reporter) -> Scene:
    """Load a scene and say what it left out.

    Raises
    ------
    UsageError
        if it cannot be loaded
    """
    try:
        scene = load(name, seed=seed)
    except SceneError as error:
        raise UsageError(str(error)) from error
    for verb, notes in (("dropped", scene.dropped), ("repaired", scene.repaired)):
        if notes:
            which, reason = notes[0]
            more = f" (and {len(notes) - 1} more)" if len(notes) > 1 else ""
            reporter.warn(f"{scene.name}: {verb} {which}: {reason}{more}")
    return scene


def find_targets(plan: Plan) -> list[Target]:
    """Pair each rasteriser with each of the plan's devices that it knows.

    One that knows none of them, such as the CPU reference, runs on its own best device.

    Raises
    ------
    UsageError, NoRasteriser
        if a name is unknown, or a device that was asked for is not here
    """
    targets = []
    known: set[str] = set()
    for name in plan.rasterisers:
        kind = rasterisers.get(name)
        if not any(kind.supports(options) for options in plan.options):
            raise UsageError(
                f"{name} has neither multisampling nor fragment work: use opengl for "
                "--samples and --work, or add the plain case, e.g. --work 0,8"
            )
        wanted: list[str | None] = [device for device in plan.devices if kind.knows(device)]
        known.update(device for device in plan.devices if kind.knows(device))
        targets += [
            Target(name, rasterisers.find_device(name, device)) for device in wanted or [None]
        ]
    strange = [device for device in plan.devices if device not in known]
    if strange:
        rasterisers.find_device(plan.rasterisers[0], strange[0])  # raises, naming the nearest
        raise UsageError(f"no rasteriser of this run has a device '{strange[0]}'")
    return targets


def _facts(plan: Plan, scene: Scene) -> dict[str, Any]:
    """Return the content of a new run.json."""
    machine = environment.collect(plan.seed, plan.triangulators)
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
        },
        "environment": machine,
        "warnings": environment.warnings(machine),
        "frames": [],
        "devices": {},
    }


def _open_store(
    out: Path, facts: dict[str, Any], *, resume: bool, force: bool
) -> tuple[Store, dict[str, Record]]:
    """Return the folder to write to and the records that it has, by key."""
    kind = Halves if "beside" in facts else Store
    if not resume:
        return kind.create(out), {}
    store = kind.resume(out)
    before = read_run(out)
    if not force:
        _refuse_other(before.facts, facts, out)
    facts["frames"] = before.facts.get("frames", [])
    facts["devices"] = before.facts.get("devices", {})
    facts["resumed"] = [*before.facts.get("resumed", []), facts["created"]]
    facts["created"] = before.facts.get("created", facts["created"])
    if "beside" in facts:
        return store, done_before(out)
    return store, {record["key"]: record for record in before.records}


def _refuse_other(before: dict[str, Any], now: dict[str, Any], out: Path) -> None:
    """Refuse to mix two experiments in one folder."""
    differences = [
        f"plan ({key}: {before['plan'].get(key)} then, {value} now)"
        for key, value in now["plan"].items()
        if before.get("plan", {}).get(key) != value
    ]
    if before.get("scene", {}).get("hash") != now["scene"]["hash"]:
        differences.append("the scene's content")
    if before.get("environment", {}).get("code") != now["environment"]["code"]:
        differences.append("the code")
    if before.get("beside") != now.get("beside"):
        differences.append("what it is measured beside")
    if before.get("environment", {}).get("cpu") != now["environment"]["cpu"]:
        differences.append("the machine")
    if differences:
        raise UsageError(
            f"cannot resume {out}: {', '.join(differences)} differ; "
            "start a new run, or add --force to mix them"
        )


@contextmanager
def stop_on_interrupt(bench: Bench, reporter: Reporter) -> Iterator[None]:
    """Let the first Ctrl-C finish the case in flight; the second one ends at once."""

    def stop(*_: object) -> None:
        if bench.stopping:
            raise KeyboardInterrupt
        bench.stopping = True
        reporter.say("stopping after the case in flight; press Ctrl-C again to stop at once")

    before: Callable[..., Any] | int | None = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
