"""`harness compare` and `history`: what changed between two runs, or over many."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from harness.commands.options import Several, several
from harness.errors import NothingMeasured, UsageError
from harness.progress import Screen
from harness.settings import HISTORY_METRICS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harness.compare.model import Comparison
    from harness.compare.polygons import Grown
    from harness.history import Series
    from harness.results.run_folder import Run


def compare(
    base: Annotated[Path, typer.Argument(help="The run to compare with: a folder or cases.jsonl.")],
    head: Annotated[Path, typer.Argument(help="The run to judge: a folder or cases.jsonl.")],
    gate: Annotated[
        str | None,
        typer.Option(help="What can fail: counters, time, or counters,time, which is the default."),
    ] = None,
    threshold: Annotated[
        list[str] | None,
        typer.Option(help="Growth that is allowed, e.g. time=5% or quads=0%; repeatable."),
    ] = None,
    normalise: Annotated[
        Literal["auto", "reference", "none"] | None,
        typer.Option(
            help="How to correct times for the machine's speed: auto (by other cases of the same "
            "rounds, else by the reference draw), reference, or none."
        ),
    ] = None,
    across_devices: Annotated[
        bool, typer.Option("--across-devices", help="Compare runs of different devices.")
    ] = False,
    require_all: Annotated[
        bool, typer.Option("--require-all", help="Fail if HEAD's plan lacks a case of BASE, too.")
    ] = False,
    allow_inconclusive: Annotated[
        bool, typer.Option("--allow-inconclusive", help="Exit with 0 if times are too noisy.")
    ] = False,
    allow_missing_baseline: Annotated[
        bool, typer.Option("--allow-missing-baseline", help="Exit with 0 if BASE is not there yet.")
    ] = False,
    output: Annotated[
        Literal["table", "markdown", "json"],
        typer.Option("--format", help="What to write to standard output."),
    ] = "table",
    markdown: Annotated[Path | None, typer.Option(help="Write Markdown to this file.")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML to this file.")] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write JSON to this file.")
    ] = None,
    html: Annotated[Path | None, typer.Option(help="Write one HTML page to this file.")] = None,
    repeat: Annotated[
        bool,
        typer.Option(
            "--repeat",
            help="Of two runs of one plan: say whether counters are equal, exit with 1 if not, "
            "and how often verdicts on which is faster agree; nothing else.",
        ),
    ] = False,
) -> None:
    """Say what changed from BASE to HEAD; exit with 1 if something became slower or costs more.

    Counters are exact: any difference is real. Times are statistical: regressed, improved,
    unchanged, or inconclusive. Settings are also read from pyproject.toml, table
    tool.raster-harness. If $GITHUB_STEP_SUMMARY names a file, the Markdown is added to it.

    Exit codes: 0 no regression, 1 regression, 2 bad usage, 4 nothing comparable, 5 inconclusive.
    """
    if repeat:
        _compare_repeated(base, head)
    from harness.compare.comparison import compare_runs, no_baseline
    from harness.compare.model import from_project, parse_gates, parse_threshold
    from harness.results.run_folder import read_run

    settings = from_project(Path.cwd())
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
    before = _baseline(base, allow_missing=allow_missing_baseline)
    grown: list[Grown] = []
    if before is None:
        found = no_baseline(str(base), after, settings)
    else:
        found = compare_runs(before, after, settings)
        if found.regressed():
            from harness.compare.polygons import most_grown

            grown = most_grown(before, after, found)
    try:
        typer.echo(_text(found, output, grown), nl=False)
        sys.stdout.flush()
    except BrokenPipeError:  # who stops reading early changes no exit code
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    for kind, file in {
        "markdown": markdown,
        "junit": junit,
        "json": json_file,
        "html": html,
    }.items():
        if file is not None:
            from harness.webpages import write_whole

            write_whole(file, _text(found, kind, grown))
    if summary := os.environ.get("GITHUB_STEP_SUMMARY"):
        with Path(summary).open("a", encoding="utf-8") as stream:
            stream.write(_text(found, "markdown", grown))
    raise typer.Exit(found.exit_code)


def _baseline(path: Path, *, allow_missing: bool) -> Run | None:
    """Read BASE; None where it is not there and may be missing."""
    from harness.results.run_folder import read_run

    there = path.is_file() or any((path / name).exists() for name in ("run.json", "cases.jsonl"))
    if there:
        return read_run(path)
    if allow_missing:
        return None
    raise UsageError(
        f"no baseline: {path} holds no run; keep one there, or give --allow-missing-baseline "
        "to let a first run pass"
    )


def _text(found: Comparison, kind: str, grown: Sequence[Grown]) -> str:
    from harness.compare import outputs

    if kind == "table":
        console = Screen()
        with console.capture() as shown:
            outputs.print_comparison(found, console)
        return shown.get()
    if kind == "html":
        return outputs.to_html(found, grown)
    if kind == "json":
        told = json.dumps(outputs.to_json(found), indent=2, ensure_ascii=False, allow_nan=False)
        return told + "\n"
    return (
        outputs.to_markdown(found, grown=grown) if kind == "markdown" else outputs.to_junit(found)
    )


def _compare_repeated(first: Path, second: Path) -> None:
    """Check that two runs of one plan have equal counters, and say how often verdicts agree.

    Two triangulations of the same polygons that were timed together are a pair. Each run has a
    verdict on the pair: faster, slower, or no difference shown, which means that the two are too
    close for the time spent. Exits with 1 if a counter differs.
    """
    from harness.compare.matching import repeat as agreement
    from harness.results.run_folder import read_run

    cases, unequal, verdicts = agreement(read_run(first).records, read_run(second).records)
    if not cases:
        raise UsageError(f"{first} and {second} have no case in common: run the same plan twice")
    typer.echo(f"counters: equal in {cases - len(unequal):,} of {cases:,} cases")
    for key in unequal[:5]:
        typer.echo(f"  differ: {key}")
    for (rasteriser, device), (pairs, same, decided, agreeing) in verdicts.items():
        which = f"both runs say which is faster for {decided:,}"
        if decided:
            which += f", and agree on {agreeing / decided:.2%} of these"
        typer.echo(
            f"{rasteriser} on {device}, {pairs:,} pairs: {which}; all three verdicts counted, they "
            f"agree on {same / pairs:.1%}"
        )
    raise typer.Exit(1 if unequal else 0)


def _only(kind: str) -> Any:
    return typer.Option(parser=several(), metavar="NAME,...", help=f"Only these {kind}.")


def history(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Runs, or folders with some in them."),
    ],
    metrics: Annotated[
        Several,
        typer.Option(
            "--metrics",
            "--metric",
            parser=several(),
            metavar="NAME,...",
            help="Metrics: time, and those of: raster-harness list metrics. By default time and "
            "the counters that stand for the cost.",
        ),
    ] = Several(HISTORY_METRICS),
    scene: Annotated[Several | None, _only("scenes")] = None,
    triangulator: Annotated[Several | None, _only("triangulators")] = None,
    rasteriser: Annotated[Several | None, _only("rasterisers")] = None,
    everything: Annotated[
        bool,
        typer.Option("--all", help="Everything, also studies, and what only one run measured."),
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder for the plots and history.csv.")] = Path(
        "results/history"
    ),
) -> None:
    """Show what changed over runs, in the order they were made.

    Counters change wherever they differ. Times are taken beside those of the other cases of
    their runs, and change where their level does for three runs or more. What changed most is
    shown, at most a dozen series: choose by --scene, --triangulator, --rasteriser, --metric, or
    --all. Studies are left out: they measure each case once.
    """
    from harness import atomic
    from harness.history import find_runs, matching, plot_history, read_series, worth_showing
    from harness.metrics import groups
    from harness.style import count

    runs, studies = find_runs(folders, studies=everything)
    if studies:
        typer.echo(f"left out: {count(studies, 'study', 'studies')}; see --all")
    if not runs:
        raise NothingMeasured("all runs are studies, which measure each case once; see --all")
    chosen = {"scene": scene, "triangulator": triangulator, "rasteriser": rasteriser}
    series = matching(read_series(runs, metrics), {k: v for k, v in chosen.items() if v})
    if not series:
        raise NothingMeasured(f"none of the {len(runs)} runs has any of: {metrics}")
    shown = series if everything else worth_showing(series)
    if shown:
        with atomic.folder(out, added=True) as made:
            plot_history(runs, shown, made)
            _write_csv(runs, shown, made / "history.csv")
    for run in runs:
        for problem in run.problems:
            typer.echo(f"warning: {problem}")
    if mixed := groups.several_processors(runs):
        typer.echo(f"several processors, whose times stay apart: {groups.processor_words(mixed)}")
    for line in changes(runs, shown):
        typer.echo(line)
    left = len(series) - len(shown)
    rest = f"; {left:,} more series: --all, or choose by --scene, --triangulator ..." * bool(left)
    where = str(out) if shown else "no case was measured by two runs"
    typer.echo(f"{count(len(runs), 'run')}, {len(shown)} series: {where}{rest}")


def changes(runs: Sequence[Run], series: Sequence[Series]) -> list[str]:
    """Return one line for each change: when, of what, from which level to which."""
    from harness.history import run_label
    from harness.style import step

    lines = []
    for entry in series:
        where = f"{entry.metric} of {entry.name.triangulator}, {entry.name.where}"
        for place, (before, after) in zip(entry.changes, entry.steps, strict=True):
            label = run_label(runs[place]).replace("\n", ", ")
            lines.append(f"{label}: {where}: {step(before, after)}")
    return lines or ["nothing changed"]


def _write_csv(runs: Sequence[Run], series: Sequence[Series], file: Path) -> None:
    """Write one row for each value of each series."""
    import pandas as pd

    rows = []
    for entry in series:
        case = (entry.metric, entry.name.triangulator, entry.name.where)
        for number, (run, value) in enumerate(zip(runs, entry.values, strict=True)):
            created = run.facts.get("created") or ""
            rows.append((run.path, created, *case, value, int(number in entry.changes)))
    names = ["run", "created", "metric", "triangulator", "where", "value", "change"]
    pd.DataFrame(rows, columns=names).to_csv(file, index=False, lineterminator="\r\n")
