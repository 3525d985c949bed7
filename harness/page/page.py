"""Puts a measuring page together: shaders, scripts, style and numbers, in one file."""

from __future__ import annotations

from pathlib import Path

from harness import __version__
from harness.page.page_data import content_of
from harness.rasterisers.shader_texts import shader
from harness.report.page import CHARTS, ELEMENTS, STYLE
from harness.report.page import PACKAGE as REPORT
from harness.stored.folder import Run
from harness.webpages.single_file import packed, static, write_whole
from harness.webpages.templates import template

PACKAGE = "harness.page"
SCRIPTS = ("figures.js", "timing.js", "grid.js", "device.js", "show.js", "main.js")


def write_page(run: Run, file: Path) -> Path:
    """Write the page that measures what `run` drew; returns where it is.

    Raises
    ------
    UsageError
        if the run kept nothing to draw, or the file cannot be written
    """
    content = content_of(run)
    content["shaders"] = {name: shader(f"{name}.wgsl") for name in ("draw", "count")}
    text = template(PACKAGE, "page.html").render(
        scene=content["scene"],
        version=__version__,
        style=static(REPORT, STYLE) + static(PACKAGE, "page.css"),
        charts=static(REPORT, CHARTS),
        script="\n".join([static(REPORT, ELEMENTS), *(static(PACKAGE, name) for name in SCRIPTS)]),
        data=packed(content),
    )
    write_whole(file, text)
    return file
