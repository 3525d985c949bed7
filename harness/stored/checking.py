"""What a record and a run's facts must be, checked once, where they are read.

A damaged run costs its damaged cases and no more: each thing that is left out is a problem of one
line. A field that is absent is an older run's; what stands there is of the right kind or refused.
"""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Callable
from typing import Any

KEY = re.compile(r"[0-9a-f]{16}")
"""A record's key, which is the name of files, too."""

NAMES = ("scene", "triangulator", "rasteriser", "device", "status")
PLACE = ("resolution", "rotation")
"""What a case is called and where it was measured: every run ever written says it."""

NUMBERS = (
    *("resolution", "rotation", "polygons", "triangles", "coverage_error", "t_junctions"),
    *("outline_quads", "proven", "largest_gap", "triangulate_s", "vertices"),
    *("polygons_skipped", "polygons_failed", "polygons_cached"),
)
TEXTS = ("reason", "scene_hash", "host")
TABLES = ("counters", "predicted")
FITS = ("box", "circle", "tile", "view")
USUAL_OPTIONS = {"samples": 1, "work": 0, "order": "native", "seed": 0}
"""Options of drawing: what older runs did not have is as these."""

OF_LEAST = ("polygons", "quads", "shaded", "fragments")
TIMES = ("samples_s", "reference_s", "empty_s", "ci95_s")

SECTIONS = ("plan", "environment", "devices", "scene", "seconds", "beside")
LISTS = ("warnings", "frames", "resumed", "merged")
"""Parts of run.json that are tables, and lists."""

MOST = 2**63
"""No integer of a record is as large: what reads them computes with 64 bits."""


def wrong_field(record: dict[str, Any]) -> str | None:
    """Return the name of the first field that is not what a record has there, else None."""
    if not (isinstance(record.get("key"), str) and KEY.fullmatch(record["key"])):
        return "key"
    for name, good in _FIELDS.items():
        value = record.get(name)
        if not good(value) and (value is not None or name in (*NAMES, *PLACE)):
            return name
    return None


def completed(record: dict[str, Any]) -> dict[str, Any]:
    """Return a good record with the usual values of what older runs did not say."""
    options = {**USUAL_OPTIONS, **(record.get("options") or {})}
    usual = {"fit": record.get("fit") or FITS[0], "options": options}
    if record["status"] == "ok":
        usual |= {name: record.get(name) or {} for name in TABLES}
    time = record.get("time")
    if time and "samples_s" in time and "median_s" not in time:
        usual["time"] = {**time, "median_s": statistics.median(time["samples_s"])}
    return {**record, **usual}


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < MOST


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) and all(map(_is_number, value.values()))


def _is_least(value: Any) -> bool:
    return _is_table(value) and all(name in value for name in OF_LEAST)


def _is_views(value: Any) -> bool:
    if not isinstance(value, dict) or not all(isinstance(each, list) for each in value.values()):
        return False
    one_length = len({len(each) for each in value.values()}) <= 1
    kinds = ((_is_text if name == "names" else _is_number, each) for name, each in value.items())
    return one_length and all(all(map(is_kind, each)) for is_kind, each in kinds)


def _is_options(value: Any) -> bool:
    return isinstance(value, dict) and all(
        name in USUAL_OPTIONS and type(each) is type(USUAL_OPTIONS[name])
        for name, each in value.items()
    )


def _is_time(value: Any) -> bool:
    if not isinstance(value, dict):
        return False
    if value.get("timer") == "cycles":
        return isinstance(value.get("cycles"), int) and _is_number(value["cycles"])
    # What is absent is an older run's; null is damage.
    if not value.get("samples_s"):
        return False
    lists = (value.get(name, []) for name in TIMES)
    numbers = all(isinstance(part, list) and all(map(_is_number, part)) for part in lists)
    epochs = value.get("epochs", [])
    counts = isinstance(epochs, list) and all(isinstance(n, int) and n > 0 for n in epochs)
    two = len(value.get("ci95_s", (0.0, 0.0))) == 2 if numbers else False
    return numbers and counts and two and _is_number(value.get("median_s", 0.0))


_FIELDS: dict[str, Callable[[Any], bool]] = {
    **dict.fromkeys((*NAMES, *TEXTS), _is_text),
    **dict.fromkeys(NUMBERS, _is_number),
    **dict.fromkeys((*TABLES, "index"), _is_table),
    "fit": lambda value: value in FITS,
    "least": _is_least,
    "options": _is_options,
    "time": _is_time,
    "views": _is_views,
    "triangulate_samples_s": lambda value: isinstance(value, list) and all(map(_is_number, value)),
}


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def checked_facts(found: dict[str, Any], problems: list[str]) -> dict[str, Any]:
    """Return the content of run.json with tables where tables are, all the way to a device's.

    problems : gets a line for each part that is left out
    """
    good = dict(found)
    for names, kind in ((SECTIONS, dict), (LISTS, list)):
        for name in names:
            if name in good and not isinstance(good[name], kind):
                if good[name] is not None:
                    problems.append(f"run.json: {name} is not usable; ignored")
                del good[name]
    good["devices"] = {
        label: device
        for label, device in good.get("devices", {}).items()
        if isinstance(device, dict)
        and all(isinstance(device.get(part) or {}, dict) for part in ("details", "timer"))
    }
    if not all(map(_is_text, _listed(good.get("plan", {}).get("triangulators")))):
        problems.append("run.json: the plan's triangulators are not usable; ignored")
        good["plan"] = {**good["plan"], "triangulators": []}
    environment = dict(good.get("environment", {}))
    for name, kind in (("git", dict), ("project", dict), ("packages", dict), ("gpus", list)):
        if not isinstance(environment.get(name), kind):
            environment.pop(name, None)
    environment["gpus"] = [g for g in environment.get("gpus", []) if isinstance(g, dict)]
    good["environment"] = environment
    good["warnings"] = [line for line in good.get("warnings", []) if isinstance(line, str)]
    return good
