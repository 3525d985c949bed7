"""Loads what a run is made with: its scene, its triangulators, its rasterisers on their devices.

What is a third party's is loaded in a process of its own.
"""

from collections.abc import Iterable
from contextlib import closing

from harness import rasterisers
from harness.errors import NoRasteriser, UsageError
from harness.machine.user_modules import allow_user_module
from harness.measuring.plan import Plan
from harness.measuring.processes import IMPORT_S, Backend, Bench, home_of, rasteriser_home
from harness.measuring.tasks import Survey, survey
from harness.measuring.worker import Limits, OpenWorker, TaskFailed, Worker
from harness.progress import Reporter
from harness.rasterisers.base import Options
from harness.triangulating.recipes import Recipe
from scenes import Scene, SceneError, load, registry
from scenes.spec import is_function

Usable = tuple[Backend, tuple[Options, ...]]
"""A backend and which of the plan's options it can draw with."""

SAID = 10
"""Polygons that are named on the screen, of those dropped and of those repaired."""


def load_scene(name: str, seed: int, reporter: Reporter, open_worker: OpenWorker = Worker) -> Scene:
    """Load a scene and say what was read, projected and left out.

    Raises
    ------
    UsageError
        if it cannot be loaded, or is a third party's and ends its process
    """
    if _is_foreign(name):
        allow_user_module(name)
        with closing(open_worker(f"scene {name}", {}, Limits())) as worker:
            try:
                scene = worker.call(_load, name, seed)
            except TaskFailed as error:
                raise UsageError(f"scene {name} cannot be loaded: {error}") from error
    else:
        scene = _load(name, seed)
    if scene.notes:
        reporter.say(f"{scene.name}: {'; '.join(scene.notes)}")
    for verb, notes in (("dropped", scene.dropped), ("repaired", scene.repaired)):
        for which, reason in notes[:SAID]:
            reporter.warn(f"{scene.name}: {verb} {which}: {reason}")
        if len(notes) > SAID:
            more = f"{scene.name}: {verb} {len(notes) - SAID:,} more"
            reporter.warn(f"{more}; a run's run.json names them")
    return scene


def _load(name: str, seed: int) -> Scene:
    try:
        if registry.is_seen(name):
            from harness.models import seen  # it takes long to import

            return seen.load(name)
        return load(name, seed=seed, attributes=False)
    except SceneError as error:
        raise UsageError(str(error)) from error


def _is_foreign(name: str) -> bool:
    """Whether it takes a third party's code to load the scene."""
    if registry.is_seen(name):
        return False
    try:
        base, _, is_file = registry.split(name)
    except SceneError:
        return False  # a file's parameters are wrong, which `load` says, too
    if is_file or base in registry.ENTRIES:
        return False
    return base in registry.names() or is_function(base)


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
                limit_s = max(IMPORT_S, bench.timeout_s)
                bench.run(home_of(recipe), recipe.load, timeout_s=limit_s)
            except TaskFailed as error:
                broken[recipe] = str(error)
    return broken


def find_backends(plan: Plan, bench: Bench, reporter: Reporter) -> list[Usable]:
    """Pair each rasteriser with each of the plan's devices that it knows, and its options.

    One that knows none of them, such as the CPU reference, runs on its own best device. One of a
    third party that dies while it is asked is left out, with a warning.

    Raises
    ------
    UsageError, NoRasteriser
        if a name is unknown, or a device that was asked for is not here, or nothing is left
    """
    usable: list[Usable] = []
    known: set[str] = set()
    for name in plan.rasterisers:
        try:
            options, devices, its = _ask(name, plan, bench)
        except TaskFailed as error:
            reporter.warn(f"rasteriser '{name}' is left out: {error}")
            continue
        if not options:
            raise UsageError(
                f"{name} has {rasterisers.get(name).lacking}: use opengl for "
                "--samples and --work, or add the plain case, e.g. --work 0,8"
            )
        known.update(its)
        usable += [(Backend(name, device), options) for device in devices]
    strange = [device for device in plan.devices if device not in known]
    if strange:
        if plan.rasterisers[0] in rasterisers.BUILT_IN:
            rasterisers.find_device(plan.rasterisers[0], strange[0])  # raises, naming the nearest
        raise UsageError(f"no rasteriser of this run has a device '{strange[0]}'")
    if not usable:
        raise NoRasteriser("no rasteriser is left that works")
    return usable


def _ask(name: str, plan: Plan, bench: Bench) -> Survey:
    """Ask a rasteriser what it can do here; a third party's only in a process of its own."""
    if name in rasterisers.BUILT_IN or (name not in rasterisers.names() and ":" not in name):
        return survey(name, plan.options, plan.devices)
    timeout_s = max(IMPORT_S, bench.timeout_s)
    home = rasteriser_home(name)
    return bench.run(home, survey, name, plan.options, plan.devices, timeout_s=timeout_s)
