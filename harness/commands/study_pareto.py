"""`harness study pareto`: the Pareto front of overdraw and triangle shape."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from harness import atomic
from harness.commands import options
from harness.progress import Reporter, Screen
from harness.settings import TimingSettings

if TYPE_CHECKING:
    import pandas as pd

    from harness.measuring.run import ScenePart
    from scenes import Scene


def study_pareto(
    scene: options.SceneName = "paper",
    polygons: Annotated[
        int,
        typer.Option(
            min=0, help="Number of single polygons, each measured with its full Pareto front."
        ),
    ] = 6,
    rasterisers: options.Rasterisers = None,
    device: options.Devices = None,
    resolution: options.Resolution = 512,
    seed: options.Seed = 0,
    budget: options.Budget = 0.4,
    out: options.StudyFolder = None,
    resume: options.Resume = None,
    force: options.Force = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Measure the Pareto front of the paper's A and D, and the optima for a sweep of weights.

    A is the bounding-box waste (overdraw), D the deviation of angles from 60 degrees. The front has
    the triangulations of a polygon in which neither can be reduced without increasing the other.
    """
    import pandas as pd

    from harness.commands.runs import choose_folder, finish_study, measure_study
    from harness.frame import View
    from harness.measuring.plan import Plan
    from harness.report.page import write_report
    from harness.study import pareto
    from harness.triangulating.recipes import parse_all
    from scenes.spec import format_label

    view = View(resolution)
    plan = Plan(
        scene=scene,
        seed=seed,
        triangulators=parse_all((*pareto.SWEEP, pareto.WITH_C, *pareto.list_compared())),
        rasterisers=options.choose_rasterisers(rasterisers, "bounding-box"),
        devices=tuple(device or ()),
        views=(view,),
        timing=TimingSettings(precision=0.005, budget_s=budget, warm_up_s=0.05),
    )
    reporter = Reporter(quiet=quiet, verbose=verbose)
    fronts: dict[str, pd.DataFrame] = {}

    def split_scene(label: str, full_scene: Scene) -> list[ScenePart]:
        parts, part_fronts = pareto.make_parts(label, full_scene, polygons, view)
        fronts.update(part_fronts)
        return parts

    target = choose_folder(scene, out, resume, before="pareto-")
    run = measure_study(plan, split_scene, target, reporter, resume=resume is not None, force=force)
    table = pareto.make_pareto_table(run, fronts)
    with reporter.stage("writing", 1):
        with atomic.create_folder(run.path, merge=True) as folder:
            points = pd.concat([pd.DataFrame(columns=pareto.FRONTS), *fronts.values()])
            points.to_csv(folder / "fronts.csv", index=False)
            table.to_csv(folder / "pareto.csv", index=False, float_format="%.9g")
        write_report(run)
    pareto.print_pareto_table(table, format_label(scene), Screen(highlight=False))
    finish_study(run)
