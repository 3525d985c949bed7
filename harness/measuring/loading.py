"""Loads the scene of a run, one of a third party in a process of its own."""

from __future__ import annotations

from harness.errors import UsageError
from harness.measuring.worker import OpenWorker, TaskFailed, Worker
from harness.progress import Reporter
from scenes import Scene, SceneError, load, registry
from scenes.spec import is_function


def load_scene(name: str, seed: int, reporter: Reporter, open_worker: OpenWorker = Worker) -> Scene:
    """Load a scene and say what was read, projected and left out.

    Raises
    ------
    UsageError
        if it cannot be loaded, or is a third party's and ends its process
    """
    scene = _load_apart(name, seed, open_worker) if _is_foreign(name) else _load(name, seed)
    if scene.notes:
        reporter.say(f"{scene.name}: {'; '.join(scene.notes)}")
    for verb, notes in (("dropped", scene.dropped), ("repaired", scene.repaired)):
        if notes:
            which, reason = notes[0]
            more = f" (and {len(notes) - 1} more)" if len(notes) > 1 else ""
            reporter.warn(f"{scene.name}: {verb} {which}: {reason}{more}")
    return scene


def _load(name: str, seed: int) -> Scene:
    try:
        if registry.is_seen(name):
            from harness.models import seen  # it takes long to import

            return seen.load(name)
        return load(name, seed=seed, attributes=False)
    except SceneError as error:
        raise UsageError(str(error)) from error


def _load_apart(name: str, seed: int, open_worker: OpenWorker) -> Scene:
    worker = open_worker(f"scene {name}", {})
    try:
        return worker.call(_load, name, seed)
    except TaskFailed as error:
        raise UsageError(f"scene {name} cannot be loaded: {error}") from error
    finally:
        worker.close()


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
