"""`harness calibrate`: a model of what a device's draw time is made of."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from harness import rasterisers
from harness.commands.options import CALIBRATIONS, Quiet, Seed
from harness.errors import Inconclusive
from harness.measuring.loading import load_scene
from harness.measuring.processes import Backend, Bench
from harness.measuring.timing import TimingSettings
from harness.measuring.worker import Worker
from harness.progress import Reporter
from harness.rasterisers.base import Options


def calibrate(
    device: Annotated[
        str | None, typer.Option(help="Device that draws; the best one by default.")
    ] = None,
    rasteriser: Annotated[
        str, typer.Option(help="Rasteriser that draws; by default opengl, or webgpu without EGL.")
    ] = "",
    scene: Annotated[str, typer.Option(help="Scene or file whose polygons test the fit.")] = "city",
    resolution: Annotated[int, typer.Option(help="Viewport in pixels.")] = 256,
    work: Annotated[int, typer.Option(min=0, help="Iterations of arithmetic per fragment.")] = 0,
    budget: Annotated[float, typer.Option(help="Seconds of drawing per draw.")] = 0.2,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="File to write; results/calibration/<device>.json if absent."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Fit a model of a device's draw time, and test it on polygons that it has not seen.

    time = c0 + cT*T + cS*S + cH*H + cB*sum(w*h) + cD*D + cQ*Q + cP*P + cR*R. T is the number of
    triangles, S their area, H their half-perimeters, sum(w*h) the area of their bounding boxes, D
    their shape deviation, Q and P the expected quads and 4x4 blocks, and R the expected number of
    triangles with a pixel centre in their bounding box. optimal:calibrated minimises this time.
    """
    # Statistics take a second to import, which other commands need not wait for.
    from harness.study import calibrate as study
    from harness.study import calibration

    reporter = Reporter(quiet=quiet)
    name = rasteriser or rasterisers.usual()
    backend = Backend(name, rasterisers.find_device(name, device))
    loaded = load_scene(scene, seed, reporter)
    bench = Bench(Worker, timeout_s=600)
    try:
        fit, validation = study.calibrate(
            backend,
            bench,
            loaded,
            TimingSettings(
                precision=0.005, budget_s=budget, warm_up_s=0.05, min_batch_s=5e-3, paired=False
            ),
            Options(work=work, order="walk"),
            resolution,
            reporter,
            seed,
        )
        described = bench.describe()[backend.label]
    finally:
        bench.close()
    file = out or CALIBRATIONS / f"{backend.device.name}.json"
    facts = {
        "rasteriser": rasteriser,
        "name": backend.device.name,
        "resolution": resolution,
        "work": work,
        **described,
    }
    file = study.write(fit, validation, facts, file)
    table = Table(title=f"time of a draw: {backend.label}", title_justify="left", box=None)
    for heading in ("term", "coefficient", "95 % interval", "unit"):
        table.add_column(heading)
    for term, unit in zip(calibration.TERMS, calibration.UNITS, strict=True):
        low, high = fit.intervals[term]
        table.add_row(term, f"{fit.coefficients[term]:.3g}", f"{low:.3g} to {high:.3g}", unit)
    console = Console(highlight=False)
    console.print(table)
    console.print(str(validation))
    if not validation.good:
        raise Inconclusive(
            f"the fit is refused, for R2 below {study.LEAST_R2:g} would follow noise: close other "
            f"programs, or draw longer, e.g. --budget {4 * budget:g}; kept in {file}"
        )
    console.print(f"calibration: {file}", markup=False, soft_wrap=True)


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(calibrate)
