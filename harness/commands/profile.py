"""`harness profile`: the costs of a triangle, a lane and a pixel on a device."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.commands import options
from harness.errors import InconclusiveError
from harness.progress import Reporter, Screen
from harness.results.run_folder import make_file_stem
from harness.settings import TIMEOUT_S

if TYPE_CHECKING:
    from harness.measuring.pool import MeasuringPool

BUDGET_S = 0.5  # seconds of drawing for each of the designed draws


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
    verbose: options.Verbose = False,
) -> None:
    """Measure the costs of triangles, pixels and helper lanes on a device; recommend a criterion.

    Almost 200 designed draws, of kinds that isolate one or two costs, are timed for about two
    minutes. The times and the exact counters give the seconds of each cost, with intervals, and the
    aspect ratio from which a thin triangle takes twice as long. The file also has the costs that
    optimal:calibrated minimises (run --profile FILE); a chart is written next to the file.
    """
    from harness import rasterisers
    from harness.machine.environment import describe_processor
    from harness.measuring.pool import Backend, MeasuringPool
    from harness.profile import design, measured
    from harness.profile import profile as profiles
    from harness.profile.cost_terms import count_draw
    from harness.rasterisers.base import Options
    from harness.worker import Worker

    reporter = Reporter(quiet=quiet, verbose=verbose)
    (name,) = options.choose_rasterisers((rasteriser,) if rasteriser else None)
    backend = Backend(name, rasterisers.find_device(name, device))
    kind = rasterisers.get(name)
    draws = [draw for draw in design.make_draws(seed) if kind.supports(Options(work=draw.work))]
    with closing(MeasuringPool(Worker, timeout_s=TIMEOUT_S)) as pool:
        step = pool.open_device(backend).details.get("step") or 1
        draws = [design.snap_draw(draw, step) for draw in draws]
        timing = measured.make_profile_timing(budget, len(draws))
        length = budget * (len(draws) + 3)
        with reporter.stage(f"timing {len(draws)} draws: {backend.label}", length) as stage:
            times = measured.measure_draws(backend, pool, draws, timing, seed, stage.complete)
        facts = {
            "rasteriser": name,
            "name": backend.device.name,
            "software": backend.device.software,
            "cpu": describe_processor()["label"],
            "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            **pool.describe_devices()[backend.label],
        }
        content = profiles.make_profile(
            draws, [count_draw(draw) for draw in draws], times, facts, seed
        )
        add_advice(content, pool, times.unreliable_reason)
    if len(times.rounds) < measured.EPOCHS:
        typer.echo(
            f"warning: slow device: {len(times.rounds)} of {measured.EPOCHS} epochs in "
            f"{timing.limit_s:g} s, so intervals are wide; increase --budget",
            err=True,
        )
    write_profile(content, out, times.unreliable_reason)


def add_advice(content: dict[str, Any], pool: MeasuringPool, trouble: str) -> None:
    """Add the recommended criterion; refuse the profile if `trouble`, a reason, is not empty."""
    from harness.profile import advice

    content["advice"] = advice.recommend_triangulator(
        pool, content["coefficients"], content["seed"]
    )
    content["refused"] = content["refused"] or bool(trouble)


def write_profile(content: Mapping[str, Any], out: Path | None, trouble: str) -> None:
    """Write and print a profile and its picture; raise InconclusiveError if it is refused."""
    from harness.profile import report
    from harness.profile.profile import write_profile as write_file

    device = content["device"]
    name = make_file_stem(f"{device['rasteriser']}-{device['name']}")
    file = write_file(content, out or options.PROFILES / f"{name}.json")
    for line in report.format_sentences(content):
        typer.echo(line)
    Screen(highlight=False).print(report.make_table(content))
    picture = report.draw_chart(content, file)
    typer.echo(f"profile: {file}" + (f", picture: {picture}" if picture else ""))
    if trouble:
        raise InconclusiveError(f"{trouble}: close other programs and repeat; saved as {file}")
    if content["refused"]:
        raise InconclusiveError(
            f"the cost model fits the times poorly (R2 {content['r2_over']:.2f} over all draws, "
            f"{content['r2_within']:.2f} within groups): close other programs or raise --budget, "
            f"e.g. four times; saved as {file}"
        )
