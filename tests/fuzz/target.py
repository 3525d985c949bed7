"""Targets, the search within a time limit, and the storage of failing inputs."""

import faulthandler
import hashlib
import importlib
import json
import pkgutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import UnsatisfiedAssumption
from hypothesis.strategies import SearchStrategy

REGRESSIONS = Path(__file__).parent / "regressions"
"""Stored inputs: a folder for each target, a JSON file for each input."""

UNFINISHED = "unfinished.json"
"""File with the input being checked, which remains if the check ends the process."""

TIMEOUT_S = 120.0
"""Time limit for a check, after which the process exits."""

MAX_EXAMPLES = 200
"""Number of inputs between checks of the clock."""

Check = Callable[[Any], object]


@dataclass(frozen=True)
class Target:
    """A guarantee: `check` raises no error for any JSON value of the strategy `inputs`."""

    name: str
    inputs: SearchStrategy[Any]
    check: Check


_registry: dict[str, Target] = {}


def target(name: str, inputs: SearchStrategy[Any]) -> Callable[[Check], Check]:
    def register(check: Check) -> Check:
        assert name not in _registry, f"duplicate target {name}"
        _registry[name] = Target(name, inputs, check)
        return check

    return register


def load_targets() -> dict[str, Target]:
    package = importlib.import_module("tests.fuzz.targets")
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{package.__name__}.{module.name}")
    return dict(sorted(_registry.items()))


def search_inputs(
    target: Target,
    seconds: float,
    regressions: Path = REGRESSIONS,
    clock: Callable[[], float] = time.monotonic,
) -> int:
    """Check random inputs for `seconds`; return the number, or store and raise a failure."""
    deadline = clock() + seconds
    folder = regressions / target.name
    count = 0
    failing: list[Any] = []

    @settings(
        derandomize=False,
        database=None,
        deadline=None,
        max_examples=MAX_EXAMPLES,
        phases=(Phase.generate, Phase.target, Phase.shrink),
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
    )
    @given(target.inputs)
    def attempt(value: Any) -> None:
        nonlocal count
        if clock() >= deadline and not failing:
            return
        count += 1
        with _store_in_flight(folder, value):
            try:
                target.check(value)
            except UnsatisfiedAssumption:
                raise
            except Exception:
                failing.append(value)
                raise

    try:
        while clock() < deadline:
            attempt()
    except Exception as error:
        if failing:  # Hypothesis checks the smallest one last
            error.add_note(f"stored as {store_input(folder, failing[-1])}")
        raise
    return count


def store_input(folder: Path, value: Any) -> Path:
    text = json.dumps(value, indent=1) + "\n"
    file = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:12]}.json"
    folder.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


@contextmanager
def _store_in_flight(folder: Path, value: Any) -> Iterator[None]:
    """Store the input during a check, so that it remains if the check ends or hangs the process."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / UNFINISHED
    file.write_text(json.dumps(value))
    faulthandler.dump_traceback_later(TIMEOUT_S, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        file.unlink()
