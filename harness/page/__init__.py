"""A page that measures: a run's frames and triangulations, drawn by whatever browser opens it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from harness import __version__
from harness.measuring.processes import Bench
from harness.page.page_data import content_of, content_of_profile
from harness.rasterisers.base import shader
from harness.report.page import CHARTS, ELEMENTS, SPANS, STYLE
from harness.report.page import PACKAGE as REPORT
from harness.stored.folder import Run
from harness.webpages import packed, static, template, write_whole

PACKAGE = "harness.page"
SHARED = ("figures.js", "timing.js", "grid.js", "device.js", "run.js")
SCRIPTS = (*SHARED, "show.js", "main.js")
PROFILING = (*SHARED, "design.js", "law.js", "costs.js", "costs_shown.js", "profile.js")


def write_page(run: Run, file: Path) -> Path:
    """Write the page that measures what `run` drew; returns where it is.

    Raises
    ------
    UsageError
        if the run kept nothing to draw, or the file cannot be written
    """
    content = content_of(run)
    charts = static(REPORT, CHARTS)
    _write(file, "page.html", SCRIPTS, content, scene=content["scene"], charts=charts)
    return file


def write_profile_page(bench: Bench, file: Path, seed: int = 0) -> Path:
    """Write the page that says what a triangle costs on the device that opens it.

    bench : what triangulates the scenes of its advice

    Raises
    ------
    UsageError
        if the file cannot be written
    """
    _write(
        file,
        "profile.html",
        PROFILING,
        content_of_profile(bench, seed),
        charts="",
    )
    return file


def _write(
    file: Path, name: str, scripts: Sequence[str], content: dict[str, Any], **shown: str
) -> None:
    content["shaders"] = {name: shader(f"{name}.wgsl") for name in ("draw", "count")}
    styles = [static(REPORT, STYLE), static(PACKAGE, "page.css"), static(PACKAGE, "profile.css")]
    text = template(PACKAGE, name).render(
        version=__version__,
        style="".join(styles if name == "profile.html" else styles[:2]),
        script="\n".join(
            [
                static(REPORT, ELEMENTS),
                static(REPORT, SPANS),
                *(static(PACKAGE, each) for each in scripts),
            ]
        ),
        data=packed(content),
        **shown,
    )
    write_whole(file, text)
