"""`harness run`: measure triangulators on a scene."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from harness.commands import options
from harness.errors import UsageError
from harness.progress import Reporter, Screen
from harness.settings import (
    CHOSEN_FITS,
    DEFAULT_TRIANGULATORS,
    MAX_REPEATS,
    MODEL_TRIANGULATORS,
    QUICK_TIMEOUT_S,
    TIMEOUT_S,
    TimingSettings,
)

PLAN_OPTIONS = (  # parameters that only a run with --scene uses
    *("layer", "condition", "limit", "triangulators", "rasterisers", "device", "resolution"),
    *("rotation", "fit", "samples", "work", "texture", "order", "seed", "precision", "repeats"),
    *("budget", "timeout"),
)

QUICK = TimingSettings(precision=0.03, budget_s=0.3, warm_up_s=0.1)  # for --quick


def run(
    context: typer.Context,
    scene: Annotated[
        str | None,
        typer.Option(
            help="A scene's name, e.g. city or city:buildings=2000, a file (GeoJSON, GeoPackage, "
            "Shapefile, SVG, WKT and more), a model from all sides (part.glb:views=24), or "
            "module:function. See: raster-harness list scenes.",
        ),
    ] = None,
    layer: options.Layer = None,
    condition: options.Condition = None,
    limit: options.Limit = None,
    triangulators: options.Triangulators = options.ValueList(DEFAULT_TRIANGULATORS),
    rasterisers: options.Rasterisers = None,
    device: options.Devices = None,
    resolution: options.Resolutions = options.ValueList((1024,)),
    rotation: options.Rotations = options.ValueList((0.0,)),
    fit: Annotated[
        CHOSEN_FITS,
        typer.Option(
            help="What fills the picture: the rotated scene's bounding box (box), or its enclosing "
            "circle, which keeps the scale equal at every rotation (circle)."
        ),
    ] = "box",
    samples: options.Samples = options.ValueList((1,)),
    work: options.Works = options.ValueList((0,)),
    texture: options.Textures = options.ValueList((0,)),
    order: options.Orders = options.ValueList(("native",)),
    seed: options.Seed = 0,
    precision: options.Precision = TimingSettings.precision,
    repeats: Annotated[
        int,
        typer.Option(
            min=1,
            max=MAX_REPEATS,
            help="Number of fresh processes that repeat the timing, one after the other; "
            "intervals are then over the processes. Five give narrower intervals than two.",
        ),
    ] = 1,
    budget: options.Budget = TimingSettings.budget_s,
    timeout: options.Timeout = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; results/<scene>-<time> if absent.")
    ] = None,
    resume: options.Resume = None,
    force: options.Force = False,
    profile: Annotated[
        str | None,
        typer.Option(
            help="A device's profile: a file, or the name of a contributed profile, such as "
            "opengl-h200. The report then predicts times on that device, and optimal:calibrated "
            "minimises that device's costs. See: raster-harness profile.",
        ),
    ] = None,
    baseline_reference: Annotated[
        str | None,
        typer.Option(
            "--beside",
            help="Measure another version of your code in the same rounds: a commit or branch of "
            "your repository, or a folder. Its results are a run in the subfolder base.",
        ),
    ] = None,
    draw_twice: Annotated[
        bool,
        typer.Option(
            "--draw-twice",
            help="With --beside: if both versions return equal triangles, time the drawings of "
            "both. This shows how much the times of equal drawings differ.",
        ),
    ] = False,
    cached: Annotated[
        bool,
        typer.Option("--cache/--no-cache", help="Use the model database of triangulations."),
    ] = True,
    report: Annotated[
        bool,
        typer.Option(
            "--report/--no-report",
            help="Write the report and its plots; otherwise raster-harness report writes them "
            "later, e.g. when a rented machine has only measured.",
        ),
    ] = True,
    quick: options.Quick = False,
    base: options.Base = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Measure triangulators on a scene, with exact counters and repeated times; store the run."""
    from harness.commands import runs
    from harness.frame import View, is_model_with_views
    from harness.machine.system import get_database_path
    from harness.measuring.other_version import FOLDER as BASE_FOLDER
    from harness.measuring.plan import Plan
    from harness.measuring.run import RunOptions
    from harness.measuring.run import run as carry_out
    from harness.rasterisers.base import Options
    from scenes.spec import join_name

    timing = replace(QUICK if quick else TimingSettings(), processes=repeats)
    if options.is_given(context, "precision"):
        timing = replace(timing, precision=precision)
    if options.is_given(context, "budget"):
        timing = replace(timing, budget_s=budget)
    profile_file = runs.find_profile_file(profile, resume)
    if resume and not scene:
        plan = runs.read_plan(resume)
    elif not scene:
        raise UsageError("--scene is missing; try --scene city, or your own file")
    else:
        runs.refuse_another_view(context, scene)
        if is_model_with_views(scene) and not options.is_given(context, "triangulators"):
            triangulators = options.ValueList(MODEL_TRIANGULATORS)
        plan = Plan(
            scene=join_name(scene, layer=layer, where=condition, limit=limit),
            seed=seed,
            triangulators=runs.parse_recipes(triangulators, seed, profile_file),
            rasterisers=options.choose_rasterisers(rasterisers),
            devices=tuple(device or ()),
            views=tuple(View(size, angle, fit) for size in resolution for angle in rotation),
            options=tuple(
                Options(
                    samples=count, work=iterations, order=triangle_order, seed=seed, texture=lookups
                )
                for count in samples
                for iterations in work
                for lookups in texture
                for triangle_order in order
            ),
            timing=timing,
            timeout_s=timeout or (QUICK_TIMEOUT_S if quick else TIMEOUT_S),
        )
    folder = runs.choose_folder(plan.scene, out, resume)
    reporter = Reporter(quiet=quiet, verbose=verbose)
    given = [name for name in PLAN_OPTIONS if options.is_given(context, name)]
    if given and not scene:
        names = ", ".join("--where" if name == "condition" else f"--{name}" for name in given)
        reporter.warn(
            f"{names}: ignored, as --resume continues the stored plan; to change the plan, give "
            "--scene, all options of the run, and --force"
        )
    with runs.open_baseline(baseline_reference, plan, resume, twice=draw_twice) as baseline:
        run_options = RunOptions(
            resume=resume is not None,
            force=force,
            database=get_database_path() if cached else None,
            baseline=baseline,
            base=runs.resolve_base_name(base, plan),
            **runs.read_profile_options(profile_file),
        )
        result = carry_out(plan, folder, reporter, run_options)
    if as_json:
        typer.echo(
            json.dumps(
                runs.make_json_content(result), indent=2, ensure_ascii=False, allow_nan=False
            )
        )
    # With --json, standard output holds nothing but the JSON.
    screen = Screen(stderr=as_json, quiet=as_json)
    runs.finish_run(result, screen, reporter, report=report, plots=not quick)
    if baseline and not as_json:
        path = os.path.relpath(result.path)
        typer.echo(f"to compare: raster-harness compare {path}/{BASE_FOLDER} {path}")
