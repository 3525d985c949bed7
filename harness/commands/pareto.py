"""`harness study pareto`: triangulations between the least A and the least D; which are faster."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from harness.commands import options
from harness.progress import Reporter

if TYPE_CHECKING:
    from harness.measuring.run import Part
    from scenes import Scene

POLYGONS = 6

BUDGET_S = 0.4


def pareto(
    scene: options.SceneName = "paper",
    polygons: Annotated[
        int, typer.Option(min=0, help="Polygons whose whole front is found and measured.")
    ] = POLYGONS,
    rasterisers: options.Rasterisers = None,
    device: options.Devices = None,
    resolution: options.Resolution = 512,
    seed: options.Seed = 0,
    budget: options.Budget = BUDGET_S,
    out: Annotated[Path | None, options.study_folder("pareto")] = None,
    resume: options.Resume = None,
    force: options.Force = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Measure the Pareto front of the paper's A and D, and the sweep of their weights.

    A is the bounding-box overdraw, D the deviation of angles from 60 degrees. The front has all
    triangulations of a polygon that no other beats in both.
    """
    from harness.commands.running import measure_study, require_all
    from harness.frame import View
    from harness.measuring.plan import Plan
    from harness.report import write_report
    from harness.settings import TimingSettings
    from harness.stored import atomic
    from harness.study import pareto as study
    from harness.triangulating.recipes import parse_all
    from scenes.spec import label

    view = View(resolution)
    plan = Plan(
        scene=scene,
        seed=seed,
        triangulators=parse_all((*study.SWEEP, study.WITH_C, *study.named())),
        rasterisers=options.named_rasterisers(rasterisers, "bounding-box"),
        devices=tuple(device or ()),
        views=(view,),
        timing=TimingSettings(precision=0.005, budget_s=budget, warm_up_s=0.05),
    )
    reporter = Reporter(quiet=quiet, verbose=verbose)
    fronts: dict[str, study.MeasuredFront] = {}

    def take_apart(label: str, whole: Scene) -> list[Part]:
        parts, found = study.take_apart(label, whole, polygons, view)
        fronts.update(found)
        return parts

    run = measure_study(plan, take_apart, "pareto", reporter, out=out, resume=resume, force=force)
    folder = run.path
    table = study.pareto_table(run, fronts)
    with reporter.stage("plotting", 1):
        with atomic.folder(folder, added=True) as made:
            study.front_table(fronts).to_csv(made / "fronts.csv", index=False)
            table.to_csv(made / "pareto.csv", index=False, float_format="%.9g")
            study.plot(table, fronts, Path(label(scene)).stem, made / "plots")
        write_report(run)
    study.print_table(table, label(scene), Console(highlight=False))
    typer.echo(f"study: {folder}")
    require_all(run)
