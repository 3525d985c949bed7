"""`harness calibrate`: a model of what a device's draw time is made of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from harness.commands import options
from harness.errors import Inconclusive
from harness.measuring.settings import TimingSettings
from harness.progress import Reporter

if TYPE_CHECKING:
    from harness.study.model_terms import Model


def calibrate(
    device: options.OneDevice = None,
    rasteriser: options.OneRasteriser = None,
    scene: Annotated[
        list[str] | None,
        typer.Option(
            help="Scene or file whose polygons test the fit; may be repeated. [city]",
        ),
    ] = None,
    resolution: options.Resolution = 256,
    terms: Annotated[
        options.Several | None,
        typer.Option(
            parser=options.several(),
            metavar="TERM,...",
            help="Terms that the model may have: T,S,H,w*h,D,Q,P,R, or some of them.",
        ),
    ] = None,
    work: options.Work = 0,
    budget: options.Budget = 0.2,
    seed: options.Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="File to write; results/calibration/<device>.json if absent."),
    ] = None,
    quiet: options.Quiet = False,
) -> None:
    """Fit a model of a device's draw time, and test it on polygons that it has not seen.

    time = c0 + cT*T + cS*S + cH*H + cB*sum(w*h) + cD*D + cQ*Q + cP*P + cR*R. T is the number of
    triangles, S their area, H their half-perimeters, sum(w*h) the area of their bounding boxes, D
    their shape deviation, Q and P the expected quads and 4x4 blocks, and R the expected number of
    triangles with a pixel centre in their bounding box. optimal:calibrated minimises this time.

    A second table has the best model of each number of terms, and the fewest that predict as well.
    """
    from harness import rasterisers
    from harness.measuring.loading import load_scene
    from harness.measuring.processes import Backend, Bench
    from harness.measuring.worker import Worker
    from harness.pictures.style import plain_table
    from harness.rasterisers.base import Options
    from harness.study import calibration_draws as study
    from harness.study import cost_model, model_terms

    allowed = model_terms.named(terms or ()) or cost_model.TERMS[1:]

    reporter = Reporter(quiet=quiet)
    name = rasteriser or rasterisers.usual()
    backend = Backend(name, rasterisers.find_device(name, device))
    loaded = [load_scene(each, seed, reporter) for each in scene or ["city"]]
    bench = Bench(Worker, timeout_s=600)
    try:
        fit, validation, fewer = study.calibrate(
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
            allowed,
        )
        described = bench.describe()[backend.label]
    finally:
        bench.close()
    file = out or options.CALIBRATIONS / f"{backend.device.name}.json"
    facts = {
        "rasteriser": rasteriser or "",
        "name": backend.device.name,
        "resolution": resolution,
        "work": work,
        **described,
    }
    file = study.write(fit, validation, facts, file, fewer)
    title = f"time of a draw: {backend.label}"
    table = plain_table(title, "term", "coefficient", "95 % interval", "unit")
    for term, unit in zip(cost_model.TERMS, cost_model.UNITS, strict=True):
        low, high = fit.intervals[term]
        table.add_row(term, f"{fit.coefficients[term]:.3g}", f"{low:.3g} to {high:.3g}", unit)
    Console(highlight=False).print(table)
    typer.echo(str(validation))
    _print_models(fewer, model_terms.fewest(fewer))
    if not validation.good:
        raise Inconclusive(
            f"the fit is refused, for R2 below {study.LEAST_R2:g} would follow noise: close other "
            f"programs, or draw longer, e.g. --budget {4 * budget:g}; kept in {file}"
        )
    typer.echo(f"calibration: {file}")


def _print_models(found: Sequence[Model], chosen: Model) -> None:
    """Print the best model of each number of terms, and which is the smallest that will do."""
    from harness.pictures.style import plain_table

    title = "the best model of each number of terms, on polygons that chose none"
    table = plain_table(title, "terms", ">R2 over", ">R2 within", ">regret")
    for model in found:
        ends = f"{model.regret_low:.2%} to {model.regret_high:.2%}"
        regret = f"{model.regret:.2%} ({'too few' if 'nan' in ends else ends})"
        table.add_row(model.written, f"{model.r2_over:.4f}", f"{model.r2_within:.4f}", regret)
    Console().print(table)
    typer.echo(
        f"the fewest terms that predict as well, within one standard error: {chosen.written} "
        f"(to fit them alone: --terms {','.join(chosen.letters)})"
    )
