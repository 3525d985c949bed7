"""Small summaries of what devices measured: `results/devices/*.json`, and the page made of them."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness import atomic
from harness.errors import IncompatibleRunsError, InputError
from harness.metrics.groups import RecordGroup, group_run
from harness.metrics.per_polygon import rank_correlation
from harness.metrics.processors import is_drawn_by_processor, may_be_same, read_processor
from harness.metrics.registry import list_predictions
from harness.profile.report import device_model
from harness.results.run_folder import Run
from harness.webpages import write_atomically

FORMAT = "raster-harness device"
VERSION = 1

CRITERIA = ("overdraw", "half_perimeter", "expected_quads")
"""Criteria that are set against what a device measures: A, H and Q."""

SHOWN = (
    *("optimal:half-perimeter", "refined:half-perimeter", "optimal:expected-quads"),
    *("optimal:overdraw", "delaunay"),
)
"""Triangulators that the table has a column for."""

BROWSERS = {
    "edge": r"Edg/(\d+)?",
    "firefox": r"Firefox/(\d+)?",
    "chrome": r"Chrome/(\d+)?",
    "safari": r"(?:Version/(\d+).*)?Safari/",
}
"""How browsers call themselves, with their version."""

Summary = dict[str, Any]


def summarise(run: Run) -> Summary:
    """Return what a run says of its device, JSON-ready.

    Each view has the base, each triangulation's time and quads against the base's, and how well
    criteria rank the times of those that did all polygons.

    Raises
    ------
    InputError
        if it timed nothing, or on more than one device
    """
    timed = [record for record in run.records if record.is_ok and record.time]
    where = dict.fromkeys((each.id.rasteriser, each.id.device_name) for each in timed)
    if len(where) != 1:
        raise InputError(
            f"{run.path}: a device's summary is of one rasteriser on one device that was timed, "
            f"not of {len(where)}"
        )
    ((rasteriser, device),) = where
    known = (run.facts.get("devices") or {}).get(f"{rasteriser} on {device}") or {}
    details = known.get("details") or {}
    environment = run.facts.get("environment") or {}
    return {
        "format": FORMAT,
        "version": VERSION,
        "rasteriser": rasteriser,
        "device": device,
        "renderer": str(details.get("renderer") or device),
        "cpu": read_processor(run.facts) if is_drawn_by_processor(run, timed[0]) else "",
        "driver": str(details.get("version") or ""),
        "host": str(environment.get("browser") or environment.get("kernel") or ""),
        "timer": (known.get("timer") or {}).get("timer"),
        "created": str(run.facts.get("created") or ""),
        "harness": str(environment.get("harness") or ""),
        "views": [_view(group) for group in group_run(replace(run, records=timed))],
    }


def _view(group: RecordGroup) -> Summary:
    base, case = group.base, group.id
    assert base is not None
    ratios: dict[str, Any] = {}
    rows = []
    for record in group.records:
        ratio = None if record is base else group.compare(record, base)
        if ratio is None:
            continue
        quads, under = (each.counters.get("quads") for each in (record, base))
        ratios[record.name] = {
            "time": [float(f"{value:.5g}") for value in (ratio.value, ratio.low, ratio.high)],
            "quads": float(f"{quads / under:.5g}") if quads and under else None,
        }
        rows.append([ratio.value, *(record.predicted.get(name, np.nan) for name in CRITERIA)])
    times, *predicted = np.array(rows).reshape(-1, 1 + len(CRITERIA)).T
    ranks = [rank_correlation(each, times) for each in predicted]
    return {
        "scene": case.scene,
        "resolution": case.view.resolution,
        "rotation": case.view.rotation,
        "base": base.name,
        "triangulators": ratios,
        "ranks": {
            name: None if value is None else round(value, 3)
            for name, value in zip(CRITERIA, ranks, strict=True)
        },
    }


def write_summary(run: Run, file: Path) -> Path:
    """Write the summary of a run; views of other scenes of the same device stay in the file.

    Raises
    ------
    IncompatibleRunsError
        as `summarise` does, or if the file is another device's, or of another processor where that
        draws
    """
    summary = summarise(run)
    if file.exists():
        before = _read(file)
        if (before["rasteriser"], before["device"]) != (summary["rasteriser"], summary["device"]):
            raise IncompatibleRunsError(
                f"{file} is of {before['rasteriser']} on {before['device']}"
            )
        cpus = [str(each.get("cpu") or "") for each in (before, summary)]
        if not may_be_same(*cpus):
            raise IncompatibleRunsError(f"{file} is of {cpus[0]}, and this run is of {cpus[1]}")
        new = {_name(view) for view in summary["views"]}
        kept = [view for view in before["views"] if _name(view) not in new]
        summary["views"] = [*kept, *summary["views"]]
    write_atomically(file, json.dumps(summary, indent=1, ensure_ascii=False) + "\n")
    return file


def _read(file: Path) -> Summary:
    try:
        found = json.loads(atomic.read(file))
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read: {error}") from error
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise InputError(f"{file} is no summary of a device")
    return found


def _name(view: Summary) -> tuple[Any, ...]:
    return view["scene"], view["resolution"], view["rotation"]


def table(folder: Path) -> str:
    """Return the Markdown table of all summaries in a folder, a row for each view."""
    titles = (list_predictions()[name].title for name in CRITERIA)
    head = ["device", "driver", "scene", *SHOWN, *titles]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for file in sorted(folder.glob("*.json")):
        summary = _read(file)
        for view in summary["views"]:
            where = (
                f"`{device_model(summary['device'], summary)}`",
                summary["rasteriser"],
                summary.get("cpu"),
            )
            cells = [
                ", ".join(filter(None, where)),
                _short(summary["driver"]),
                f"{view['scene']}, {view['resolution']} px",
                *(_ratio(view["triangulators"].get(name)) for name in SHOWN),
                *("" if (v := view["ranks"].get(c)) is None else f"{v:.2f}" for c in CRITERIA),
            ]
            lines.append("| " + " | ".join(map(plain_cell, cells)) + " |")
    return "\n".join(lines)


def plain_cell(text: str) -> str:
    """Return the cell of a Markdown table: what anybody contributed is text in one line.

    It is no HTML, no link and no list of attributes, which would be the cell's.
    """
    plain = {"<": "&lt;", "[": "&#91;", "{": "&#123;", "|": "\\|"}
    return "".join(plain.get(letter, letter) for letter in " ".join(text.split()))


def browser(agent: str) -> tuple[str, str]:
    """Return the name and the version of a browser that calls itself `agent`, "" if not told.

    It calls itself by all those that it is like: Edge names Chrome, too, and Chrome Safari.
    """
    for name, called in BROWSERS.items():
        if found := re.search(called, agent):
            return name, found[1] or ""
    return "browser", ""


def _short(driver: str) -> str:
    """Name a browser as people do."""
    begin = "WebGPU in "
    if not driver.startswith(begin):
        return driver
    name, version = browser(driver)
    return f"{begin}{name.capitalize()} {version}" if version else driver


def _ratio(entry: Summary | None) -> str:
    if entry is None:
        return ""
    value, low, high = entry["time"]
    return f"{value:.2f} ({low:.2f} to {high:.2f})"
