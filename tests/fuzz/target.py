"""What a target is, how one is searched under a time limit, and where its failures are kept."""

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

FOUND = Path(__file__).parent / "found"
"""Kept inputs: a folder a target, a JSON file an input."""

UNFINISHED = "unfinished.json"
"""Holds the input that is being checked; it stays behind where that ended the process."""

PATIENCE_S = 120.0
"""A check that takes longer counts as hanging; the process is ended."""

ROUND = 200
"""Inputs that Hypothesis is asked for at a time: the clock is read between."""

Check = Callable[[Any], object]


@dataclass(frozen=True)
class Target:
    """A promise to search for exceptions from.

    inputs : strategy of values that JSON can hold
    check : raises where the promise is broken
    """

    name: str
    inputs: SearchStrategy[Any]
    check: Check


_known: dict[str, Target] = {}


def target(name: str, inputs: SearchStrategy[Any]) -> Callable[[Check], Check]:
    """Register the decorated check as a target."""

    def register(check: Check) -> Check:
        assert name not in _known, f"two targets are called {name}"
        _known[name] = Target(name, inputs, check)
        return check

    return register


def targets() -> dict[str, Target]:
    """Return every target by its name."""
    package = importlib.import_module("tests.fuzz.targets")
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{package.__name__}.{module.name}")
    return dict(sorted(_known.items()))


def search(
    wanted: Target,
    seconds: float,
    found: Path = FOUND,
    clock: Callable[[], float] = time.monotonic,
) -> int:
    """Check random inputs for `seconds`; return how many.

    The first failure is made small, which may take longer, kept in `found`, and raised.
    """
    end = clock() + seconds
    folder = found / wanted.name
    tried = 0
    failing: list[Any] = []

    @settings(
        derandomize=False,
        database=None,
        deadline=None,
        max_examples=ROUND,
        phases=(Phase.generate, Phase.target, Phase.shrink),
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
    )
    @given(wanted.inputs)
    def attempt(value: Any) -> None:
        nonlocal tried
        if clock() >= end and not failing:
            return
        tried += 1
        with _in_flight(folder, value):
            try:
                wanted.check(value)
            except UnsatisfiedAssumption:
                raise
            except Exception:
                failing.append(value)
                raise

    try:
        while clock() < end:
            attempt()
    except Exception as error:
        if failing:  # Hypothesis ends with the smallest
            error.add_note(f"kept as {keep(folder, failing[-1])}")
        raise
    return tried


def keep(folder: Path, value: Any) -> Path:
    """Write an input to the folder of its target."""
    text = json.dumps(value, indent=1) + "\n"
    file = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:12]}.json"
    folder.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


@contextmanager
def _in_flight(folder: Path, value: Any) -> Iterator[None]:
    """Leave the input behind if checking it ends the process, which a hang does too."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / UNFINISHED
    file.write_text(json.dumps(value))
    faulthandler.dump_traceback_later(PATIENCE_S, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        file.unlink()
