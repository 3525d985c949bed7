"""The environment of a run as rows of a table: section, name, value."""

from __future__ import annotations

import json
from typing import Any

from harness.machine.environment import commit_of, label_of
from harness.stored.folder import Run

Row = tuple[str, str, str]


def rows(run: Run) -> list[Row]:
    """Return every fact of `run.json` as (section, name, value); lists and nesting flattened."""
    known = ("created", "schema_version", "interrupted", "resumed")
    found = [("run", name, _text(run.facts[name])) for name in known if name in run.facts]
    for section in ("scene", "environment", "cpu", "state", "plan", "devices", "frames", "seconds"):
        values = run.facts.get(section)
        if isinstance(values, list):
            values = {str(number): value for number, value in enumerate(values)}
        if isinstance(values, dict):
            found += [(section, name, text) for name, text in _flat(values)]
    return found


def key_rows(run: Run) -> list[tuple[str, str]]:
    """Return (name, value) of the few facts that times depend on most, where they are known."""
    machine = run.facts.get("environment") or {}
    scene = run.facts.get("scene") or {}
    found = [("processor", label_of(run.facts)), ("system", machine.get("kernel"))]
    for label, device in (run.facts.get("devices") or {}).items():
        details = device.get("details") or {}
        timer = (device.get("timer") or {}).get("timer", "not timed")
        names = [details.get("renderer"), details.get("version"), f"timer: {timer}"]
        found.append((label, ", ".join(str(name) for name in names if name)))
    gpus = machine.get("gpus") or []
    found += [("GPU", ", ".join(str(value) for value in gpu.values())) for gpu in gpus]
    if scene:
        size = f"{scene.get('polygons', 0):,} polygons; {scene.get('licence', '')}"
        found.append(("scene", f"{scene.get('description') or scene.get('name')}: {size}"))
    found.append(("commit", commit_of(run.facts)))
    harness = f"{machine.get('harness', '')} {commit_of(run.facts, 'git')}"
    found.append(("harness", harness.strip()))
    found.append(("command", " ".join(map(str, machine.get("command") or []))))
    return [(name, str(value)) for name, value in found if value]


def _flat(values: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    found = []
    for name, value in values.items():
        if isinstance(value, dict) and value:
            found += _flat(value, f"{prefix}{name}: ")
        else:
            found.append((f"{prefix}{name}", _text(value)))
    return found


def _text(value: Any) -> str:
    if value is None:
        return "not known"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, str):
        return value
    if isinstance(value, list) and all(isinstance(each, str) for each in value):
        return " ".join(value) or "none"
    return json.dumps(value, ensure_ascii=False)
