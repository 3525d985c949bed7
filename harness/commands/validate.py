"""`harness study validate`: does a criterion predict what was measured?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.commands import options
from harness.progress import Reporter
from harness.study.subjects import Design

COUNTED_ON_THE_CPU = ("reference", "binning")
"""Rasterisers whose counters are the exact predictions."""

ENOUGH = 12
"""Polygons below which a study says that it is a look and no result."""

QUICK = Design(polygons=6, random=10, most_vertices=60)
QUICK_S = 0.02
"""Seconds of drawing each triangulation, and of its first draws."""


def validate(
    scene: options.SceneName = "city",
    rasterisers: options.Rasterisers = None,
    device: options.Devices = None,
    resolution: options.Resolutions = options.Several((128,)),
    work: options.Works = options.Several((0, 8)),
    polygons: Annotated[int, typer.Option(min=1, help="Polygons to study.")] = Design.polygons,
    random: Annotated[
        int, typer.Option(min=0, help="Random triangulations of each polygon.")
    ] = Design.random,
    seed: options.Seed = 0,
    budget: options.Budget = 0.1,
    out: Annotated[Path | None, options.study_folder("validate")] = None,
    resume: options.Resume = None,
    force: options.Force = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Six polygons, short times: a look, not a result.")
    ] = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Say how well each criterion predicts the measured cost, within single polygons.

    Each polygon is drawn with many triangulations, named and random ones. A criterion is good if it
    ranks the triangulations of one polygon as the measured cost does, and if the one that it calls
    best costs little more than the best there is: its regret.
    """
    from harness.commands.running import measure_study, require_all
    from harness.frame import View
    from harness.measuring.plan import Plan
    from harness.measuring.run import Part
    from harness.rasterisers.base import Options
    from harness.report import write_report
    from harness.settings import TimingSettings
    from harness.stored import atomic
    from harness.study import correlations, regret
    from harness.study.subjects import choose_polygons, choose_triangulators
    from harness.triangulating.recipes import parse_all
    from scenes import Scene

    design = QUICK if quick else Design(polygons=polygons, random=random)
    named = options.named_rasterisers(rasterisers, "bounding-box")
    plan = Plan(
        scene=scene,
        seed=seed,
        triangulators=parse_all(["optimal"]),  # each polygon has its own, below
        rasterisers=tuple(dict.fromkeys([*named, *COUNTED_ON_THE_CPU])),
        devices=tuple(device or ()),
        views=tuple(View(size) for size in resolution),
        # In one kind of order, so that nothing but the diagonals differs.
        options=tuple(Options(work=count, order="walk") for count in work),
        timing=TimingSettings(0.01, budget_s=QUICK_S if quick else budget, warm_up_s=QUICK_S),
    )
    reporter = Reporter(quiet=quiet, verbose=verbose)

    def take_apart(label: str, whole: Scene) -> list[Part]:
        return [
            Part(f"{label}#{number}", part, choose_triangulators(design, part.polygons[0]))
            for number, part in choose_polygons(whole, design)
        ]

    run = measure_study(plan, take_apart, "validate", reporter, out=out, resume=resume, force=force)
    with reporter.stage("correlating", 1):
        table = correlations.measure_table(run.records)
        with atomic.folder(run.path, added=True) as made:
            ranked = correlations.write(table, made)
            correlations.plot_study(ranked, table, made)
            lost = regret.write(run.records, made)
        write_report(run)
    correlations.print_matrix(ranked, Console())
    regret.print_regret(lost, Console())
    if (few := table["polygon"].nunique()) < ENOUGH:
        typer.echo(f"{few} polygons say little; by default a study has {Design.polygons}")
    typer.echo(f"study: {run.path}\nto look at: {run.path}/report.html")
    require_all(run)
