"""`harness run`: measure triangulators on a scene."""

from __future__ import annotations

import importlib
import json
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.console import Console

from harness.commands.options import (
    CALIBRATIONS,
    Base,
    Force,
    Json,
    Quiet,
    Rasterisers,
    Seed,
    Verbose,
    Work,
    named_rasterisers,
    numbers,
    split_names,
)
from harness.commands.results import folder_for, require_finished
from harness.errors import Inconclusive, UsageError
from harness.figures.groups import base_of, groups
from harness.frame import FitMode, View
from harness.measuring.plan import DEFAULT_TRIANGULATORS, Plan
from harness.measuring.run import RunResult
from harness.measuring.run import run as carry_out
from harness.measuring.timing import TimingSettings
from harness.measuring.two_versions import FOLDER as BASE_FOLDER
from harness.measuring.two_versions import Beside, version
from harness.progress import Reporter
from harness.rasterisers.base import Options
from harness.rasterisers.order import Order
from harness.stored.folder import clear_errors, read_run
from harness.summary import print_summary, row_of, write_csv
from harness.triangulating.database import default_path
from harness.triangulating.names import CALIBRATED, Recipe, parse, parse_all
from scenes.spec import joined

QUICK = TimingSettings(precision=0.03, budget_s=0.3, warm_up_s=0.1)
QUICK_TIMEOUT_S = 60.0


def run(
    scene: Annotated[
        str,
        typer.Option(
            help="A scene's name, e.g. city or city:buildings=2000, a file (GeoJSON, GeoPackage, "
            "Shapefile, SVG, WKT and more), or module:function. See: harness list scenes.",
        ),
    ] = "",
    layer: Annotated[str | None, typer.Option(help="Layer of the file.")] = None,
    where: Annotated[
        str | None, typer.Option(help="Filter by attributes, as in SQL: height > 10.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Polygons to read at most.")] = None,
    triangulators: Annotated[
        str, typer.Option(help="Comma-separated; see: harness list triangulators.")
    ] = ",".join(DEFAULT_TRIANGULATORS),
    rasterisers: Rasterisers = "",
    device: Annotated[
        str, typer.Option(help="Comma-separated devices; the best one by default.")
    ] = "",
    resolution: Annotated[
        str, typer.Option(help="Viewport width and height in pixels; comma-separated.")
    ] = "1024",
    rotation: Annotated[
        str, typer.Option(help="Degrees, counter-clockwise; comma-separated.")
    ] = "0",
    fit: Annotated[
        FitMode,
        typer.Option(help="circle keeps the scale the same at every rotation; box does not."),
    ] = "box",
    samples: Annotated[
        str, typer.Option(help="Samples per pixel: 1, 4 or 8; comma-separated.")
    ] = "1",
    work: Work = "0",
    order: Annotated[
        str,
        typer.Option(
            help="Orders of the triangles in a draw: native (as they were made), walk, "
            "vertex-cache, morton, shuffled; comma-separated."
        ),
    ] = "native",
    seed: Seed = 0,
    precision: Annotated[
        float, typer.Option(help="Wanted half-width of the 95 % interval over the median.")
    ] = TimingSettings.precision,
    budget: Annotated[
        float, typer.Option(help="Seconds of drawing per case, on average.")
    ] = TimingSettings.budget_s,
    timeout: Annotated[
        float | None,
        typer.Option(
            help="Seconds after which a triangulator or device is stopped; by default "
            f"{Plan.timeout_s:g}, or {QUICK_TIMEOUT_S:g} with --quick."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; results/<scene>-<time> if absent.")
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(help="Continue the run in this folder; failed cases are tried again."),
    ] = None,
    force: Force = False,
    calibration: Annotated[
        Path | None, typer.Option(help="What optimal:calibrated minimises; see: harness calibrate.")
    ] = None,
    beside: Annotated[
        str,
        typer.Option(
            help="Measure another version of your code in the same rounds: a commit or branch of "
            "your repository, or a folder. It becomes the run `base` in the folder."
        ),
    ] = "",
    draw_twice: Annotated[
        bool,
        typer.Option(
            "--draw-twice",
            help="With --beside: draw twice also what both versions triangulate alike. This shows "
            "how far times of equal drawings lie apart.",
        ),
    ] = False,
    cached: Annotated[
        bool,
        typer.Option("--cache/--no-cache", help="Use the model database of triangulations."),
    ] = True,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Short times, wide intervals: a look, not a result."),
    ] = False,
    dask: Annotated[
        str,
        typer.Option(
            help="Address of a Dask scheduler: measure on every device that its workers offer as "
            "resources, and merge what they find."
        ),
    ] = "",
    base: Base = "",
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Measure triangulators on a scene, with exact counters and repeated times; store it all."""
    orders = cast("tuple[Order, ...]", split_names(order))  # Options checks them
    timing = QUICK if quick else TimingSettings(precision=precision, budget_s=budget)
    plan = None
    if resume and not scene:
        plan = _stored_plan(resume)
    elif not scene:
        raise UsageError("--scene is missing; try --scene city, or your own file")
    else:
        plan = Plan(
            scene=joined(scene, layer=layer, where=where, limit=limit),
            seed=seed,
            triangulators=_recipes(triangulators, seed, calibration, device),
            rasterisers=named_rasterisers(rasterisers),
            devices=split_names(device),
            views=tuple(
                View(int(size), angle, fit)
                for size in numbers(resolution, "--resolution", int)
                for angle in numbers(rotation, "--rotation", float)
            ),
            options=tuple(
                Options(samples=int(count), work=int(iterations), order=each, seed=seed)
                for count in numbers(samples, "--samples", int)
                for iterations in numbers(work, "--work", int)
                for each in orders
            ),
            timing=timing,
            timeout_s=timeout or (QUICK_TIMEOUT_S if quick else Plan.timeout_s),
        )
    folder = folder_for(plan.scene, out, resume)
    _load_ahead()
    reporter = Reporter(quiet=quiet, verbose=verbose)
    if dask:
        if beside or resume or as_json or base:
            raise UsageError("--dask goes with none of --beside, --resume, --json and --base")
        _on_a_farm(plan, folder, dask, reporter)
        return
    with _beside(beside, plan, resume, twice=draw_twice) as other:
        outcome = carry_out(
            plan,
            folder,
            reporter,
            resume=resume is not None,
            force=force,
            database=default_path() if cached else None,
            beside=other,
            base=_base(base, plan),
        )
    if as_json:
        typer.echo(json.dumps(told(outcome), indent=2, ensure_ascii=False, allow_nan=False))
    # Standard output is the other program's then.
    finish(outcome, Console(stderr=as_json, quiet=as_json), reporter)
    if other and not as_json:
        where = os.path.relpath(outcome.path)
        typer.echo(f"to compare: python -m harness compare {where}/{BASE_FOLDER} {where}")


def _on_a_farm(plan: Plan, folder: Path, where: str, reporter: Reporter) -> None:
    """Measure on the devices of many hosts; raises Inconclusive if groups were set aside."""
    from harness.scaling.farm import measure

    outcome, aside = measure(plan, folder, where, reporter)
    finish(outcome, Console(), reporter)
    for name, why in aside.items():
        reporter.warn(f"set aside {name}: {why}")
    if aside:
        raise Inconclusive(f"{len(aside)} groups of cases were set aside; give the command again")


@contextmanager
def _beside(
    reference: str, plan: Plan, resume: Path | None, *, twice: bool
) -> Iterator[Beside | None]:
    """Give what a run is measured beside, also where it goes on with one that was; None if not."""
    stored = (read_run(resume).facts.get("beside") or {}) if resume else {}
    reference = reference or str(stored.get("base") or "")
    if not reference:
        if twice:
            raise UsageError("--draw-twice is for runs --beside another version")
        yield None
        return
    with version(reference, [recipe.base for recipe in plan.triangulators]) as place:
        yield Beside(place, twice or bool(stored.get("twice")))


def _base(name: str, plan: Plan) -> str | None:
    """Return the full name of the base that the user chose, None if none."""
    if not name:
        return None
    known = [str(recipe) for recipe in plan.triangulators]
    found = str(parse(name, seed=plan.seed))
    if found not in known:
        raise UsageError(f"--base {name}: it is not among --triangulators {','.join(known)}")
    return found


def _recipes(triangulators: str, seed: int, file: Path | None, device: str) -> tuple[Recipe, ...]:
    """Read the triangulators, and the calibration that optimal:calibrated needs.

    file : by default that of the device
    """
    recipes = parse_all(split_names(triangulators), seed=seed)
    if not any(recipe.base.endswith(CALIBRATED) for recipe in recipes):
        return recipes
    from harness.study.calibration_draws import read_coefficients

    devices = split_names(device)
    if file is None and len(devices) != 1:
        raise UsageError("optimal:calibrated needs --calibration FILE, or one --device")
    coefficients = read_coefficients(file or CALIBRATIONS / f"{devices[0]}.json")
    return parse_all(split_names(triangulators), seed=seed, calibration=coefficients)


def _load_ahead() -> None:
    """Import what draws plots and tables while other processes triangulate: it takes seconds."""

    def load() -> None:
        for name in ("pandas", "matplotlib.figure", "scipy.stats"):
            importlib.import_module(name)

    threading.Thread(target=load, daemon=True).start()


def _stored_plan(folder: Path) -> Plan:
    facts = read_run(folder).facts
    try:
        return Plan.from_json(facts["plan"])
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{folder}/run.json holds no plan to resume: {error!r}") from error


def told(outcome: RunResult) -> dict[str, Any]:
    """Return what `--json` writes: where the run is, and each case as in summary.csv."""
    rows = []
    for members in groups(read_run(outcome.path).records):
        base = base_of(members)
        rows += [row_of(record, base) for record in members]
    place = os.path.relpath(outcome.path)
    return {"results": place, "interrupted": outcome.interrupted, "cases": rows}


def finish(outcome: RunResult, console: Console, reporter: Reporter) -> None:
    """Show and store what came out; ends the process with the exit code of the design.

    Raises
    ------
    NothingMeasured
        if no case was measured
    """
    where = os.path.relpath(outcome.path)
    again = f"python -m harness report {where}"
    measured = [record for record in outcome.records if record["status"] == "ok"]
    stored = read_run(outcome.path)
    with clear_errors(outcome.path, again):
        write_csv(stored.records, outcome.path / "summary.csv")
    print_summary(stored.records, console)
    console.print(f"results: {where}", markup=False, soft_wrap=True)
    if measured and not outcome.hurried:
        from harness.report import write_report
        from harness.report.plots import plot_run
        from harness.study import polygon_ranking

        with reporter.stage("judging criteria", 1), clear_errors(outcome.path, again):
            polygon_ranking.write(stored)
        with reporter.stage("plotting", 1), clear_errors(outcome.path, again):
            plot_run(stored)
            write_report(stored)
        console.print(f"to look at: {where}/report.html", markup=False, soft_wrap=True)
    require_finished(outcome, console, f"continue with: harness run --resume {outcome.path}")


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(run)
