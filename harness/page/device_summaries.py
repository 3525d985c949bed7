"""Summaries of devices' measurements (`results/devices/*.json`), and a table of summaries."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness import atomic
from harness.errors import IncompatibleRunsError, InputError
from harness.metrics.groups import (
    RecordGroup,
    group_run,
    is_drawn_in_software,
    may_be_same_processor,
    read_processor,
)
from harness.metrics.registry import list_predictions
from harness.metrics.statistics import compute_rank_correlation
from harness.profile.profile import name_device_model
from harness.results.run_folder import Run

FORMAT = "raster-harness device"
VERSION = 1

# A, H and Q, whose rank correlation with times is reported.
CRITERIA = ("overdraw", "half_perimeter", "expected_quads")

# Triangulators with a column in the table.
TABLE_TRIANGULATORS = (
    *("optimal:half-perimeter", "refined:half-perimeter", "optimal:expected-quads"),
    *("optimal:overdraw", "delaunay"),
)

# Patterns of user agents; the group is the version.
BROWSERS = {
    "edge": r"Edg/(\d+)?",
    "firefox": r"Firefox/(\d+)?",
    "chrome": r"Chrome/(\d+)?",
    "safari": r"(?:Version/(\d+).*)?Safari/",
}

Summary = dict[str, Any]


def summarise_device(run: Run) -> Summary:
    """Return a run's summary, JSON-ready; raise InputError unless its times have one device."""
    timed = [record for record in run.records if record.is_ok and record.time]
    devices = dict.fromkeys((record.id.rasteriser, record.id.device_name) for record in timed)
    if len(devices) != 1:
        raise InputError(
            f"{run.path}: times of {len(devices)} devices; a summary requires exactly one "
            "rasteriser and device, see --device"
        )
    ((rasteriser, device),) = devices
    facts = (run.facts.get("devices") or {}).get(f"{rasteriser} on {device}") or {}
    details = facts.get("details") or {}
    environment = run.facts.get("environment") or {}
    return {
        "format": FORMAT,
        "version": VERSION,
        "rasteriser": rasteriser,
        "device": device,
        "renderer": str(details.get("renderer") or device),
        "cpu": read_processor(run.facts) if is_drawn_in_software(run, timed[0]) else "",
        "driver": str(details.get("version") or ""),
        "host": str(environment.get("browser") or environment.get("kernel") or ""),
        "timer": (facts.get("timer") or {}).get("timer"),
        "created": str(run.facts.get("created") or ""),
        "harness": str(environment.get("harness") or ""),
        "views": [_summarise_view(group) for group in group_run(replace(run, records=timed))],
    }


def _summarise_view(group: RecordGroup) -> Summary:
    """Return times and quads relative to the base, and rank correlations of criteria with times."""
    base, case = group.base, group.id
    assert base is not None
    ratios: dict[str, Any] = {}
    rows = []
    for record in group.records:
        ratio = None if record is base else group.compute_ratio(record, base)
        if ratio is None:
            continue
        quads, base_quads = record.counters.get("quads"), base.counters.get("quads")
        ratios[record.name] = {
            "time": [float(f"{value:.5g}") for value in (ratio.value, ratio.low, ratio.high)],
            "quads": float(f"{quads / base_quads:.5g}") if quads and base_quads else None,
        }
        rows.append([ratio.value, *(record.predicted.get(name, np.nan) for name in CRITERIA)])
    times, *predicted = np.array(rows).reshape(-1, 1 + len(CRITERIA)).T
    ranks = [compute_rank_correlation(column, times) for column in predicted]
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
    """Write the summary of a run, and retain other views of the file.

    Raises IncompatibleRunsError if the file is of another device, or of software on another CPU.
    """
    summary = summarise_device(run)
    if file.exists():
        stored = _read_summary(file)
        if (stored["rasteriser"], stored["device"]) != (summary["rasteriser"], summary["device"]):
            raise IncompatibleRunsError(
                f"{file}: a summary of {stored['rasteriser']} on {stored['device']}; give another "
                "file"
            )
        cpus = [str(part.get("cpu") or "") for part in (stored, summary)]
        if not may_be_same_processor(*cpus):
            raise IncompatibleRunsError(
                f"{file}: measured on {cpus[0]}, this run on {cpus[1]}; give another file"
            )
        new = {_identify_view(view) for view in summary["views"]}
        retained = [view for view in stored["views"] if _identify_view(view) not in new]
        summary["views"] = [*retained, *summary["views"]]
    atomic.write_output(file, json.dumps(summary, indent=1, ensure_ascii=False) + "\n")
    return file


def _read_summary(file: Path) -> Summary:
    try:
        summary = json.loads(atomic.read(file))
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read ({error}); choose another file") from error
    if not isinstance(summary, dict) or summary.get("format") != FORMAT:
        raise InputError(f"{file}: not a summary of a device; choose another file")
    return summary


def _identify_view(view: Summary) -> tuple[Any, ...]:
    return view["scene"], view["resolution"], view["rotation"]


def format_table(folder: Path) -> str:
    """Return a Markdown table of all summaries in a folder, a row per view."""
    titles = (list_predictions()[name].title for name in CRITERIA)
    headings = ["device", "driver", "scene", *TABLE_TRIANGULATORS, *titles]
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    for file in sorted(folder.glob("*.json")):
        summary = _read_summary(file)
        for view in summary["views"]:
            identity = (
                f"`{name_device_model(summary['device'], summary)}`",
                summary["rasteriser"],
                summary.get("cpu"),
            )
            cells = [
                ", ".join(filter(None, identity)),
                _shorten_driver(summary["driver"]),
                f"{view['scene']}, {view['resolution']} px",
                *(_format_ratio(view["triangulators"].get(name)) for name in TABLE_TRIANGULATORS),
                *("" if (v := view["ranks"].get(c)) is None else f"{v:.2f}" for c in CRITERIA),
            ]
            lines.append("| " + " | ".join(map(format_plain_cell, cells)) + " |")
    return "\n".join(lines)


def format_plain_cell(text: str) -> str:
    """Return untrusted text as a line in a Markdown cell, without HTML, links or attributes."""
    escapes = {"<": "&lt;", "[": "&#91;", "{": "&#123;", "|": "\\|"}
    return "".join(escapes.get(letter, letter) for letter in " ".join(text.split()))


def identify_browser(agent: str) -> tuple[str, str]:
    """Return the name and version of the browser of a user agent, "" if unknown."""
    for name, pattern in BROWSERS.items():
        if match := re.search(pattern, agent):
            return name, match[1] or ""
    return "browser", ""


def _shorten_driver(driver: str) -> str:
    prefix = "WebGPU in "
    if not driver.startswith(prefix):
        return driver
    name, version = identify_browser(driver)
    return f"{prefix}{name.capitalize()} {version}" if version else driver


def _format_ratio(entry: Summary | None) -> str:
    if entry is None:
        return ""
    value, low, high = entry["time"]
    return f"{value:.2f} ({low:.2f} to {high:.2f})"
