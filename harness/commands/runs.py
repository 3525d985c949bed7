"""Shared by commands that measure: plan and options of a run; folder, summary and exit code."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from harness import atomic
from harness.commands.options import PROFILES, is_given
from harness.errors import (
    INTERRUPTED,
    HarnessError,
    InconclusiveError,
    InputError,
    NothingMeasuredError,
    UsageError,
)
from harness.frame import FIXED_VIEW_MESSAGE, FIXED_VIEWS, is_model_with_views
from harness.measuring.other_version import OtherVersion, open_other_version
from harness.measuring.plan import Plan
from harness.measuring.run import RunOptions, RunResult, ScenePart
from harness.measuring.run import run as carry_out
from harness.metrics.decision import COVERED, decide_run
from harness.metrics.groups import describe_machine
from harness.metrics.run_quality import get_run_state
from harness.progress import Reporter, Screen
from harness.results.run_folder import (
    STORED_PROFILE,
    Run,
    make_file_stem,
    read_run,
    translate_errors,
)
from harness.summary import list_rows, print_summary, write_csv
from harness.triangulating.recipes import CALIBRATED, Recipe, parse, parse_all
from scenes import Scene
from scenes.registry import is_tiled
from scenes.spec import format_label


@contextmanager
def open_baseline(
    reference: str | None, plan: Plan, resume: Path | None, *, twice: bool
) -> Iterator[OtherVersion | None]:
    """Yield the interleaved baseline that --beside or the resumed run names, or None."""
    stored = (read_run(resume).facts.get("beside") or {}) if resume else {}
    reference = reference or str(stored.get("base") or "")
    if not reference:
        if twice:
            raise UsageError("--draw-twice requires --beside")
        yield None
        return
    with open_other_version(reference, [recipe.base for recipe in plan.triangulators]) as baseline:
        yield replace(baseline, twice=twice or bool(stored.get("twice")))


def resolve_base_name(name: str | None, plan: Plan) -> str | None:
    """Return the full name of the triangulator that --base names, or None."""
    if not name:
        return None
    names = [str(recipe) for recipe in plan.triangulators]
    full_name = str(parse(name, seed=plan.seed))
    if full_name not in names:
        raise UsageError(f"--base {name}: not among --triangulators {','.join(names)}")
    return full_name


def parse_recipes(triangulators: Sequence[str], seed: int, file: Path | None) -> tuple[Recipe, ...]:
    """Parse --triangulators; read the coefficients of optimal:calibrated from a profile's file."""
    recipes = parse_all(triangulators, seed=seed)
    if not any(recipe.base.endswith(CALIBRATED) for recipe in recipes):
        return recipes
    if file is None:
        raise UsageError(
            "optimal:calibrated needs --profile FILE; make one: raster-harness profile"
        )
    from harness.profile.profile import read_coefficients

    return parse_all(triangulators, seed=seed, calibration=read_coefficients(file))


def find_profile_file(name: str | None, resume: Path | None) -> Path | None:
    """Return the file of --profile or, without --profile, the resumed run's profile, if any."""
    if name:
        from harness.profile.device_costs import find_profile

        return find_profile(name, PROFILES)
    stored = resume and resume / STORED_PROFILE
    return stored if stored and stored.is_file() else None


def read_profile_options(file: Path | None) -> dict[str, Any]:
    """Return the fields `profile` and `calibrate` of `RunOptions`, or {} if `file` is None."""
    if file is None:
        return {}
    from harness.profile.device_costs import minimise_slowest_stage, read_costs

    device = read_costs(file)
    has_stages = len(device.stages) > 1
    calibrate = partial(minimise_slowest_stage, device) if has_stages else None
    return {"profile": atomic.read(file), "calibrate": calibrate}


def refuse_another_view(context: typer.Context, scene: str) -> None:
    """Raise UsageError if view options are given for map tiles or a model, which define a view."""
    kind = "view" if is_model_with_views(scene) else "tile" if is_tiled(scene) else ""
    if kind and is_given(context, "resolution", "rotation", "fit"):
        raise UsageError(FIXED_VIEW_MESSAGE.format(FIXED_VIEWS[kind]))


def read_plan(folder: Path) -> Plan:
    """Return the plan of the run in a folder; raise InputError if the folder has none."""
    facts = read_run(folder).facts
    try:
        return Plan.from_json(facts.get("plan", {}))
    except HarnessError as error:
        raise InputError(f"{folder}: no plan to resume ({error})") from error


def choose_folder(
    scene: str, out: Path | None, resume: Path | None = None, before: str = ""
) -> Path:
    """Return the folder of --out or --resume, or a new one in results/ with the prefix `before`."""
    if out and resume:
        raise UsageError(
            "--out and --resume are mutually exclusive: --resume writes to the resumed folder"
        )
    name = before + make_file_stem(Path(format_label(scene)).stem)
    first = Path("results") / f"{name}-{time.strftime('%Y%m%d-%H%M%S')}"
    new, number = first, 2
    while new.exists():  # two short runs may start within a second
        new, number = first.with_name(f"{first.name}-{number}"), number + 1
    return resume or out or new


def require_finished(outcome: RunResult, resume_hint: str, *, quiet: bool = False) -> None:
    """Exit if the run was stopped; raise NothingMeasuredError if no case was measured."""
    if outcome.interrupted:
        if not quiet:
            typer.echo(f"stopped early; {resume_hint}")
        raise typer.Exit(INTERRUPTED)
    if not any(record.is_ok for record in outcome.records):
        path = os.path.relpath(outcome.path)
        first = next(iter(outcome.records), None)
        reason = f" ({first.name}: {first.reason})" if first and first.reason else ""
        raise NothingMeasuredError(
            f"nothing was measured: every case was skipped or failed{reason}; all reasons are in "
            f"{path}/cases.jsonl"
        )


def measure_study(
    plan: Plan,
    split: Callable[[str, Scene], list[ScenePart]],
    folder: Path,
    reporter: Reporter,
    *,
    resume: bool,
    force: bool,
) -> Run:
    """Measure or resume a run of the parts that `split` returns for a label and a scene."""
    outcome = carry_out(plan, folder, reporter, RunOptions(resume, force, split))
    require_finished(outcome, f"continue with the same command and --resume {folder}")
    return read_run(folder)


def raise_if_cases_failed(outcome: RunResult | Run) -> None:
    """Raise InconclusiveError if a case failed; a skipped case is not a failure."""
    failed = [record for record in outcome.records if record.status == "failed"]
    if failed:
        names = ", ".join(dict.fromkeys(record.name for record in failed))
        raise InconclusiveError(
            f"{len(failed)} of {len(outcome.records)} cases failed ({names}); the others are in "
            f"{os.path.relpath(outcome.path)}"
        )


def finish_study(run: Run) -> None:
    """Print a study's disturbances, folder and report; raise InconclusiveError if a case failed."""
    for line in get_run_state(run).warnings:
        typer.echo(line)
    typer.echo(f"study: {run.path}\nto look at: {run.path}/report.html")
    raise_if_cases_failed(run)


def make_json_content(outcome: RunResult) -> dict[str, Any]:
    """Return the content of `--json`: the run's folder, and the cases as in summary.csv."""
    return {
        "results": os.path.relpath(outcome.path),
        "interrupted": outcome.interrupted,
        "cases": list_rows(outcome.decided),
    }


def finish_run(
    outcome: RunResult,
    console: Console,
    reporter: Reporter,
    *,
    report: bool = True,
    plots: bool = True,
) -> None:
    """Print and store the results; raise or exit with the command's exit code."""
    path = os.path.relpath(outcome.path)
    remedy = f"raster-harness report {path}; the measurements are safe"
    measured = [record for record in outcome.records if record.is_ok]
    with translate_errors(outcome.path, remedy):
        write_csv(outcome.decided, outcome.path / "summary.csv")
    print_summary(outcome.decided, console)
    for line in describe_machine(outcome.run):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    console.print(f"results: {path}", markup=False, soft_wrap=True)
    if measured and report and not outcome.aborted:
        from harness.report import matrix
        from harness.report.page import write_report
        from harness.report.plots import plot_run

        with reporter.stage("evaluating criteria", 1), translate_errors(outcome.path, remedy):
            matrix.write_spread(outcome.run)
        with reporter.stage("plotting", 1), translate_errors(outcome.path, remedy):
            write_report(outcome.run, decided=outcome.decided)
            if plots:
                plot_run(outcome.run)
        console.print(f"to look at: {path}/report.html", markup=False, soft_wrap=True)
    hint = f"continue with: raster-harness run --resume {outcome.path}"
    require_finished(outcome, hint, quiet=console.quiet)
    covered = [record.counters.get(COVERED) for record in measured]
    if covered and not any(count is None or count > 0 for count in covered):
        raise NothingMeasuredError(
            "none of the measured cases covers a pixel: a polygon far from the others makes all"
            " of them tiny; exclude it by --where or --limit, or give a larger --resolution"
        )
    raise_if_cases_failed(outcome)


def make_run(folder: Path, write: Callable[[Path], object], *, quiet: bool) -> Run:
    """Create a run folder by `write`, add table and report, and print the summary."""
    from harness.report.page import write_report

    with translate_errors(folder), atomic.create_folder(folder) as new_folder:
        write(new_folder)
        stored = read_run(new_folder)
        decided = decide_run(stored)
        write_csv(decided, new_folder / "summary.csv")
        write_report(stored, decided=decided)
    stored = read_run(folder)
    console = Screen(quiet=quiet)
    print_summary(decided, console)
    console.print(f"results: {os.path.relpath(folder)}", markup=False, soft_wrap=True)
    return stored
