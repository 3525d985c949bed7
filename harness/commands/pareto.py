"""`harness pareto`: triangulations between the least A and the least D; which are faster."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from harness.commands.options import (
    Budget,
    Devices,
    Force,
    Quiet,
    Rasterisers,
    Resolution,
    Resume,
    SceneName,
    Seed,
    Verbose,
    named_rasterisers,
)
from harness.progress import Reporter

if TYPE_CHECKING:
    from harness.measuring.run import Part
    from scenes import Scene

POLYGONS = 6

BUDGET_S = 0.4


def pareto(
    scene: SceneName = "paper",
    polygons: Annotated[
        int, typer.Option(min=0, help="Polygons whose whole front is found and measured.")
    ] = POLYGONS,
    rasterisers: Rasterisers = None,
    device: Devices = None,
    resolution: Resolution = 512,
    seed: Seed = 0,
    budget: Budget = BUDGET_S,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the study; results/pareto-<scene>-<time> if absent."),
    ] = None,
    resume: Resume = None,
    force: Force = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Measure the Pareto front of the paper's A and D, and the sweep of their weights.

    A is the bounding-box overdraw, D the deviation of angles from 60 degrees. The front has all
    triangulations of a polygon that no other beats in both.
    """
    from harness.commands.results import folder_for, require_finished
    from harness.frame import View
    from harness.measuring.plan import Plan
    from harness.measuring.run import run as carry_out
    from harness.measuring.settings import TimingSettings
    from harness.report import write_report
    from harness.stored.folder import read_run
    from harness.study import pareto as study
    from harness.study import pareto_answer, pareto_plot
    from harness.triangulating.recipes import parse_all
    from scenes.spec import label

    view = View(resolution)
    plan = Plan(
        scene=scene,
        seed=seed,
        triangulators=parse_all((*study.SWEEP, study.WITH_C, *study.named())),
        rasterisers=named_rasterisers(rasterisers, "bounding-box"),
        devices=tuple(device or ()),
        views=(view,),
        timing=TimingSettings(precision=0.005, budget_s=budget, warm_up_s=0.05),
    )
    folder = folder_for(scene, out, resume, before="pareto-")
    reporter = Reporter(quiet=quiet, verbose=verbose)
    fronts: dict[str, study.MeasuredFront] = {}

    def take_apart(label: str, whole: Scene) -> list[Part]:
        parts, found = study.take_apart(label, whole, polygons, view)
        fronts.update(found)
        return parts

    outcome = carry_out(
        plan, folder, reporter, resume=resume is not None, force=force, split=take_apart
    )
    console = Console(highlight=False)
    require_finished(outcome, console, f"continue with the same command and --resume {folder}")
    run = read_run(folder)
    table = study.pareto_table(run, fronts)
    with reporter.stage("plotting", 1):
        study.front_table(fronts).to_csv(folder / "fronts.csv", index=False)
        table.to_csv(folder / "pareto.csv", index=False, float_format="%.9g")
        pareto_plot.plot(table, fronts, Path(label(scene)).stem, folder / "plots")
        write_report(run)
    pareto_answer.print_table(table, label(scene), console)
    for line in (*pareto_answer.sentences(table), *pareto_answer.remarks(run.records, fronts)):
        console.print(line, markup=False, soft_wrap=True)
    console.print(f"study: {folder}", markup=False, soft_wrap=True)
