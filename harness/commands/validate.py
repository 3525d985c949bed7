"""`harness validate`: does a criterion predict what was measured?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.commands.options import (
    Budget,
    Devices,
    Force,
    Quiet,
    Rasterisers,
    Resolutions,
    Resume,
    SceneName,
    Seed,
    Several,
    Verbose,
    Works,
    named_rasterisers,
)
from harness.progress import Reporter
from harness.study.design import Design

COUNTED_ON_THE_CPU = ("reference", "binning")
"""Rasterisers whose counters are the exact predictions."""

ENOUGH = 12
"""Polygons below which a study says that it is a look and no result."""

QUICK = Design(polygons=6, random=10, most_vertices=60)


def validate(
    scene: SceneName = "city",
    rasterisers: Rasterisers = None,
    device: Devices = None,
    resolution: Resolutions = Several((128,)),
    work: Works = Several((0, 8)),
    polygons: Annotated[int, typer.Option(min=1, help="Polygons to study.")] = Design.polygons,
    random: Annotated[
        int, typer.Option(min=0, help="Random triangulations of each polygon.")
    ] = Design.random,
    seed: Seed = 0,
    budget: Budget = 0.1,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the study; results/validate-<scene>-<time> if absent."),
    ] = None,
    resume: Resume = None,
    force: Force = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Six polygons, short times: a look, not a result.")
    ] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Say how well each criterion predicts the measured cost, within single polygons.

    Each polygon is drawn with many triangulations, named and random ones. A criterion is good if it
    ranks the triangulations of one polygon as the measured cost does, and if the one that it calls
    best costs little more than the best there is: its regret.
    """
    from harness.commands.results import folder_for, require_finished
    from harness.frame import View
    from harness.measuring.plan import Plan
    from harness.measuring.run import Part
    from harness.measuring.run import run as carry_out
    from harness.measuring.settings import TimingSettings
    from harness.rasterisers.base import Options
    from harness.report import write_report
    from harness.stored.folder import read_run
    from harness.study import analysis, extremes, matrix, regret
    from harness.study.subjects import choose_polygons, choose_triangulators
    from harness.triangulating.recipes import parse_all

    design = QUICK if quick else Design(polygons=polygons, random=random)
    named = dict.fromkeys([*named_rasterisers(rasterisers, "bounding-box"), *COUNTED_ON_THE_CPU])
    plan = Plan(
        scene=scene,
        seed=seed,
        triangulators=parse_all(["optimal"]),  # each polygon has its own, below
        rasterisers=tuple(named),
        devices=tuple(device or ()),
        views=tuple(View(size) for size in resolution),
        # In one kind of order, so that nothing but the diagonals differs.
        options=tuple(Options(work=count, order="walk") for count in work),
        timing=TimingSettings(precision=0.01, budget_s=0.02 if quick else budget, warm_up_s=0.02),
    )
    folder = folder_for(scene, out, resume, before="validate-")
    reporter = Reporter(quiet=quiet, verbose=verbose)
    outcome = carry_out(
        plan,
        folder,
        reporter,
        resume=resume is not None,
        force=force,
        split=lambda label, whole: [
            Part(f"{label}#{number}", part, choose_triangulators(design, part.polygons[0]))
            for number, part in choose_polygons(whole, design)
        ],
    )
    console = Console()
    require_finished(outcome, console, f"continue with the same command and --resume {folder}")
    with reporter.stage("correlating", 1):
        table = analysis.measure_table(outcome.records)
        correlations, sizes = analysis.write(table, folder)
        matrix.plot_study(correlations, table, folder)
        matrix.plot_sizes(sizes, folder)
        ends = extremes.extremes_table(outcome.records)
        ends.to_csv(folder / "extremes.csv", index=False, float_format="%.6g")
        lost = regret.write(outcome.records, folder)
        regret.plot_regret(lost, folder)
        if ends["scene"].nunique() == 1:
            extremes.plot_polygon(outcome.records, folder / "plots")
        write_report(read_run(folder))
    matrix.print_matrix(correlations, console)
    regret.print_regret(lost, console)
    extremes.print_claim(ends, "overdraw", console)
    few = table["polygon"].nunique()
    if few < ENOUGH:
        console.print(f"{few} polygons say little; by default a study has {Design.polygons}")
    console.print(f"study: {folder}", markup=False, soft_wrap=True)
    console.print(f"to look at: {folder}/report.html", markup=False, soft_wrap=True)
