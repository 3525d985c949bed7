"""Profiles of a device, made again and again, as runs whose cases are the terms of its law."""

from __future__ import annotations

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
        return f'"format": "{FORMAT}"'.encode() in stream.read(200)


def read_profile(file: Path) -> Run:
    """Return a profile as a run: a record for each term that is shown to cost anything.

    Raises
    ------
    UsageError
        if it is damaged, or was refused when it was made
    """
    try:
        content = parsed(atomic.read(file))
        if content["refused"]:
            raise UsageError(f"{file} was refused when it was made: leave it out")
        device = content["device"]
        facts = {"created": device.get("created", ""), "cpu": {"label": device["cpu"]}}
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
