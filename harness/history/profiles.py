"""Profiles of a device, made again and again, as runs whose cases are the terms of its law."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from harness.errors import UsageError
from harness.figures.registry import COST
from harness.profile.counted import TERMS
from harness.profile.placing import SIDE
from harness.profile.profile import FORMAT
from harness.stored import atomic
from harness.stored.folder import Record, Run, parsed

SCENE = "profile"
"""What stands in place of a scene: the design of draws."""


def is_profile(file: Path) -> bool:
    """Whether a file is what `harness profile` wrote."""
    if file.suffix != ".json" or not file.is_file():
        return False
    with file.open("rb") as stream:
        pattern = rf'"format":\s*"{FORMAT}"'.encode()
        return re.search(pattern, stream.read(200)) is not None


def read_profile(file: Path) -> Run:
    """Return a profile as a run: a record for each term that is shown to cost anything.

    One that was refused when it was made has a problem in place of records.

    Raises
    ------
    UsageError
        if it is damaged
    """
    try:
        content = parsed(atomic.read(file))
        device = content["device"]
        facts = {"created": device.get("created", ""), "cpu": {"label": device["cpu"]}}
        if content["refused"]:
            return Run(file, facts, [], [f"{file} was refused when it was made: left out"])
        return Run(file, facts, [_record(content, term) for term in content["terms"]])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(f"{file} is a damaged profile: {type(error).__name__}: {error}") from None


def _record(content: dict[str, Any], term: dict[str, Any]) -> Record:
    device = content["device"]
    processor = device["cpu"] if device["software"] else ""
    return {
        "status": "ok" if term["shown"] else "not shown",
        "scene": SCENE,
        "scene_hash": f"design {content['design']}, seed {content['seed']} {processor}".strip(),
        "triangulator": TERMS[term["name"]].noun,
        "rasteriser": device["rasteriser"],
        "device": device["name"],
        "resolution": SIDE,
        COST: 1e9 * float(term["seconds"]),
    }
