"""The plan of a run, and loading of the scene, triangulators and devices that it names."""

import json
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field
from typing import Any

from harness import rasterisers
from harness.errors import InputError, NoRasteriserError, UsageError
from harness.frame import View, is_model_with_views
from harness.machine.process import allow_user_module
from harness.measuring.pool import (
    MIN_IMPORT_TIMEOUT_S,
    Backend,
    MeasuringPool,
    get_rasteriser_worker,
    get_triangulator_worker,
)
from harness.measuring.tasks import Supported, find_supported
from harness.progress import Reporter
from harness.rasterisers.base import Options
from harness.results.parsing import FieldError, validate_json
from harness.settings import DEFAULT_TRIANGULATORS, TIMEOUT_S, TimingSettings
from harness.triangulating.recipes import Recipe, parse_all
from harness.triangulating.triangulate import describe_large_polygon
from harness.worker import Limits, OpenWorker, TaskError, Worker
from scenes import Scene, SceneError, load, registry
from scenes.spec import is_function

UsableBackend = tuple[Backend, tuple[Options, ...]]
"""A backend, and those of the plan's options that it supports."""

MESSAGE_AFTER_S = 5.0  # seconds of loading after which a line gives the reason of the delay

QUADRATIC_TEST = "the test of validity takes time quadratic in a polygon's vertices; Ctrl-C stops"

MAX_POLYGONS_NAMED = 10  # maximum number of dropped or repaired polygons named on the screen


@dataclass(frozen=True)
class Plan:
    """The experiment of a run; two runs of equal plans are comparable.

    Parameters
    ----------
    scene : str
        Name of a scene or path of a file, optionally with parameters, e.g. "city:limit=100".
    seed : int
        Seed of the scene, of random triangulators and of the order of timing.
    triangulators : tuple of Recipe
        Triangulators, see `harness.triangulating.recipes.parse_all`.
    rasterisers, devices : tuple of str
        Names of rasterisers and devices; if `devices` is empty, each rasteriser's best device.
    views : tuple of View
        Mappings of the scene to the viewport.
    options : tuple of Options
        Options of drawing; all cases are measured with each.
    timing : TimingSettings
        Precision and limits of timing.
    timeout_s : float
        Time limit of a triangulation, count or timing task.
    """

    scene: str
    seed: int = 0
    triangulators: tuple[Recipe, ...] = field(
        default_factory=lambda: parse_all(DEFAULT_TRIANGULATORS)
    )
    rasterisers: tuple[str, ...] = ("opengl",)
    devices: tuple[str, ...] = ()
    views: tuple[View, ...] = (View(),)
    options: tuple[Options, ...] = (Options(),)
    timing: TimingSettings = field(default_factory=TimingSettings)
    timeout_s: float = TIMEOUT_S

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values: triangulators by name, coefficients in "calibration"."""
        calibrations = [recipe.calibration for recipe in self.triangulators]
        calibration = next((terms for terms in calibrations if terms is not None), None)
        values = asdict(self)
        timing = values["timing"]
        # Omit fields that older records do not have, if they have the default value.
        if self.timing.processes == 1:
            del timing["processes"]
        if self.timing.limit_s is None:
            del timing["limit_s"]
        values |= {
            "triangulators": [str(recipe) for recipe in self.triangulators],
            "options": [options.to_json() for options in self.options],
            "calibration": None if calibration is None else dict(calibration),
        }
        document: dict[str, Any] = json.loads(json.dumps(values))
        return document

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "Plan":
        """Return the plan from the values that `to_json` returned."""
        recipes = parse_all(
            values.get("triangulators") or (),
            seed=values.get("seed", 0),
            calibration=values.get("calibration"),
        )
        content = {**values, "triangulators": [asdict(recipe) for recipe in recipes]}
        try:
            plan: Plan = validate_json(cls, content)
        except FieldError as error:
            raise InputError(f"plan: {error}") from None
        return plan


def load_scene(name: str, seed: int, reporter: Reporter, open_worker: OpenWorker = Worker) -> Scene:
    """Load a scene, in a worker if third-party code loads it; print notes and skipped polygons."""
    if _is_loaded_by_third_party(name):
        allow_user_module(name)
        with closing(open_worker(f"scene {name}", {}, Limits())) as worker:
            try:
                scene = worker.call(_load_scene_or_model, name, seed)
            except TaskError as error:
                raise InputError(f"scene {name} cannot be loaded: {error}") from error
    else:
        with reporter.say_if_long(f"still loading {name}: {QUADRATIC_TEST}", MESSAGE_AFTER_S):
            scene = _load_scene_or_model(name, seed)
    if line := describe_large_polygon(scene.polygons):
        reporter.say(f"{scene.name}: {line}")
    if scene.notes:
        reporter.say(f"{scene.name}: {'; '.join(scene.notes)}")
    for verb, notes in (("dropped", scene.dropped), ("repaired", scene.repaired)):
        for polygon, reason in notes[:MAX_POLYGONS_NAMED]:
            reporter.warn(f"{scene.name}: {verb} {polygon}: {reason}")
        if len(notes) > MAX_POLYGONS_NAMED:
            more = f"{scene.name}: {verb} {len(notes) - MAX_POLYGONS_NAMED:,} more"
            reporter.warn(f"{more}; see run.json of a run for all")
    return scene


def _load_scene_or_model(name: str, seed: int) -> Scene:
    try:
        if is_model_with_views(name):
            from harness.models import seen  # slow to import

            return seen.load(name)
        return load(name, seed=seed, attributes=False)
    except SceneError as error:
        raise InputError(str(error)) from error


def _is_loaded_by_third_party(name: str) -> bool:
    if is_model_with_views(name):
        return False
    try:
        base, _, is_file = registry.split_parameters(name)
    except SceneError:
        return False  # invalid parameters of a file; `load` reports these
    if is_file or base in registry.ENTRIES:
        return False
    return base in registry.names() or is_function(base)


def import_third_party_triangulators(
    recipes: Iterable[Recipe], pool: MeasuringPool
) -> dict[Recipe, str]:
    """Import third-party triangulators; return those that crash, with the reasons."""
    broken = {}
    for recipe in recipes:
        if not recipe.builtin:
            try:
                limit_s = max(MIN_IMPORT_TIMEOUT_S, pool.timeout_s)
                pool.run(get_triangulator_worker(recipe), recipe.load, timeout_s=limit_s)
            except TaskError as error:
                broken[recipe] = str(error)
    return broken


def find_backends(plan: Plan, pool: MeasuringPool, reporter: Reporter) -> list[UsableBackend]:
    """Return the plan's backends: each rasteriser on each requested device that it supports.

    A rasteriser that supports no requested device runs on its own best device. A third-party
    rasteriser that crashes is skipped, with a warning.
    """
    usable: list[UsableBackend] = []
    known_devices: set[str] = set()
    for name in plan.rasterisers:
        try:
            options, devices, device_names = _find_supported(name, plan, pool)
        except TaskError as error:
            reporter.warn(f"rasteriser '{name}': skipped ({error})")
            continue
        if not options:
            raise UsageError(
                f"rasteriser '{name}': unsupported options (it has "
                f"{rasterisers.get(name).limitation}); use opengl for --samples, --work and "
                "--texture, or add a supported case, e.g. --work 0,8"
            )
        known_devices.update(device_names)
        usable += [(Backend(name, device), options) for device in devices]
    unknown_devices = [device for device in plan.devices if device not in known_devices]
    if unknown_devices:
        if plan.rasterisers[0] in rasterisers.BUILT_IN:
            # raises with a suggestion
            rasterisers.find_device(plan.rasterisers[0], unknown_devices[0])
        raise UsageError(
            f"device '{unknown_devices[0]}': unknown to all rasterisers of this run; "
            "see: raster-harness list rasterisers"
        )
    if not usable:
        raise NoRasteriserError("all rasterisers of the run failed; see the warnings above")
    return usable


def _find_supported(name: str, plan: Plan, pool: MeasuringPool) -> Supported:
    """Call `find_supported`, in a worker process if the rasteriser is third-party code."""
    if name in rasterisers.BUILT_IN or (name not in rasterisers.names() and ":" not in name):
        return find_supported(name, plan.options, plan.devices)
    timeout_s = max(MIN_IMPORT_TIMEOUT_S, pool.timeout_s)
    worker = get_rasteriser_worker(name)
    return pool.run(worker, find_supported, name, plan.options, plan.devices, timeout_s=timeout_s)
