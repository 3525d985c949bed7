"""`harness study`: validate criteria, gains of the choice, the Pareto front, all on your data."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness import atomic
from harness.commands import options
from harness.commands.run import run
from harness.errors import Inconclusive, NothingMeasured, UsageError
from harness.progress import Reporter, Screen
from harness.settings import StudySize, TimingSettings

if TYPE_CHECKING:
    import pandas as pd

    from harness.measuring.run import Part
    from harness.results.run_folder import Run
    from scenes import Scene


COUNTED_ON_THE_CPU = ("reference", "binning")
"""Rasterisers whose counters are the exact predictions."""

QUICK = StudySize(polygons=6, random=10, most_vertices=60)
QUICK_S = 0.02
"""Seconds of drawing each triangulation, and of its first draws."""


def validate(
    scene: options.SceneName = "city",
    rasterisers: options.Rasterisers = None,
    device: options.Devices = None,
    resolution: options.Resolutions = options.Several((128,)),
    work: options.Works = options.Several((0, 8)),
    polygons: Annotated[int, typer.Option(min=1, help="Polygons to study.")] = StudySize.polygons,
    random: Annotated[
        int, typer.Option(min=0, help="Random triangulations of each polygon.")
    ] = StudySize.random,
    seed: options.Seed = 0,
    budget: options.Budget = 0.1,
    out: options.StudyFolder = None,
    resume: options.Resume = None,
    force: options.Force = False,
    quick: options.Quick = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Say how well each criterion predicts the measured cost, within single polygons.

    Each polygon is drawn with many triangulations, named and random ones. A criterion is good if it
    ranks the triangulations of one polygon as the measured cost does, and if the one that it calls
    best costs little more than the best there is: its regret.
    """
    from harness.commands.running import measure_study
    from harness.frame import View
    from harness.measuring.plan import Plan
    from harness.measuring.run import Part
    from harness.rasterisers.base import Options
    from harness.report.page import write_report
    from harness.study import correlations, regret
    from harness.study.subjects import choose_polygons, choose_triangulators
    from harness.triangulating.recipes import parse_all

    design = QUICK if quick else StudySize(polygons=polygons, random=random)
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
    correlations.print_matrix(ranked, Screen())
    regret.print_regret(lost, Screen())
    _end(run)


def _end(run: Run) -> None:
    """Say what disturbed the times of a study, and where it is."""
    from harness.commands.running import require_all
    from harness.stats.run_quality import state_of

    for line in state_of(run.facts, run.records).words:
        typer.echo(line)
    typer.echo(f"study: {run.path}\nto look at: {run.path}/report.html")
    require_all(run)


BASES = ("ear-clipping", "delaunay", "optimal:half-perimeter", "optimal:calibrated")
"""Default bases of the ratios: what programs use today, and the best that the harness knows."""

MOST_SAID = 12
"""How many views in which another was faster are named; gains.csv has them all."""


def gains(
    runs: Annotated[list[Path], typer.Argument(help="Run folders.")],
    out: Annotated[Path, typer.Option(help="Folder for gains.csv and plots.")],
    bases: Annotated[
        options.Several,
        typer.Option(
            parser=options.several(), metavar="NAME,...", help="Triangulators to compare with."
        ),
    ] = options.Several(BASES),
) -> None:
    """Compare each triangulator's time with the bases', in all views; say which one was faster."""
    import pandas as pd

    from harness.metrics import groups
    from harness.results.run_folder import read_run
    from harness.stats.run_quality import state_of
    from harness.study.gains import best, by_order, gain_table, plot
    from harness.triangulating.recipes import parse_all

    wanted = [str(recipe) for recipe in parse_all(bases)]
    read = [read_run(path) for path in runs]
    table = gain_table([run.records for run in groups.by_processor(read)], wanted)
    disturbed = [line for run in read for line in state_of(run.facts, run.records).words]
    if table.empty:
        if disturbed:
            raise Inconclusive(disturbed[0])
        raise NothingMeasured("no two triangulators were timed together on the same polygons")
    orders = [p for n in wanted if len(p := by_order(table, n).assign(base=n))]
    with atomic.folder(out, added=True) as made:
        files = plot(table, made / "plots")
        table.to_csv(made / "gains.csv", index=False, float_format="%.5g")
        if orders:
            pd.concat(orders).to_csv(made / "orders.csv", index=False, float_format="%.4g")
    if mixed := groups.several_processors(read):
        typer.echo(f"several processors, whose times stay apart: {groups.processor_words(mixed)}")
    for line in disturbed:
        typer.echo(f"left out: {line}")
    for name in wanted:
        _say_how_it_did(best(table, name), name)
    typer.echo(f"{len(table)} ratios in {out}/gains.csv, {len(files)} plots")


def _say_how_it_did(views: pd.DataFrame, name: str) -> None:
    """Say in how many views another triangulator was shown to be faster than `name`."""
    if views.empty:
        return
    from harness.metrics.groups import condition

    beaten = views[views["faster"] != ""]
    kept = len(views) - len(beaten)
    typer.echo(f"{name}: no other was shown to be faster in {kept} of {len(views)} views")
    for row in beaten.head(MOST_SAID).to_dict("records"):
        where = f"{row['scene']} {condition(row)}, {row['rasteriser']} on {row['device']}"
        typer.echo(f"  {where}: {row['faster']} faster")
    if len(beaten) > MOST_SAID:
        typer.echo(f"  and {len(beaten) - MOST_SAID} more views")


def pareto(
    scene: options.SceneName = "paper",
    polygons: Annotated[
        int, typer.Option(min=0, help="Polygons whose whole front is found and measured.")
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
    """Measure the Pareto front of the paper's A and D, and the sweep of their weights.

    A is the bounding-box overdraw, D the deviation of angles from 60 degrees. The front has all
    triangulations of a polygon that no other beats in both.
    """
    import pandas as pd

    from harness.commands.running import measure_study
    from harness.frame import View
    from harness.measuring.plan import Plan
    from harness.report.page import write_report
    from harness.study import pareto as fronts_of
    from harness.triangulating.recipes import parse_all
    from scenes.spec import label

    view = View(resolution)
    plan = Plan(
        scene=scene,
        seed=seed,
        triangulators=parse_all((*fronts_of.SWEEP, fronts_of.WITH_C, *fronts_of.named())),
        rasterisers=options.named_rasterisers(rasterisers, "bounding-box"),
        devices=tuple(device or ()),
        views=(view,),
        timing=TimingSettings(precision=0.005, budget_s=budget, warm_up_s=0.05),
    )
    reporter = Reporter(quiet=quiet, verbose=verbose)
    fronts: dict[str, pd.DataFrame] = {}

    def take_apart(label: str, whole: Scene) -> list[Part]:
        parts, found = fronts_of.take_apart(label, whole, polygons, view)
        fronts.update(found)
        return parts

    run = measure_study(plan, take_apart, "pareto", reporter, out=out, resume=resume, force=force)
    table = fronts_of.pareto_table(run, fronts)
    with reporter.stage("writing", 1):
        with atomic.folder(run.path, added=True) as made:
            points = pd.concat([pd.DataFrame(columns=fronts_of.FRONTS), *fronts.values()])
            points.to_csv(made / "fronts.csv", index=False)
            table.to_csv(made / "pareto.csv", index=False, float_format="%.9g")
        write_report(run)
    fronts_of.print_table(table, label(scene), Screen(highlight=False))
    _end(run)


ANGLES = options.Several((0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0))


def study(
    scenes: Annotated[list[str], typer.Argument(help="Scenes or files of polygons.")],
    out: Annotated[Path, typer.Option(help="Folder for the studies and findings.md.")],
    device: options.Devices = None,
    rasterisers: options.Rasterisers = None,
    resolution: options.Resolutions = options.Several((256, 1024)),
    polygons: Annotated[
        int, typer.Option(min=1, help="Polygons to validate with.")
    ] = StudySize.polygons,
    seed: options.Seed = 0,
    quick: options.Quick = False,
    quiet: options.Quiet = False,
) -> None:
    """Say which of our findings hold on your data: validation, gains, regret and rotation, bundled.

    Each study is a folder of its own in the output folder, with its report; findings.md sets what
    was found beside what we found. A study that is there already is not measured again. The exit
    code is 5 where cases failed or times were disturbed, and 4 where nothing could be judged.
    """
    from harness.results.run_folder import file_stem
    from harness.study import replication
    from scenes.spec import label

    console = Screen(quiet=quiet)
    names = [file_stem(Path(label(scene)).stem) for scene in scenes]
    if len(set(names)) < len(names):
        raise UsageError(f"two data sets would share a folder: {', '.join(names)}; rename one")
    drawn_on = options.Several(options.named_rasterisers(rasterisers, "bounding-box"))
    shared: dict[str, Any] = {
        "rasterisers": drawn_on,
        "device": device,
        "seed": seed,
        "quick": quick,
        "quiet": True,
    }
    shots = {**shared, "triangulators": options.Several(replication.CHOICE), "cached": True}
    turned = {**shots, "triangulators": options.Several(replication.ONCE), "fit": "circle"}
    largest = options.Several((max(resolution),))
    every = {"resolution": resolution}
    bases = (replication.USUAL, replication.DELAUNAY)
    once = (f"{replication.USUAL}{replication.TURNED}",)
    idle = options.Several((0,))
    walk = {"resolution": largest, "order": options.Several(("walk",))}
    # A command with its options, and the bases of its gains, by the name of its folder.
    parts: dict[str, tuple[Callable[..., None], dict[str, Any], tuple[str, ...]]] = {
        "validate": (validate, {**shared, **every, "polygons": polygons, "work": idle}, ()),
        "choice": (run, {**shots, **every}, bases),
        "walked": (run, {**shots, **walk}, bases),
        "turned": (run, {**turned, "resolution": largest, "rotation": ANGLES}, once),
    }
    found = []
    failed = 0
    refused: list[UsageError] = []
    for scene, name in zip(scenes, names, strict=True):
        folder = out / name
        console.print(f"{scene}:", markup=False)
        for part, what in parts.items():
            console.print(f"  {part} ...", markup=False)
            try:
                _carry_out(scene, folder / part, *what)
            except (UsageError, NothingMeasured, Inconclusive) as error:
                # What one study cannot do, the others may.
                failed += isinstance(error, Inconclusive)
                refused += [error] if isinstance(error, UsageError) else []
                console.print(f"  {part}: {error}", markup=False, soft_wrap=True)
        found.append((name, replication.read(folder)))
    if len(refused) == len(scenes) * len(parts):
        raise refused[-1]
    where = f"Rasterisers: {drawn_on}; device: {device or 'the best one here'}."
    file = out / "findings.md"
    out.mkdir(parents=True, exist_ok=True)
    atomic.write(file, replication.page(found, where).encode())
    figures = 0
    for name, evidence in found:
        judged = [figure for _, figure in replication.judge(evidence) if figure is not None]
        figures += len(judged)
        told = [figure for figure in judged if not figure.few]
        console.print(
            f"{name}: {sum(figure.holds for figure in told)} of {len(told)} findings hold",
            markup=False,
        )
    console.print(f"to read: {file}", markup=False, soft_wrap=True)
    if not figures:
        raise NothingMeasured("no finding could be judged: no part of the study has its figures")
    if failed:
        number = len(scenes) * len(parts)
        raise Inconclusive(f"{failed} of {number} parts of the study are not whole")


def _carry_out(
    scene: str,
    folder: Path,
    command: Callable[..., None],
    given: dict[str, Any],
    bases: tuple[str, ...],
) -> None:
    """Measure one part, or go on with it, and its gains, if it has bases."""
    begun = (folder / "run.json").is_file()
    where: dict[str, Any] = {"resume": folder} if begun else {"out": folder}
    with contextlib.redirect_stdout(io.StringIO()):  # its tables are in its report
        failed = None
        try:
            command(scene=scene, **where, **given)
        except Inconclusive as error:  # the cases that did not fail are there
            failed = error
        if bases:
            gains([folder], out=folder, bases=options.Several(bases))
        if failed is not None:
            raise failed
