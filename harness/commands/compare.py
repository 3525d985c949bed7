"""`harness compare`: changes between two runs."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from harness import atomic
from harness.errors import InputError
from harness.progress import Screen

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harness.compare.model import Comparison
    from harness.compare.polygons import GrownPolygon
    from harness.results.run_folder import Run


def compare(
    base: Annotated[Path, typer.Argument(help="The run to compare with: a folder or cases.jsonl.")],
    head: Annotated[Path, typer.Argument(help="The run to test: a folder or cases.jsonl.")],
    gate: Annotated[
        str | None,
        typer.Option(help="Changes to fail on: counters, time, or counters,time (the default)."),
    ] = None,
    threshold: Annotated[
        list[str] | None,
        typer.Option(help="Tolerated increase, e.g. time=5% or quads=0%; repeatable."),
    ] = None,
    normalise: Annotated[
        Literal["auto", "reference", "none"] | None,
        typer.Option(
            help="How to correct times for the machine's speed: auto (by other cases timed "
            "together, else by a reference triangle), reference (by that triangle), or none."
        ),
    ] = None,
    across_devices: Annotated[
        bool, typer.Option("--across-devices", help="Compare runs of different devices.")
    ] = False,
    require_all: Annotated[
        bool, typer.Option("--require-all", help="Also fail if HEAD's plan lacks a case of BASE.")
    ] = False,
    allow_inconclusive: Annotated[
        bool, typer.Option("--allow-inconclusive", help="Exit with 0 if times are too noisy.")
    ] = False,
    allow_missing_baseline: Annotated[
        bool, typer.Option("--allow-missing-baseline", help="Exit with 0 if BASE does not exist.")
    ] = False,
    output: Annotated[
        Literal["table", "markdown", "json"],
        typer.Option("--format", help="Format on standard output."),
    ] = "table",
    markdown: Annotated[Path | None, typer.Option(help="Write Markdown to this file.")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML to this file.")] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write JSON to this file.")
    ] = None,
    html: Annotated[Path | None, typer.Option(help="Write one HTML page to this file.")] = None,
) -> None:
    """Report changes from BASE to HEAD; exit with 1 if a time or a counter regressed.

    Counters are exact: any difference is real. Times are statistical: regressed, improved,
    unchanged, or inconclusive. Settings are also read from pyproject.toml, table
    tool.raster-harness. If $GITHUB_STEP_SUMMARY names a file, the Markdown is added to it.

    Exit codes: 0 no regression, 1 regression, 2 bad usage, 4 nothing comparable, 5 inconclusive.
    """
    from harness.compare.comparison import compare_runs, compare_without_baseline
    from harness.compare.model import parse_gates, parse_threshold, read_project_settings
    from harness.results.run_folder import read_run

    settings = read_project_settings(Path.cwd())
    settings = replace(
        settings,
        gates=settings.gates if gate is None else parse_gates(gate),
        thresholds={**settings.thresholds, **dict(map(parse_threshold, threshold or []))},
        normalise=normalise or settings.normalise,
        across_devices=across_devices,
        require_all=require_all or settings.require_all,
        allow_inconclusive=allow_inconclusive or settings.allow_inconclusive,
    )
    after = read_run(head)
    before = _read_baseline(base, allow_missing=allow_missing_baseline)
    grown: list[GrownPolygon] = []
    if before is None:
        comparison = compare_without_baseline(str(base), after, settings)
    else:
        comparison = compare_runs(before, after, settings)
        if comparison.list_regressed_cases():
            from harness.compare.polygons import find_largest_growth

            grown = find_largest_growth(before, after, comparison)
    try:
        typer.echo(_format_comparison(comparison, output, grown), nl=False)
        sys.stdout.flush()
    except BrokenPipeError:  # a closed pipe does not change the exit code
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    for kind, file in {
        "markdown": markdown,
        "junit": junit,
        "json": json_file,
        "html": html,
    }.items():
        if file is not None:
            atomic.write_output(file, _format_comparison(comparison, kind, grown))
    if summary := os.environ.get("GITHUB_STEP_SUMMARY"):
        with Path(summary).open("a", encoding="utf-8") as stream:
            stream.write(_format_comparison(comparison, "markdown", grown))
    raise typer.Exit(comparison.exit_code)


def _read_baseline(path: Path, *, allow_missing: bool) -> Run | None:
    from harness.results.run_folder import read_run

    exists = path.is_file() or any((path / name).exists() for name in ("run.json", "cases.jsonl"))
    if exists:
        return read_run(path)
    if allow_missing:
        return None
    raise InputError(
        f"no baseline: {path} is not a run; store one there, or give --allow-missing-baseline "
        "so that a first run passes"
    )


def _format_comparison(comparison: Comparison, kind: str, grown: Sequence[GrownPolygon]) -> str:
    from harness.compare import outputs

    if kind == "table":
        console = Screen()
        with console.capture() as captured:
            outputs.print_comparison(comparison, console)
        return captured.get()
    if kind == "html":
        return outputs.to_html(comparison, grown)
    if kind == "json":
        text = json.dumps(
            outputs.to_json(comparison), indent=2, ensure_ascii=False, allow_nan=False
        )
        return text + "\n"
    return (
        outputs.to_markdown(comparison, grown=grown)
        if kind == "markdown"
        else outputs.to_junit(comparison)
    )
