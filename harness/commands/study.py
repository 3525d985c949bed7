"""`harness study`: do our findings hold on other data?"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from harness.commands.gains import gains
from harness.commands.options import Quiet, Seed
from harness.commands.run import run
from harness.commands.validate import validate
from harness.errors import NothingMeasured, UsageError
from harness.stored.folder import file_stem
from scenes.spec import label

ANGLES = "0,15,30,45,60,75,90"


def study(
    scenes: Annotated[list[str], typer.Argument(help="Scenes or files of polygons.")],
    out: Annotated[Path, typer.Option(help="Folder for the studies and findings.md.")],
    device: Annotated[str, typer.Option(help="Device of OpenGL; the best one by default.")] = "",
    rasterisers: Annotated[
        str, typer.Option(help="Comma-separated; see: harness list rasterisers.")
    ] = "opengl,bounding-box",
    resolution: Annotated[
        str, typer.Option(help="Viewports in pixels; comma-separated.")
    ] = "256,1024",
    polygons: Annotated[int, typer.Option(min=1, help="Polygons to validate with.")] = 24,
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Few polygons, short times: a look, not a result.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Say which of our findings hold on your data: validation, gains, regret and rotation, bundled.

    Each study is a folder of its own in the output folder, with its report; findings.md sets what
    was found beside what we found. A study that is there already is not measured again.
    """
    # Statistics take a second to import, which other commands need not wait for.
    from harness.study import replication

    console = Console(quiet=quiet)
    names = [file_stem(Path(label(scene)).stem) for scene in scenes]
    if len(set(names)) < len(names):
        raise UsageError(f"two data sets would share a folder: {', '.join(names)}; rename one")
    shared: dict[str, Any] = {
        "rasterisers": rasterisers,
        "device": device,
        "seed": seed,
        "quick": quick,
        "quiet": True,
    }
    shots = {**shared, "triangulators": ",".join(replication.CHOICE), "cached": True}
    turned = {**shots, "triangulators": ",".join(replication.ONCE), "fit": "circle"}
    largest = max(resolution.split(","), key=lambda size: int(size) if size.isdigit() else 0)
    found = []
    for scene, name in zip(scenes, names, strict=True):
        folder = out / name
        console.print(f"{scene}:", markup=False)
        parts: tuple[tuple[str, Callable[..., None], dict[str, Any], tuple[str, ...]], ...] = (
            (
                "validate",
                validate,
                {**shared, "resolution": resolution, "polygons": polygons, "work": "0"},
                (),
            ),
            ("choice", run, {**shots, "resolution": resolution}, ("ear-clipping", "delaunay")),
            (
                "walked",
                run,
                {**shots, "resolution": largest, "order": "walk"},
                ("ear-clipping", "delaunay"),
            ),
            (
                "turned",
                run,
                {**turned, "resolution": largest, "rotation": ANGLES},
                (f"ear-clipping{replication.TURNED}",),
            ),
        )
        for part, command, options, bases in parts:
            console.print(f"  {part} ...", markup=False)
            try:
                _carry_out(scene, folder / part, command, options, bases)
            except (UsageError, NothingMeasured) as error:
                # What one study cannot do, the others may.
                console.print(f"  {part}: {error}", markup=False, soft_wrap=True)
        found.append((name, replication.read(folder)))
    where = f"Rasterisers: {rasterisers}; device: {device or 'the best one here'}."
    file = out / "findings.md"
    out.mkdir(parents=True, exist_ok=True)
    file.write_text(replication.page(found, where), encoding="utf-8")
    for name, evidence in found:
        judged = [figure for _, figure in replication.judge(evidence)]
        told = [figure for figure in judged if figure is not None]
        console.print(
            f"{name}: {sum(figure.holds for figure in told)} of {len(told)} findings hold",
            markup=False,
        )
    console.print(f"to read: {file}", markup=False, soft_wrap=True)


def _carry_out(
    scene: str,
    folder: Path,
    command: Callable[..., None],
    options: dict[str, Any],
    bases: tuple[str, ...],
) -> None:
    """Measure one part, or go on with it, and its gains over `bases`, if any."""
    begun = (folder / "run.json").is_file()
    where: dict[str, Any] = {"resume": folder} if begun else {"out": folder}
    with contextlib.redirect_stdout(io.StringIO()):  # its tables are in its report
        command(scene=scene, **where, **options)
        if bases:
            gains([folder], out=folder, bases=",".join(bases))


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(study)
