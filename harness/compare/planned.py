"""Tells what HEAD was to measure: what it lacks of that is lost, all else was not asked for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harness.compare.matching import USUAL
from harness.compare.model import CaseName
from harness.stored.folder import Run


def missing_from(head: Run, case: CaseName) -> str | None:
    """Say why a case that `head` holds no record of should be there; None where it need not be.

    Where the plan is not known, as of a single file of records, everything should be there.
    """
    if not head.records:
        return "HEAD holds no cases"
    plan = head.facts.get("plan") or {}
    if not plan:
        return "HEAD does not say what its plan was"
    if not _asks_for(plan, case, head):
        return None
    stopped = "was stopped before its end" if head.facts.get("interrupted") else "is cut short"
    return f"it is in HEAD's plan: the run {stopped}"


def _asks_for(plan: Mapping[str, Any], case: CaseName, head: Run) -> bool:
    """Whether the plan names the case; a part that an older plan lacks names everything."""
    names = (("triangulators", case.triangulator), ("rasterisers", case.rasteriser))
    if any(isinstance(plan.get(key), list) and name not in plan[key] for key, name in names):
        return False
    scenes = {str(record.get("scene")) for record in head.records}
    if case.scene not in scenes and case.scene != Path(str(plan.get("scene", case.scene))).name:
        return False
    return (
        _on_device(plan.get("devices"), case, head)
        and _viewed(plan.get("views"), case)
        and _drawn(plan.get("options"), case)
    )


def _on_device(devices: Any, case: CaseName, head: Run) -> bool:
    """Whether the case's device is named; where none is, HEAD's records tell which was chosen."""
    if isinstance(devices, list) and case.device in devices:
        return True
    used = [r.get("device") for r in head.records if r.get("rasteriser") == case.rasteriser]
    return not used or case.device in used


def _viewed(views: Any, case: CaseName) -> bool:
    if not isinstance(views, list):
        return True
    wanted = (case.resolution, case.rotation, case.fit)
    found = [view for view in views if isinstance(view, Mapping)]
    return wanted in [
        (view.get("resolution"), view.get("rotation", 0.0), view.get("fit", "box"))
        for view in found
    ]


def _drawn(options: Any, case: CaseName) -> bool:
    if not isinstance(options, list):
        return True
    wanted = dict(case.options)
    return wanted in [{**USUAL, **each} for each in options if isinstance(each, Mapping)]
