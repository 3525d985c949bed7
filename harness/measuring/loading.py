"""Loads the scene, triangulators, rasterisers and devices of a run.

Third-party code is loaded in a worker process.
"""

from collections.abc import Iterable
from contextlib import closing

from harness import rasterisers
from harness.errors import InputError, NoRasteriserError, UsageError
from harness.machine.user_modules import allow_user_module
from harness.measuring.plan import Plan
from harness.measuring.pool import (
    MIN_IMPORT_TIMEOUT_S,
    Backend,
    MeasuringPool,
    worker_of_rasteriser,
    worker_of_recipe,
)
from harness.measuring.tasks import Survey, survey
from harness.progress import Reporter
from harness.rasterisers.base import Options
from harness.triangulating.recipes import Recipe
from harness.viewing import is_model_with_views
from harness.workers.worker import Limits, OpenWorker, TaskError, Worker
from scenes import Scene, SceneError, load, registry
from scenes.spec import is_function

Usable = tuple[Backend, tuple[Options, ...]]
"""A backend and which of the plan's options it can draw with."""

MAX_POLYGONS_NAMED = 10
"""Dropped polygons, and repaired polygons, that are named on the screen."""


def load_scene(name: str, seed: int, reporter: Reporter, open_worker: OpenWorker = Worker) -> Scene:
    """Load a scene and print what was read, projected and skipped.

    Raises
    ------
    InputError
        if it cannot be loaded, or its third-party code ends the process
    """
    if _is_foreign(name):
        allow_user_module(name)
        with closing(open_worker(f"scene {name}", {}, Limits())) as worker:
            try:
                scene = worker.call(_load, name, seed)
            except TaskError as error:
                raise InputError(f"scene {name} cannot be loaded: {error}") from error
    else:
        scene = _load(name, seed)
    if scene.notes:
        reporter.say(f"{scene.name}: {'; '.join(scene.notes)}")
    for verb, notes in (("dropped", scene.dropped), ("repaired", scene.repaired)):
        for which, reason in notes[:MAX_POLYGONS_NAMED]:
            reporter.warn(f"{scene.name}: {verb} {which}: {reason}")
        if len(notes) > MAX_POLYGONS_NAMED:
            more = f"{scene.name}: {verb} {len(notes) - MAX_POLYGONS_NAMED:,} more"
            reporter.warn(f"{more}; a run's run.json names them")
    return scene


def _load(name: str, seed: int) -> Scene:
    try:
        if is_model_with_views(name):
            from harness.models import seen  # it takes long to import

            return seen.load(name)
        return load(name, seed=seed, attributes=False)
    except SceneError as error:
        raise InputError(str(error)) from error


def _is_foreign(name: str) -> bool:
    """Return whether third-party code loads the scene."""
    if is_model_with_views(name):
        return False
    try:
        base, _, is_file = registry.split_parameters(name)
    except SceneError:
        return False  # wrong parameters of a file; `load` reports them
    if is_file or base in registry.ENTRIES:
        return False
    return base in registry.names() or is_function(base)


def find_broken(recipes: Iterable[Recipe], pool: MeasuringPool) -> dict[Recipe, str]:
    """Load all third-party triangulators; return those that crash, and why.

    Raises
    ------
    UsageError
        if one cannot be imported: nothing is measured then
    """
    broken = {}
    for recipe in recipes:
        if not recipe.builtin:
            try:
                limit_s = max(MIN_IMPORT_TIMEOUT_S, pool.timeout_s)
                pool.run(worker_of_recipe(recipe), recipe.load, timeout_s=limit_s)
            except TaskError as error:
                broken[recipe] = str(error)
    return broken


def find_backends(plan: Plan, pool: MeasuringPool, reporter: Reporter) -> list[Usable]:
    """Pair each rasteriser with its options and with the plan's devices that it supports.

    A rasteriser that supports none of them, such as the CPU reference, runs on its best device. A
    third-party rasteriser that crashes is skipped, with a warning.

    Raises
    ------
    UsageError, NoRasteriserError
        if a name is unknown, a requested device is missing, or no rasteriser is left
    """
    usable: list[Usable] = []
    known: set[str] = set()
    for name in plan.rasterisers:
        try:
            options, devices, supported = _ask(name, plan, pool)
        except TaskError as error:
            reporter.warn(f"rasteriser '{name}' is skipped: {error}")
            continue
        if not options:
            raise UsageError(
                f"{name} has {rasterisers.get(name).limitation}: use opengl for "
                "--samples and --work, or add the plain case, e.g. --work 0,8"
            )
        known.update(supported)
        usable += [(Backend(name, device), options) for device in devices]
    strange = [device for device in plan.devices if device not in known]
    if strange:
        if plan.rasterisers[0] in rasterisers.BUILT_IN:
            rasterisers.find_device(plan.rasterisers[0], strange[0])  # raises, naming the nearest
        raise UsageError(f"no rasteriser of this run has a device '{strange[0]}'")
    if not usable:
        raise NoRasteriserError("no rasteriser is left that works")
    return usable


def _ask(name: str, plan: Plan, pool: MeasuringPool) -> Survey:
    """Ask a rasteriser for its devices and options; a third-party one in a worker process."""
    if name in rasterisers.BUILT_IN or (name not in rasterisers.names() and ":" not in name):
        return survey(name, plan.options, plan.devices)
    timeout_s = max(MIN_IMPORT_TIMEOUT_S, pool.timeout_s)
    home = worker_of_rasteriser(name)
    return pool.run(home, survey, name, plan.options, plan.devices, timeout_s=timeout_s)
