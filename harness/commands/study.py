"""`harness study all`: do our findings hold on other data?"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.console import Console

from harness.commands import options
from harness.commands.gains import gains
from harness.commands.run import run
from harness.commands.validate import validate
from harness.errors import Inconclusive, NothingMeasured, UsageError
from harness.study.subjects import Design

ANGLES = options.Several((0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0))


class _Part(NamedTuple):
    """One measurement of each data set: a command with its options, and bases of its gains."""

    name: str
    command: Callable[..., None]
    options: dict[str, Any]
    bases: tuple[str, ...] = ()


def study(
    scenes: Annotated[list[str], typer.Argument(help="Scenes or files of polygons.")],
    out: Annotated[Path, typer.Option(help="Folder for the studies and findings.md.")],
    device: options.Devices = None,
    rasterisers: options.Rasterisers = None,
    resolution: options.Resolutions = options.Several((256, 1024)),
    polygons: Annotated[
        int, typer.Option(min=1, help="Polygons to validate with.")
    ] = Design.polygons,
    seed: options.Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Few polygons, short times: a look, not a result.")
    ] = False,
    quiet: options.Quiet = False,
) -> None:
    """Say which of our findings hold on your data: validation, gains, regret and rotation, bundled.

    Each study is a folder of its own in the output folder, with its report; findings.md sets what
    was found beside what we found. A study that is there already is not measured again. The exit
    code is 5 where cases failed, and 4 where nothing could be judged.
    """
    from harness.stored import atomic
    from harness.stored.folder import file_stem
    from harness.study import replication
    from scenes.spec import label

    console = Console(quiet=quiet)
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
    parts = (
        _Part("validate", validate, {**shared, **every, "polygons": polygons, "work": idle}),
        _Part("choice", run, {**shots, **every}, bases),
        _Part(
            "walked",
            run,
            {**shots, "resolution": largest, "order": options.Several(("walk",))},
            bases,
        ),
        _Part("turned", run, {**turned, "resolution": largest, "rotation": ANGLES}, once),
    )
    found = []
    failed = 0
    refused: list[UsageError] = []
    for scene, name in zip(scenes, names, strict=True):
        folder = out / name
        console.print(f"{scene}:", markup=False)
        for part in parts:
            console.print(f"  {part.name} ...", markup=False)
            try:
                _carry_out(scene, folder / part.name, part)
            except (UsageError, NothingMeasured, Inconclusive) as error:
                # What one study cannot do, the others may.
                failed += isinstance(error, Inconclusive)
                refused += [error] if isinstance(error, UsageError) else []
                console.print(f"  {part.name}: {error}", markup=False, soft_wrap=True)
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
        raise Inconclusive(f"in {failed} of {number} parts of the study cases failed")


def _carry_out(scene: str, folder: Path, part: _Part) -> None:
    """Measure one part, or go on with it, and its gains, if it has bases."""
    begun = (folder / "run.json").is_file()
    where: dict[str, Any] = {"resume": folder} if begun else {"out": folder}
    with contextlib.redirect_stdout(io.StringIO()):  # its tables are in its report
        failed = None
        try:
            part.command(scene=scene, **where, **part.options)
        except Inconclusive as error:  # the cases that did not fail are there
            failed = error
        if part.bases:
            gains([folder], out=folder, bases=options.Several(part.bases))
        if failed is not None:
            raise failed
