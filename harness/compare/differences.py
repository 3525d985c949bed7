"""What differs between two runs apart from their figures: plan, software, machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from harness.machine.processor import label_of, same
from harness.stored.folder import Run

ENVIRONMENT = ("harness", "code", "python", "kernel", "cpu", "threads", "governor")


def machine(facts: Mapping[str, Any]) -> str:
    """Return what tells a machine from others of another kind; "" where the run does not say."""
    environment = facts.get("environment") or {}
    if not (processor := label_of(facts)):
        return ""
    text = f"{processor}, {environment.get('threads')} threads"
    gpus = [str(gpu.get("name")) for gpu in environment.get("gpus") or []]
    return ", ".join([text, *gpus])


def machines_differ(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Whether both runs say what machine they are of, and it is not the same."""
    known = machine(before) and machine(after)
    alike = same(label_of(before), label_of(after))
    rest = [machine(facts).removeprefix(label_of(facts)) for facts in (before, after)]
    return bool(known) and not (alike and rest[0] == rest[1])


def plan_changes(base: Run, head: Run) -> list[str]:
    """Return one line for each part of the plan that differs."""
    before, after = base.facts.get("plan") or {}, head.facts.get("plan") or {}
    if not before or not after:
        return []
    return _changes("plan", _flat(before), _flat(after))


def environment_changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Return one line for each known fact about software or machine that differs."""
    return _changes("environment", _facts(before), _facts(after))


def _facts(facts: Mapping[str, Any]) -> dict[str, Any]:
    environment = facts.get("environment") or {}
    found = {name: environment.get(name) for name in ENVIRONMENT}
    found |= {name: (environment.get("packages") or {}).get(name) for name in _packages(facts)}
    for label, device in (facts.get("devices") or {}).items():
        details = (device or {}).get("details") or {}
        found |= {f"{label}: {key}": details.get(key) for key in ("renderer", "version")}
    return {name: value for name, value in found.items() if value is not None}


def _packages(facts: Mapping[str, Any]) -> list[str]:
    return list((facts.get("environment") or {}).get("packages") or {})


def _flat(values: Mapping[str, Any]) -> dict[str, Any]:
    """Write {"timing": {"precision": 1}} as {"timing.precision": 1}."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= {f"{name}.{inner}": deeper for inner, deeper in _flat(value).items()}
        else:
            flat[name] = value
    return flat


def _changes(kind: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Compare what both know: what an older run does not say has not changed."""
    return [
        f"{kind}: {name} was {_short(before[name])}, is {_short(after[name])}"
        for name in after
        if name in before and before[name] != after[name]
    ]


def _short(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_short(item) for item in value) or "none"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}={_short(item)}" for key, item in value.items()) + "}"
    return str(value)
