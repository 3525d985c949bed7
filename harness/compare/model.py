"""Result of a comparison: plain data, from which all outputs are written."""

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from harness import errors
from harness.errors import UsageError, make_unknown_name_error
from harness.metrics.registry import find_metric, list_metrics
from harness.results.record import CaseGroup, CaseId

Exact = Literal["equal", "better", "worse", "changed"]  # `changed` if neither direction is better

Outcome = Literal["regressed", "improved", "unchanged", "inconclusive"]
"""Change of a time; `inconclusive` means too noisy for a conclusion, never good."""

Against = Literal["rounds", "same-triangles", "peers", "reference", "none"]
"""Source of the estimate of machine drift. Versions timed in the same `rounds`, or with the
`same-triangles`, which were timed once, need none; `none` assumes no drift."""

Status = Literal[
    "compared",
    "content-changed",
    "fewer-polygons",
    "more-polygons",
    "now-failing",
    "now-skipped",
    "now-measured",
    "not-measured",
    "not-done",
    "only-base",
    "only-head",
]
"""Whether a case could be compared, and if not, why; see `STATUS_TEXT`."""

STATUS_TEXT: dict[Status, str] = {
    "compared": "measured in both runs",
    "not-done": "measured in BASE, missing from HEAD",
    "only-base": "not in HEAD's plan",
    "now-skipped": "measured in BASE, skipped in HEAD",
    "now-failing": "measured in BASE, failed in HEAD",
    "content-changed": "with changed content",
    "only-head": "new in HEAD",
    "now-measured": "not measured in BASE, measured in HEAD",
    "fewer-polygons": "with fewer polygons in HEAD",
    "more-polygons": "with more polygons in HEAD",
    "not-measured": "measured in neither run",
}

BROKEN: tuple[Status, ...] = ("now-failing", "now-skipped", "not-done", "fewer-polygons")
"""Statuses of cases measured in BASE, but not completely in HEAD: always regressions."""

Verdict = Literal["good", "regression", "inconclusive", "nothing-comparable", "no-baseline"]

EXIT_CODES: dict[Verdict, int] = {
    "good": errors.GOOD,
    "regression": errors.REGRESSION,
    "inconclusive": errors.INCONCLUSIVE,
    "nothing-comparable": errors.NOTHING_MEASURED,
    "no-baseline": errors.GOOD,
}


@dataclass(frozen=True)
class CounterChange:
    """An exact metric of a case in both runs; `change` is relative to BASE, None if BASE is 0."""

    metric: str
    base: float
    head: float
    change: float | None
    exact: Exact
    threshold: float | None
    regressed: bool


@dataclass(frozen=True)
class TimeChange:
    """Times of a case in both runs.

    ratio, low, high : HEAD over BASE without machine drift, with a confidence interval
    raw_ratio : HEAD over BASE as timed
    p_value : of the Mann-Whitney test in separate runs, or of the sign test in common rounds
    q_value : the p-value, or in separate runs the interval's if larger, corrected for the number of
        cases
    reason : why the change is inconclusive, or ""
    """

    outcome: Outcome
    reason: str
    ratio: float | None = None
    low: float | None = None
    high: float | None = None
    raw_ratio: float | None = None
    against: Against = "none"
    threshold: float | None = None
    p_value: float | None = None
    q_value: float | None = None
    base_median_s: float | None = None
    head_median_s: float | None = None
    base_rounds: int = 0
    head_rounds: int = 0


@dataclass(frozen=True)
class Drift:
    """Common change of all cases that were timed together, between BASE and HEAD.

    ratio, low, high : median of the cases' HEAD over BASE; the interval for separate runs includes
        both the ratio as timed and the ratio relative to the reference draw
    reference : HEAD over BASE of the reference draw, or None if a run has none
    gated : True if BASE and HEAD were timed in the same rounds
    """

    group: CaseGroup
    cases: int
    outcome: Outcome
    reason: str
    ratio: float
    low: float
    high: float
    reference: float | None
    gated: bool


@dataclass(frozen=True)
class CaseChange:
    """A case of one run or of both runs; `lost` has gated counters that HEAD lacks."""

    id: CaseId
    status: Status
    reason: str = ""
    counters: tuple[CounterChange, ...] = ()
    lost: tuple[str, ...] = ()
    time: TimeChange | None = None

    def list_regressed_counters(self) -> list[CounterChange]:
        """Return the counters that became worse by more than the thresholds."""
        return [change for change in self.counters if change.regressed]


@dataclass(frozen=True)
class Total:
    """An exact metric over all compared cases: numbers of cases that differ, and sums."""

    metric: str
    unit: str
    cases: int
    affected: int
    better: int
    worse: int
    base: float
    head: float
    change: float | None


@dataclass(frozen=True)
class RunOrigin:
    """Origin of a run; commit : of the user's repository; "" if unknown."""

    path: str
    created: str = ""
    commit: str = ""
    harness: str = ""
    harness_commit: str = ""
    machine: str = ""
    cases: int = 0


@dataclass(frozen=True)
class Comparison:
    """Result of a comparison: `notes` are warnings, `changes` are facts that differ."""

    verdict: Verdict
    base: RunOrigin
    head: RunOrigin
    settings: "Settings"
    machines_differ: bool = False
    totals: tuple[Total, ...] = ()
    drifts: tuple[Drift, ...] = ()
    cases: tuple[CaseChange, ...] = ()
    notes: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()

    @property
    def exit_code(self) -> int:
        """Exit code of the command `compare`."""
        if self.verdict == "inconclusive" and self.settings.allow_inconclusive:
            return errors.GOOD
        return EXIT_CODES[self.verdict]

    def list_compared(self) -> list[CaseChange]:
        """Return the cases measured in both runs."""
        return [case for case in self.cases if case.status == "compared"]

    def list_regressed_cases(self) -> list[CaseChange]:
        """Return the cases that make the gate fail."""
        return [case for case in self.cases if self.is_regressed(case)]

    def list_regressed_drifts(self) -> list[Drift]:
        """Return the regressed drifts, if times are gated."""
        if not self.settings.gates_time:
            return []
        return [drift for drift in self.drifts if drift.gated and drift.outcome == "regressed"]

    def is_regressed(self, case: CaseChange) -> bool:
        """Whether `case` makes the gate fail."""
        if case.status in BROKEN or (self.settings.require_all and case.status == "only-base"):
            return True
        slower = case.time is not None and case.time.outcome == "regressed"
        return bool(case.list_regressed_counters() or case.lost) or (
            slower and self.settings.gates_time
        )


GATES = ("counters", "time")
Normalise = Literal["auto", "reference", "none"]
TABLE = "raster-harness"
KEYS = ("gate", "threshold", "normalise", "require-all", "allow-inconclusive")
"""Table of a project's settings in pyproject.toml, and its keys."""

TIME_THRESHOLD = 0.05  # tolerated relative increase of a time by default; see docs/how-to/ci.md

PAIRED_TIME_THRESHOLD = 0.015  # tolerated relative increase by default of times in the same rounds


@dataclass(frozen=True)
class Settings:
    """Settings of a comparison.

    thresholds : tolerated relative increase, by "time", "counters" or a counter's name
    confidence : of the intervals; 1 - confidence is the false discovery rate over all cases
    normalise : estimate of the machine drift: "auto" is a case's peers if there are enough,
        otherwise the reference draw; "reference" is that draw; "none" assumes no drift
    require_all : a case skipped by or missing from HEAD is a regression
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

    def get_time_threshold(self, *, paired: bool) -> float:
        """Return the tolerated relative increase of a time; paired : in the same rounds."""
        default = PAIRED_TIME_THRESHOLD if paired else TIME_THRESHOLD
        return self.thresholds.get("time", default)

    def get_counter_threshold(self, counter: str) -> float | None:
        """Return the tolerated increase of a counter, or None if the counter is not gated."""
        metric = find_metric(counter)
        # A counter that every triangulation shares is gated in both directions.
        gated = metric.is_cost or (counter in self.thresholds and metric.can_regress)
        if "counters" not in self.gates or not gated:
            return None
        return self.thresholds.get(counter, self.thresholds.get("counters", 0.0))


def parse_gates(text: str | Iterable[str]) -> tuple[str, ...]:
    """Return the gates in a text such as `counters,time`, or in a list of such names."""
    parts = text.split(",") if isinstance(text, str) else map(str, text)
    gates = tuple(dict.fromkeys(part.strip() for part in parts))
    if not gates or not set(gates) <= {*GATES}:
        raise UsageError(f"gate '{text}': unknown; give {' or '.join(GATES)}, or both")
    return gates


def parse_threshold(text: str) -> tuple[str, float]:
    """Parse `name=5%`; return the name, and the threshold as a fraction, here 0.05."""
    name, sign, value = (part.strip() for part in text.partition("="))
    if not sign:
        raise UsageError(f"threshold '{text}': give name=percentage, e.g. time=5%")
    if name not in ("time", "counters") and not find_metric(name).can_regress:
        raise UsageError(f"threshold '{text}': no change of {name} is better; give another metric")
    if not re.fullmatch(r"\d+(\.\d+)?\s*%", value):
        raise UsageError(f"threshold '{text}': give a percentage, e.g. {name}=5%")
    return name, float(value.rstrip("% ")) / 100


def check_thresholds(thresholds: Mapping[str, float], metrics: Iterable[str]) -> None:
    """Raise UsageError unless each metric is registered, or in `metrics`."""
    exact = (name for name, metric in list_metrics().items() if metric.exact)
    names = {"time", "counters", *exact, *metrics}
    for name in thresholds:
        if name not in names:
            raise make_unknown_name_error("threshold", name, names)


def read_project_settings(folder: Path) -> Settings:
    """Return the settings in the nearest pyproject.toml at or above `folder`, or the defaults."""
    files = (parent / "pyproject.toml" for parent in (folder, *folder.parents))
    file = next(filter(Path.is_file, files), None)
    if file is None:
        return Settings()
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8")).get("tool", {}).get(TABLE, {})
        if not isinstance(table, dict):
            raise UsageError(f"not a table; settings are {', '.join(KEYS)}")
        return Settings(**dict(_parse_setting(key, value) for key, value in table.items()))
    except (OSError, ValueError, UsageError) as error:
        raise UsageError(f"{file}, [tool.{TABLE}]: {error}") from error


def _parse_setting(key: str, value: Any) -> tuple[str, Any]:
    """Return the field of `Settings` and the value for an entry of the table."""
    match key, value:
        case "gate", str() | list():
            return "gates", parse_gates(value)
        case "threshold", dict():
            texts = (f"{name}={text}" for name, text in value.items())
            return "thresholds", dict(map(parse_threshold, texts))
        case "normalise", "auto" | "reference" | "none":
            return key, value
        case (("require-all" | "allow-inconclusive"), bool()):
            return key.replace("-", "_"), value
    raise UsageError(
        f"{key} = {value!r}: unknown setting or wrong type; settings are {', '.join(KEYS)}"
    )
