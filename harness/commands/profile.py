"""`harness profile`: what a triangle, a lane and a pixel cost on a device."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.commands import options
from harness.errors import Inconclusive
from harness.progress import Reporter

BUDGET_S = 0.5
"""Seconds of drawing for each draw of the design."""


def profile(
    device: options.OneDevice = None,
    rasteriser: options.OneRasteriser = None,
    budget: options.Budget = BUDGET_S,
    seed: options.Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="File to write; results/profiles/<rasteriser>-<device>.json if absent."),
    ] = None,
    quiet: options.Quiet = False,
) -> None:
    """Say what a triangle, a pixel and a helper lane cost on a device; how to triangulate there.

    Some hundred designed draws, each kind of which isolates a cost or two, are timed for about a
    minute. Their exact counters and their times give seconds for each cost, with intervals. It says
    from which aspect on thin triangles are slow, and why. The file is also what optimal:calibrated
    minimises (--calibration FILE); a picture lies beside it.
    """
    from harness import rasterisers
    from harness.machine.processor import processor
    from harness.measuring.processes import Backend, Bench
    from harness.measuring.worker import Worker
    from harness.profile import advice, chart, design, measured, words
    from harness.profile import profile as profiles
    from harness.rasterisers.base import Options
    from harness.study.calibration_draws import keep

    reporter = Reporter(quiet=quiet)
    name = rasteriser or rasterisers.usual()
    backend = Backend(name, rasterisers.find_device(name, device))
    kind = rasterisers.get(name)
    draws = [draw for draw in design.draws(seed) if kind.supports(Options(work=draw.work))]
    bench = Bench(Worker, timeout_s=600)
    try:
        timing = measured.settings(budget)
        length = timing.budget_s * (len(draws) + 3)
        with reporter.stage(f"timing {len(draws)} draws: {backend.label}", length) as stage:
            times = measured.measure(backend, bench, draws, timing, seed, stage.complete)
        facts = {
            "rasteriser": name,
            "name": backend.device.name,
            "software": backend.device.software,
            "cpu": processor()["label"],
            **bench.describe()[backend.label],
        }
        content, _ = profiles.profile(draws, times, facts, seed)
        found = advice.advise(bench, content["coefficients"], seed)
        content["advice"] = found and found.to_json()
    finally:
        bench.close()
    content["refused"] = content["refused"] or bool(times.trouble)
    file = out or options.PROFILES / f"{name}-{backend.device.name}.json"
    file = keep(content, file)
    for line in words.sentences(content):
        typer.echo(line)
    Console(highlight=False).print(words.table(content))
    picture = chart.plot(content, file)
    typer.echo(f"profile: {file}, picture: {picture}")
    if times.trouble:
        raise Inconclusive(f"{times.trouble}: close other programs, and repeat; kept in {file}")
    if content["refused"]:
        raise Inconclusive(
            f"the law explains too little (R2 {content['r2_over']:.2f} over all draws, "
            f"{content['r2_within']:.2f} within groups): close other programs, or draw longer, "
            f"e.g. --budget {4 * budget:g}; kept in {file}"
        )
