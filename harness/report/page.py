"""The report of a run as one self-contained HTML page."""

from collections.abc import Sequence
from pathlib import Path

from harness import __version__
from harness.errors import InputError
from harness.metrics.decision import Decided, decide_run
from harness.profile.device_costs import DeviceCosts
from harness.report.content import make_content
from harness.report.prediction import make_prediction
from harness.results.run_folder import Run
from harness.webpages import load_template, pack_json, read_static, write_atomically

PACKAGE = "harness.report"
ELEMENTS, SPANS = "elements.js", "spans.js"
"""Scripts of reports and of measuring pages, which also share `CHARTS` and `STYLE`."""
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
    run: Run,
    file: Path | None = None,
    decided: Sequence[Decided] | None = None,
    device: DeviceCosts | None = None,
) -> Path:
    """Write the report of a run as one HTML file.

    Parameters
    ----------
    run : Run
        Run or study, see `harness.results.run_folder.read_run`.
    file : Path, optional
        File to write, by default `report.html` in the run's folder.
    decided : sequence of Decided, optional
        Result of `decide_run` for the run, computed by default.
    device : DeviceCosts, optional
        Costs by which draw times are predicted, by default those of the stored profile.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the run has no case and no study.
    """
    decided = list(decide_run(run) if decided is None else decided)
    content = make_content(run, decided)
    prediction, warnings = make_prediction(run, decided, device)
    content["warnings"] += warnings
    if not content["cases"] and not content["matrices"]:
        detail = f" ({run.problems[0]})" if run.problems else ""
        raise InputError(f"{run.path}: neither a case nor a study{detail}; run or --resume first")
    target = file or run.folder / FILE
    first = content["groups"][0] if content["groups"] else None
    text = load_template(PACKAGE, "report.html").render(
        content=content,
        answer=content["study"] or (first["answer"] if first else "The study has no correlation."),
        failed=sum(case["row"]["status"] == "failed" for case in content["cases"]),
        key_facts=content["key_facts"],
        prediction=prediction,
        created=run.facts.get("created", ""),
        version=__version__,
        style=read_static(PACKAGE, STYLE),
        charts=read_static(PACKAGE, CHARTS),
        script="\n".join(read_static(PACKAGE, name) for name in SCRIPTS),
        data=pack_json(content),
    )
    write_atomically(target, text)
    return target
