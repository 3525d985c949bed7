"""Leaves out what is no record, so that a damaged run costs its damaged cases and no more."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from harness.compare.matching import case_name
from harness.compare.model import CaseName
from harness.stored.folder import Record, Run

NAMES = ("scene", "triangulator", "rasteriser", "device", "status")
NUMBERS = (
    *("resolution", "rotation", "polygons", "triangles", "coverage_error", "t_junctions"),
    *("outline_quads", "proven", "largest_gap", "triangulate_s"),
)
PLACE = ("resolution", "rotation")
"""Where a case was measured: every run ever written says it."""
TABLES = ("counters", "predicted")
OF_LEAST = ("polygons", "quads", "shaded", "fragments")
SECTIONS = ("plan", "environment", "devices")


def checked(run: Run) -> Run:
    """Return the run without records and facts of the wrong type, and a problem for each."""
    problems = list(run.problems)
    records = []
    for record in run.records:
        wrong = _wrong(record)
        if wrong is None:
            records.append(record)
        else:
            problems.append(f"case {record.get('key')}: {wrong} is not usable; case ignored")
    records = _latest(records, problems)
    facts = run.facts if isinstance(run.facts, dict) else {}
    return replace(run, records=records, facts=_facts(facts, problems), problems=problems)


def _latest(records: list[Record], problems: list[str]) -> list[Record]:
    """Keep one record a case: a run that was resumed by force may hold two contents of a scene."""
    latest: dict[CaseName, Record] = {}
    for record in records:
        name = case_name(record)
        if name in latest:
            problems.append(f"{name.triangulator}, {name.where}: measured twice; the later counts")
            del latest[name]
        latest[name] = record
    return list(latest.values())


def _wrong(record: Record) -> str | None:
    """Return the name of the first field that is not what a record has there, else None."""
    checks: list[tuple[tuple[str, ...], Callable[[Any], bool]]] = [
        (NAMES, lambda value: isinstance(value, str)),
        (NUMBERS, _is_number),
        (TABLES, _is_table),
        (("least",), _is_least),
        (("options",), _is_options),
        (("time",), _is_time),
    ]
    for names, good in checks:
        for name in names:
            value = record.get(name)
            # A field that is absent is an older run's; names and place cannot be done without.
            if not good(value) and (value is not None or name in (*NAMES, *PLACE)):
                return name
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) and all(map(_is_number, value.values()))


def _is_least(value: Any) -> bool:
    return _is_table(value) and all(name in value for name in OF_LEAST)


def _is_options(value: Any) -> bool:
    plain = str | int | float | bool
    return isinstance(value, dict) and all(isinstance(v, plain) for v in value.values())


def _is_time(value: Any) -> bool:
    if not isinstance(value, dict):
        return False
    # What is absent is an older run's; null is damage.
    lists = (value.get(name, []) for name in ("samples_s", "reference_s", "ci95_s"))
    numbers = all(isinstance(part, list) and all(map(_is_number, part)) for part in lists)
    epochs = value.get("epochs", [])
    counts = isinstance(epochs, list) and all(isinstance(n, int) and n > 0 for n in epochs)
    return numbers and counts and _is_number(value.get("median_s", 0.0))


def _facts(facts: dict[str, Any], problems: list[str]) -> dict[str, Any]:
    """Return facts whose sections are tables, all the way down to a device's details."""
    good = dict(facts)
    for name in SECTIONS:
        if name in good and not isinstance(good[name], dict):
            if good[name] is not None:
                problems.append(f"run.json: {name} is not usable; ignored")
            good[name] = {}
    good["devices"] = {
        label: device
        for label, device in (good.get("devices") or {}).items()
        if isinstance(device, dict) and isinstance(device.get("details") or {}, dict)
    }
    environment = dict(good.get("environment") or {})
    for name, kind in (("git", dict), ("project", dict), ("packages", dict), ("gpus", list)):
        if not isinstance(environment.get(name), kind):
            environment.pop(name, None)
    environment["gpus"] = [g for g in environment.get("gpus") or [] if isinstance(g, dict)]
    good["environment"] = environment
    if not isinstance(good.get("warnings"), list):
        good["warnings"] = []
    return good
