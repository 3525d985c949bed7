"""What the gate looks at and how much it lets pass: from options and from pyproject.toml."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from harness.errors import UsageError, unknown
from harness.figures.registry import figures as registered
from harness.figures.registry import find

GATES = ("counters", "time")
Normalise = Literal["auto", "reference", "none"]
NORMALISE: tuple[Normalise, ...] = get_args(Normalise)
TABLE = "raster-harness"

TIME_THRESHOLD = 0.05
"""Growth of a time that is let pass unless told otherwise; see docs/ci/README.md for why."""

PAIRED_TIME_THRESHOLD = 0.015
"""The same where BASE and HEAD were timed in the same rounds."""


@dataclass(frozen=True)
class Settings:
    """How two runs are compared.

    gates : which kinds of verdict decide the exit code, of `GATES`
    thresholds : relative growth let pass, by "time", "counters" or a counter's name
    confidence : of the intervals, and 1 - the false discovery rate over all cases
    normalise : what takes the machine out of times: "auto" is a case's peers where there are
        enough, else the reference draw; "reference" is that draw; "none" takes nothing out
    across_devices : compare runs of different devices, which are refused otherwise
    require_all : what HEAD skipped or lacks is a regression
    allow_inconclusive : exit with 0 where times are too noisy to say
    """

    gates: tuple[str, ...] = GATES
    thresholds: Mapping[str, float] = field(default_factory=dict)
    confidence: float = 0.95
    normalise: Normalise = "auto"
    across_devices: bool = False
    require_all: bool = False
    allow_inconclusive: bool = False

    @property
    def gates_time(self) -> bool:
        """Whether times decide the exit code."""
        return "time" in self.gates

    def time_threshold_of(self, *, paired: bool) -> float:
        """Relative growth of a time that is let pass; `paired` if timed in the same rounds."""
        usual = PAIRED_TIME_THRESHOLD if paired else TIME_THRESHOLD
        return self.thresholds.get("time", usual)

    def threshold(self, counter: str) -> float | None:
        """Relative growth of a counter that is let pass; None where it is not gated."""
        if "counters" not in self.gates or not is_gated(counter, self.thresholds):
            return None
        return self.thresholds.get(counter, self.thresholds.get("counters", 0.0))

    def to_json(self) -> dict[str, Any]:
        """Return the settings as JSON-ready values."""
        return {**asdict(self), "gates": list(self.gates), "thresholds": dict(self.thresholds)}


def is_gated(counter: str, thresholds: Mapping[str, float]) -> bool:
    """Whether growth of `counter` is a regression: it is a count, or a threshold names it.

    A counter that every triangulation shares is gated in both directions.
    """
    figure = find(counter)
    return figure.is_cost or (counter in thresholds and figure.has_direction)


def parse_gates(text: str | Iterable[str]) -> tuple[str, ...]:
    """Read `counters,time`, or a list of such names.

    Raises
    ------
    UsageError
        if a name is unknown or there is none
    """
    parts = text.split(",") if isinstance(text, str) else list(text)
    gates = tuple(dict.fromkeys(part.strip() for part in parts if part.strip()))
    for gate in gates:
        if gate not in GATES:
            raise unknown("gate", gate, GATES)
    if not gates:
        raise UsageError(f"no gate is named; give --gate {','.join(GATES)}")
    return gates


def parse_threshold(text: str) -> tuple[str, float]:
    """Read `name=5%`.

    Raises
    ------
    UsageError
        if it is not a percentage, or of what is neither better nor worse; `require_known` sees to
        names
    """
    name, sign, value = (part.strip() for part in text.partition("="))
    if not sign:
        raise UsageError(f"threshold '{text}': give name=percentage, e.g. time=5%")
    if name not in ("time", "counters") and not find(name).has_direction:
        raise UsageError(f"threshold '{text}': neither more nor less {name} is better")
    if not re.fullmatch(r"\d+(\.\d+)?\s*%", value):
        raise UsageError(f"threshold '{text}': give a percentage, e.g. {name}=5%")
    return name, float(value.rstrip("% ")) / 100


def require_known(thresholds: Mapping[str, float], figures: Iterable[str]) -> None:
    """See that every threshold is of a figure that there is: registered, or in either run.

    Raises
    ------
    UsageError
        if one is not
    """
    exact = (name for name, figure in registered().items() if figure.exact)
    known = {"time", "counters", *exact, *figures}
    for name in thresholds:
        if name not in known:
            raise unknown("threshold", name, known)


def from_project(folder: Path) -> Settings:
    """Read `[tool.raster-harness]` of the nearest pyproject.toml above `folder`; else defaults.

    Raises
    ------
    UsageError
        if the file is not TOML, or the table holds what is not a setting
    """
    for parent in (folder, *folder.parents):
        file = parent / "pyproject.toml"
        if file.is_file():
            break
    else:
        return Settings()
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8")).get("tool", {}).get(TABLE, {})
    except (OSError, ValueError) as error:
        raise UsageError(f"{file} cannot be read: {error}") from error
    try:
        return _from_table(table)
    except UsageError as error:
        raise UsageError(f"{file}, [tool.{TABLE}]: {error}") from error


def _from_table(table: Mapping[str, Any]) -> Settings:
    readers: dict[str, tuple[str, type | tuple[type, ...], Callable[[Any], Any]]] = {
        "gate": ("gates", (str, list), parse_gates),
        "threshold": ("thresholds", dict, _parse_thresholds),
        "normalise": ("normalise", str, str),
        "require-all": ("require_all", bool, bool),
        "allow-inconclusive": ("allow_inconclusive", bool, bool),
    }
    found: dict[str, Any] = {}
    for key, value in table.items():
        if key not in readers:
            raise unknown("setting", key, readers)
        name, kind, read = readers[key]
        if not isinstance(value, kind) or (key == "normalise" and value not in NORMALISE):
            raise UsageError(f"{key} = {value!r} cannot be used")
        found[name] = read(value)
    return Settings(**found)


def _parse_thresholds(table: Mapping[str, Any]) -> dict[str, float]:
    return dict(parse_threshold(f"{name}={text}") for name, text in table.items())
