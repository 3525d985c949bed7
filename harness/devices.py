"""Small summaries of what devices measured: `results/devices/*.json`, and the page made of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import UsageError
from harness.figures.groups import base_of, groups, time_ratio
from harness.figures.polygons import rank_correlation
from harness.figures.registry import predictions
from harness.stored.folder import Record, Run
from harness.webpage import write_whole

FORMAT = "raster-harness device"
VERSION = 1

CRITERIA = ("overdraw", "half_perimeter", "expected_quads")
"""Criteria whose ranking of the triangulations is told: A, H and Q."""

Summary = dict[str, Any]


def summarise(run: Run) -> Summary:
    """Return what a run says of its device, JSON-ready.

    Each view has the base, each triangulation's time and quads against the base's, and how well
    criteria rank the times of those that did all polygons.

    Raises
    ------
    UsageError
        if it timed nothing, or on more than one device
    """
    timed = [record for record in run.records if record["status"] == "ok" and record.get("time")]
    where = dict.fromkeys((record["rasteriser"], record["device"]) for record in timed)
    if len(where) != 1:
        raise UsageError(
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
        "driver": str(details.get("version") or ""),
        "host": str(environment.get("browser") or environment.get("kernel") or ""),
        "timer": (known.get("timer") or {}).get("timer"),
        "created": str(run.facts.get("created") or ""),
        "harness": str(environment.get("harness") or ""),
        "views": [_view(members) for members in groups(timed)],
    }


def _view(members: Sequence[Record]) -> Summary:
    base = base_of(members)
    assert base is not None
    told: dict[str, Any] = {}
    columns: dict[str, list[float]] = {name: [] for name in (*CRITERIA, "time")}
    for record in members:
        ratio = time_ratio(record, base)
        if ratio is None or record is base:
            continue
        quads, under = (each["counters"].get("quads") for each in (record, base))
        told[record["triangulator"]] = {
            "time": [float(f"{value:.5g}") for value in (ratio.value, ratio.low, ratio.high)],
            "quads": float(f"{quads / under:.5g}") if quads and under else None,
        }
        columns["time"].append(ratio.value)
        for name in CRITERIA:
            columns[name].append(record["predicted"].get(name, np.nan))
    ranks = {
        name: rank_correlation(np.array(columns[name]), np.array(columns["time"]))
        for name in CRITERIA
    }
    return {
        "scene": base["scene"],
        "resolution": base["resolution"],
        "rotation": base["rotation"],
        "base": base["triangulator"],
        "triangulators": told,
        "ranks": {name: None if v is None else round(v, 3) for name, v in ranks.items()},
    }


def write_summary(run: Run, file: Path) -> Path:
    """Write the summary of a run; raises UsageError as `summarise` does."""
    write_whole(file, json.dumps(summarise(run), indent=1, ensure_ascii=False) + "\n")
    return file


def table(folder: Path) -> str:
    """Return the Markdown table of all summaries in a folder, a row for each view."""
    titles = predictions()
    names = ("optimal:half-perimeter", "refined:half-perimeter", "delaunay", "optimal:overdraw")
    head = ["device", "driver", "scene", *names, *(titles[each].title for each in CRITERIA)]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for file in sorted(folder.glob("*.json")):
        summary = json.loads(file.read_text(encoding="utf-8"))
        for view in summary["views"]:
            cells = [
                f"`{summary['device']}`, {summary['rasteriser']}",
                summary["driver"],
                f"{view['scene']}, {view['resolution']} px",
                *(_ratio(view["triangulators"].get(name)) for name in names),
                *("" if (v := view["ranks"].get(c)) is None else f"{v:.2f}" for c in CRITERIA),
            ]
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)


def _ratio(entry: Summary | None) -> str:
    if entry is None:
        return ""
    value, low, high = entry["time"]
    return f"{value:.2f} ({low:.2f} to {high:.2f})"
