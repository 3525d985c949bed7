"""`harness study all`: check which of our findings hold on the user's data."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from harness import atomic
from harness.commands import options, run, study_gains, study_validate
from harness.errors import (
    HarnessError,
    IncompatibleRunsError,
    InconclusiveError,
    InputError,
    NothingMeasuredError,
    StorageError,
    UsageError,
)
from harness.progress import Reporter, Screen
from harness.settings import QUICK_TIMEOUT_S, TIMEOUT_S, Fit, Order, StudySize, TimingSettings

ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)  # rotations of the scene in degrees

REFUSALS = (IncompatibleRunsError, InputError, StorageError, UsageError)  # end only one part


def study_all(
    context: typer.Context,
    scenes: Annotated[list[str], typer.Argument(help="Scenes or files of polygons.")],
    out: Annotated[Path, typer.Option(help="Folder for the studies and findings.md.")],
    device: options.Devices = None,
    rasterisers: options.Rasterisers = None,
    resolution: options.Resolutions = options.ValueList((256, 1024)),
    polygons: Annotated[
        int, typer.Option(min=1, help="Number of polygons on which criteria are validated.")
    ] = StudySize.polygons,
    seed: options.Seed = 0,
    quick: options.Quick = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Report which of our findings hold on your data: validation, gains, regret and rotation.

    Each study has a folder in the output folder, with a report; findings.md compares the results
    with ours. A finished study is not measured again. The exit code is 5 if cases failed or times
    were disturbed, and 4 if no finding could be evaluated.
    """
    from harness.results.run_folder import make_file_stem
    from harness.study import replication
    from scenes.spec import format_label

    console = Screen(quiet=quiet)
    names = [make_file_stem(Path(format_label(scene)).stem) for scene in scenes]
    if len(set(names)) < len(names):
        raise UsageError(f"two data sets would share a folder: {', '.join(names)}; rename one")
    size = study_validate.QUICK if quick else StudySize()
    settings = _Settings(
        rasterisers=options.choose_rasterisers(rasterisers, "bounding-box"),
        devices=tuple(device or ()),
        resolution=resolution,
        size=replace(size, polygons=polygons) if options.is_given(context, "polygons") else size,
        seed=seed,
        quick=quick,
        verbose=verbose,
    )
    evidence_of = {}
    parts = 0
    incomplete: list[str] = []
    refusals: list[HarnessError] = []
    for scene, name in zip(scenes, names, strict=True):
        console.print(f"{scene}:", markup=False)
        for part, measure in _list_parts(scene, out / name, settings):
            console.print(f"  {part} ...", markup=False)
            parts += 1
            try:
                measure()
            except (*REFUSALS, NothingMeasuredError, InconclusiveError) as error:
                # One part fails; the others may succeed.
                incomplete += [f"{name}/{part}"] * isinstance(error, InconclusiveError)
                refusals += [error] if isinstance(error, REFUSALS) else []
                console.print(f"  {part}: {error}", markup=False, soft_wrap=True)
        evidence_of[name] = replication.read_evidence(out / name)
    if len(refusals) == parts:
        raise refusals[-1]
    file = out / "findings.md"
    out.mkdir(parents=True, exist_ok=True)
    conditions = (
        f"Rasterisers: {','.join(settings.rasterisers)}; device: {device or 'the best one here'}."
    )
    atomic.write(file, replication.format_page([*evidence_of.items()], conditions).encode())
    evaluated = 0
    for name, evidence in evidence_of.items():
        figures = [
            figure for _, figure in replication.evaluate_claims(evidence) if figure is not None
        ]
        evaluated += len(figures)
        decided = [figure for figure in figures if not figure.too_few]
        holds = sum(figure.holds for figure in decided)
        console.print(f"{name}: {holds} of {len(decided)} findings hold", markup=False)
    console.print(f"report: {file}", markup=False, soft_wrap=True)
    if not evaluated:
        raise NothingMeasuredError(
            "no finding could be evaluated: no part of the study has the necessary metrics"
        )
    if incomplete:
        raise InconclusiveError(
            f"{len(incomplete)} of {parts} parts of the study are incomplete, with the reasons in "
            f"their reports in {out}: {', '.join(incomplete)}"
        )


@dataclass(frozen=True)
class _Settings:
    rasterisers: tuple[str, ...]
    devices: tuple[str, ...]
    resolution: tuple[int, ...]
    size: StudySize  # of the validation
    seed: int
    quick: bool
    verbose: bool


def _list_parts(
    scene: str, folder: Path, settings: _Settings
) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield (folder name, measuring function) of each part of the study of a scene."""
    from harness.study.replication import (
        DELAUNAY,
        EAR_CLIPPING,
        ROTATED_TRIANGULATORS,
        TIMED_TRIANGULATORS,
        UPRIGHT_SUFFIX,
    )

    bases = [EAR_CLIPPING, DELAUNAY]
    largest = replace(settings, resolution=(max(settings.resolution),))
    turned_bases = [f"{EAR_CLIPPING}{UPRIGHT_SUFFIX}"]
    yield "validate", partial(_measure_validation, scene, folder / "validate", settings)
    yield (
        "choice",
        partial(_measure_gains, scene, folder / "choice", settings, TIMED_TRIANGULATORS, bases),
    )
    measure_walked = partial(
        _measure_gains, scene, folder / "walked", largest, TIMED_TRIANGULATORS, bases
    )
    yield "walked", partial(measure_walked, order="walk")
    measure_turned = partial(
        _measure_gains, scene, folder / "turned", largest, ROTATED_TRIANGULATORS, turned_bases
    )
    yield "turned", partial(measure_turned, turned=True)


def _measure_validation(scene: str, folder: Path, settings: _Settings) -> None:
    from harness.commands.runs import raise_if_cases_failed

    plan = study_validate.plan_validation(
        scene,
        settings.rasterisers,
        settings.devices,
        resolution=settings.resolution,
        work=(0,),
        seed=settings.seed,
        budget_s=study_validate.QUICK_S if settings.quick else study_validate.BUDGET_S,
    )
    reporter = Reporter(quiet=True, verbose=settings.verbose)
    validation = study_validate.measure_validation(
        plan, settings.size, folder, reporter, resume=(folder / "run.json").is_file()
    )
    raise_if_cases_failed(validation.run)


def _measure_gains(
    scene: str,
    folder: Path,
    settings: _Settings,
    triangulators: tuple[str, ...],
    bases: list[str],
    *,
    order: Order = "native",
    turned: bool = False,
) -> None:
    """Measure or resume a run, at all `ANGLES` if `turned`; write the gains of complete cases."""
    from harness.commands import runs
    from harness.frame import View
    from harness.machine.system import get_database_path
    from harness.measuring.plan import Plan
    from harness.measuring.run import RunOptions
    from harness.measuring.run import run as carry_out
    from harness.rasterisers.base import Options
    from harness.results.run_folder import read_run
    from harness.triangulating.recipes import parse_all

    fit: Fit = "circle" if turned else "box"
    angles = ANGLES if turned else (0.0,)
    plan = Plan(
        scene=scene,
        seed=settings.seed,
        triangulators=parse_all(triangulators, seed=settings.seed),
        rasterisers=settings.rasterisers,
        devices=settings.devices,
        views=tuple(View(size, angle, fit) for size in settings.resolution for angle in angles),
        options=(Options(order=order, seed=settings.seed),),
        timing=run.QUICK if settings.quick else TimingSettings(),
        timeout_s=QUICK_TIMEOUT_S if settings.quick else TIMEOUT_S,
    )
    run_options = RunOptions((folder / "run.json").is_file(), database=get_database_path())
    reporter = Reporter(quiet=True, verbose=settings.verbose)
    result = carry_out(plan, folder, reporter, run_options)
    incomplete = None
    try:
        runs.finish_run(result, Screen(quiet=True), reporter, plots=not settings.quick)
    except InconclusiveError as error:
        incomplete = error
    study_gains.write_gains([read_run(folder)], bases, folder)
    if incomplete is not None:
        raise incomplete
