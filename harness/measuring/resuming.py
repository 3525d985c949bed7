"""Goes on with a run that was stopped, if it is the same experiment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.errors import UsageError
from harness.machine.processor import label_of, same
from harness.measuring.two_versions import Halves
from harness.stored.folder import Record, Store, read_run


def open_store(
    out: Path, facts: dict[str, Any], *, resume: bool, force: bool
) -> tuple[Store, dict[str, Record]]:
    """Return the folder to write to and the records that it has, by key.

    facts : content of the new run.json; what the old one had of the run so far is taken over
    force : go on even if plan, scene, code or machine differ

    Raises
    ------
    UsageError
        if they differ, or the folder holds a run that is not to be resumed, or cannot be written
    """
    kind = Halves if "beside" in facts else Store
    if not resume:
        return kind.create(out), {}
    store = Store.resume(out)
    before = read_run(out)
    if not force:
        try:
            _refuse_other(before.facts, facts, out)
        except UsageError:
            store.close()
            raise
    if "base" not in facts and "base" in before.facts:
        facts["base"] = before.facts["base"]
    facts["frames"] = before.facts.get("frames", [])
    facts["devices"] = before.facts.get("devices", {})
    facts["resumed"] = [*before.facts.get("resumed", []), facts["created"]]
    facts["created"] = before.facts.get("created", facts["created"])
    if "beside" in facts:
        store.close()
        halves = Halves.resume(out)
        return halves, halves.finished()
    return store, {record["key"]: record for record in before.records}


def _refuse_other(before: dict[str, Any], now: dict[str, Any], out: Path) -> None:
    """Refuse to mix two experiments in one folder."""
    plan = before.get("plan", {})
    differences = [
        f"plan ({key}: {plan.get(key)} then, {value} now)"
        for key, value in now["plan"].items()
        if plan.get(key) != value
    ]
    if before.get("scene", {}).get("hash") != now["scene"]["hash"]:
        differences.append("the scene's content")
    if before.get("environment", {}).get("code") != now["environment"]["code"]:
        differences.append("the code")
    if before.get("beside") != now.get("beside"):
        differences.append("what it is measured beside")
    if not same(label_of(before), label_of(now)):
        differences.append("the machine")
    if differences:
        raise UsageError(
            f"cannot resume {out}: {', '.join(differences)} differ; "
            "start a new run, or add --force to mix them"
        )
