"""`harness study validate`: how well each criterion predicts the measured cost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness import atomic
from harness.commands import options
from harness.progress import Reporter, Screen
from harness.settings import StudySize, TimingSettings

if TYPE_CHECKING:
    import pandas as pd

    from harness.measuring.plan import Plan
    from harness.measuring.run import ScenePart
    from harness.results.run_folder import Run
    from scenes import Scene

EXACT_RASTERISERS = ("reference", "binning")  # their counters predict other devices' costs

QUICK = StudySize(polygons=6, random=10, max_vertices=60)
BUDGET_S = 0.1
QUICK_S = 0.02  # per triangulation, with --quick; also the maximum warm-up of any validation


def study_validate(
    context: typer.Context,
    scene: options.SceneName = "city",
    rasterisers: options.Rasterisers = None,
    device: options.Devices = None,
    resolution: options.Resolutions = options.ValueList((128,)),
    work: options.Works = options.ValueList((0, 8)),
    polygons: Annotated[int, typer.Option(min=1, help="Number of polygons.")] = StudySize.polygons,
    random: Annotated[
        int, typer.Option(min=0, help="Number of random triangulations of each polygon.")
    ] = StudySize.random,
    seed: options.Seed = 0,
    budget: options.Budget = BUDGET_S,
    out: options.StudyFolder = None,
    resume: options.Resume = None,
    force: options.Force = False,
    quick: options.Quick = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Report how well each criterion predicts the measured cost, within single polygons.

    Each polygon is drawn with many triangulations: those of triangulators, and random ones. A
    criterion is good if it ranks the triangulations of a polygon as the measured cost does, and if
    the triangulation that it prefers costs little more than the cheapest one measured (regret).
    """
    from harness.commands.runs import choose_folder, finish_study
    from harness.report import matrix
    from harness.study import correlations, regret

    sizes = {"polygons": polygons, "random": random}
    given = {name: size for name, size in sizes.items() if options.is_given(context, name)}
    validation = measure_validation(
        plan_validation(
            scene,
            options.choose_rasterisers(rasterisers, "bounding-box"),
            tuple(device or ()),
            resolution=resolution,
            work=work,
            seed=seed,
            budget_s=QUICK_S if quick and not options.is_given(context, "budget") else budget,
        ),
        replace(QUICK if quick else StudySize(), **given),
        choose_folder(scene, out, resume, before="validate-"),
        Reporter(quiet=quiet, verbose=verbose),
        resume=resume is not None,
        force=force,
    )
    correlations.print_matrix(validation.ranks, Screen())
    regret.print_regret(validation.regrets, Screen())
    if conclusion := matrix.format_best_criterion_of_study(
        matrix.read_study_matrices(validation.run.folder)
    ):
        Screen().print(conclusion, markup=False, soft_wrap=True)
    finish_study(validation.run)


@dataclass(frozen=True)
class Validation:
    """The run of a validation study, with its tables of rank correlations and of regret."""

    run: Run
    ranks: pd.DataFrame
    regrets: pd.DataFrame


def plan_validation(
    scene: str,
    rasterisers: tuple[str, ...],
    devices: tuple[str, ...],
    *,
    resolution: tuple[int, ...],
    work: tuple[int, ...],
    seed: int,
    budget_s: float,
) -> Plan:
    """Return the plan of a validation; `EXACT_RASTERISERS` are added to the rasterisers."""
    from harness.frame import View
    from harness.measuring.plan import Plan
    from harness.rasterisers.base import Options
    from harness.triangulating.recipes import parse_all

    return Plan(
        scene=scene,
        seed=seed,
        triangulators=parse_all(["optimal"]),  # replaced for each polygon, see measure_validation
        rasterisers=tuple(dict.fromkeys([*rasterisers, *EXACT_RASTERISERS])),
        devices=devices,
        views=tuple(View(size) for size in resolution),
        # The same order for all triangulations, so that only their diagonals differ.
        options=tuple(Options(work=count, order="walk") for count in work),
        timing=TimingSettings(0.01, budget_s=budget_s, warm_up_s=QUICK_S),
    )


def measure_validation(
    plan: Plan,
    size: StudySize,
    target: Path,
    reporter: Reporter,
    *,
    resume: bool,
    force: bool = False,
) -> Validation:
    """Measure many triangulations of single polygons; write tables, plots and the report."""
    from harness.commands.runs import measure_study
    from harness.measuring.run import ScenePart
    from harness.report.page import write_report
    from harness.study import correlations, regret
    from harness.study.subjects import choose_polygons, choose_triangulators

    def split_scene(label: str, full_scene: Scene) -> list[ScenePart]:
        return [
            ScenePart(f"{label}#{number}", part, choose_triangulators(size, part.polygons[0]))
            for number, part in choose_polygons(full_scene, size)
        ]

    run = measure_study(plan, split_scene, target, reporter, resume=resume, force=force)
    with reporter.stage("correlating", 1):
        table = correlations.make_measure_table(run.records)
        with atomic.create_folder(run.path, merge=True) as folder:
            ranks = correlations.write_correlations(table, folder)
            correlations.plot_study(ranks, table, folder)
            regrets = regret.write_regret(run.records, folder)
            regret.write_paper_table(ranks, regrets, folder)
        write_report(run)
    return Validation(run, ranks, regrets)
