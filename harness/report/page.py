"""The report of a run as one page of HTML, which needs no network."""

from collections.abc import Sequence
from pathlib import Path

from harness import __version__
from harness.errors import InputError
from harness.metrics.decision import Decided
from harness.report.content import content_of
from harness.results.run_folder import Run
from harness.webpages import packed, static, template, write_atomically

PACKAGE = "harness.report"
ELEMENTS, SPANS = "elements.js", "spans.js"
"""What the measuring page uses, too, as it does `CHARTS` and the style."""
FILE = "report.html"
STYLE = "report.css"

SCRIPTS = (
    ELEMENTS,
    "page.js",
    "csv.js",
    "chart.js",
    "ranking.js",
    SPANS,
    "raster.js",
    "heatmap.js",
    "matrix.js",
    "cases.js",
    "main.js",
)
CHARTS = "echarts.common.min.js"


def write_report(
    run: Run, file: Path | None = None, decided: Sequence[Decided] | None = None
) -> Path:
    """Write the report of `run` as one HTML file; return its path.

    file : by default `report.html` in the run's folder
    decided : what `decide_all` returned for the run; None: decide now

    Raises
    ------
    InputError
        if the run holds nothing to show
    """
    content = content_of(run, decided)
    if not content["cases"] and not content["matrices"]:
        why = f" ({run.problems[0]})" if run.problems else ""
        raise InputError(
            f"{run.path} holds no case and no study yet{why}; run or --resume it first"
        )
    target = file or run.folder / FILE
    first = content["groups"][0] if content["groups"] else None
    text = template(PACKAGE, "report.html").render(
        content=content,
        answer=content["study"] or (first["answer"] if first else "A study without a figure."),
        failed=sum(case["row"]["status"] == "failed" for case in content["cases"]),
        key_facts=content["key_facts"],
        created=run.facts.get("created", ""),
        version=__version__,
        style=static(PACKAGE, STYLE),
        charts=static(PACKAGE, CHARTS),
        script="\n".join(static(PACKAGE, name) for name in SCRIPTS),
        data=packed(content),
    )
    write_atomically(target, text)
    return target
