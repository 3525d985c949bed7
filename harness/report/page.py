"""Puts a report together: the page, its style, its scripts and its numbers, in one file."""

from __future__ import annotations

import base64
import gzip
import json
import os
import tempfile
from importlib import resources
from pathlib import Path
from typing import Any

from harness import __version__
from harness.errors import UsageError
from harness.report.content import content_of
from harness.stored.folder import Run
from harness.templates import template

FILE = "report.html"

SCRIPTS = (
    "page.js",
    "csv.js",
    "chart.js",
    "ranking.js",
    "raster.js",
    "heatmap.js",
    "matrix.js",
    "cases.js",
    "main.js",
)
CHARTS = "echarts.common.min.js"


def write_report(run: Run, file: Path | None = None) -> Path:
    """Write the report of `run` as one HTML file; returns where it is.

    file : by default `report.html` in the run's folder

    Raises
    ------
    UsageError
        if the run holds nothing to show, or the file cannot be written
    """
    content = content_of(run)
    if not content["cases"] and not content["matrices"]:
        raise UsageError(f"{run.path} holds no case and no study yet; run or --resume it first")
    folder = run.path if run.path.is_dir() else run.path.parent
    target = file or folder / FILE
    _replace(target, render(content, run.facts))
    return target


def render(content: dict[str, Any], facts: dict[str, Any]) -> str:
    """Return the page that shows `content`; `facts` are those of run.json."""
    first = content["groups"][0] if content["groups"] else None
    failed = sum(case["row"]["status"] == "failed" for case in content["cases"])
    return template("harness.report", "report.html").render(
        content=content,
        answer=content["study"] or (first["answer"] if first else "A study without a figure."),
        failed=failed,
        key_facts=content["key_facts"],
        created=facts.get("created", ""),
        version=__version__,
        style=_static("report.css"),
        charts=_static(CHARTS),
        script="\n".join(_static(name) for name in SCRIPTS),
        data=_packed(content),
    )


def _static(name: str) -> str:
    return (resources.files("harness.report") / "static" / name).read_text(encoding="utf-8")


def _packed(content: dict[str, Any]) -> str:
    """Return the content as base64 of compressed JSON, which no HTML parser can misread."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode("ascii")


def _replace(file: Path, text: str) -> None:
    """Write `file` whole or not at all."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
        try:
            with os.fdopen(descriptor, "w", encoding="utf-8") as output:
                output.write(text)
            Path(temporary).chmod(0o644)
            Path(temporary).replace(file)
        except OSError:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise UsageError(f"cannot write {file}: {error.strerror}; give another --out") from error
