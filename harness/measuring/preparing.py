"""Triangulates a frame with every triangulator of a plan, and predicts what that costs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, frame_of
from harness.measuring import lower_limits, records
from harness.measuring.processes import Bench
from harness.measuring.worker import TaskFailed, TaskTimedOut
from harness.progress import Reporter
from harness.triangulating.frames import FrameTriangulation, carry_over
from harness.triangulating.recipes import ORIGINAL, Recipe
from harness.triangulating.seen import in_views, original
from scenes import Scene

BASELINE = Recipe("delaunay")
"""Its fragments say what each polygon covers on a device: it leaves no vertex out."""

SAID_AFTER_S = 2.0
"""Seconds of compiling after which it is told; loading what is compiled takes less."""


@dataclass(frozen=True)
class Prepared:
    """A triangulator's result for one view, ready to be measured on every device.

    limits : see `lower_limits.collect`; empty but for the baseline, and until `prepare` ends
    """

    triangulation: FrameTriangulation
    triangles: NDArray[np.int32]
    limits: dict[str, NDArray[np.int64]] = field(default_factory=dict)


def prepare(
    scene: Scene,
    frame: Frame,
    recipes: Sequence[Recipe],
    broken: Mapping[Recipe, str],
    bench: Bench,
    reporter: Reporter,
) -> Iterator[tuple[Recipe, Prepared | tuple[str, str]]]:
    """Yield the result of the baseline and of each recipe, or (status, reason) of what has none.

    broken : recipes that cannot be run, and why
    """
    wanted = list(dict.fromkeys([BASELINE, *recipes]))
    ours = [
        recipe
        for recipe in wanted
        if recipe not in broken and type(recipe) is Recipe and recipe.base != ORIGINAL
    ]
    bench.compile_ahead([*ours, lower_limits.FEWEST])
    begun: lower_limits.Begun | None = None
    limits: dict[str, NDArray[np.int64]] = {}
    with reporter.stage("triangulating", len(wanted)) as stage:
        for recipe in wanted:
            if recipe in broken:
                yield recipe, ("failed", broken[recipe])
            else:
                result = _prepare(scene, frame, recipe, bench, reporter, stage.wait)
                if recipe == BASELINE and isinstance(result, Prepared):
                    begun = lower_limits.begin(frame, result.triangulation.parts, bench)
                    limits = result.limits
                yield recipe, result
            stage.advance()
    said = "looking for the fewest quads, by which regret is told ..."
    if begun:
        with reporter.if_long(said, SAID_AFTER_S):
            limits |= lower_limits.collect(begun, bench)


def _prepare(
    scene: Scene,
    frame: Frame,
    recipe: Recipe,
    bench: Bench,
    reporter: Reporter,
    tick: Callable[[float], None],
) -> Prepared | tuple[str, str]:
    try:
        if recipe.base != ORIGINAL:
            _compile(recipe, bench, reporter)
        result = _triangulate(scene, frame, recipe, bench, tick)
    except TaskTimedOut as error:
        # Ours are slow by design, others may have hung.
        return ("skipped" if recipe.builtin else "failed"), str(error)
    except TaskFailed as error:
        reporter.detail(error.detail)
        return "failed", str(error)
    reporter.detail(result.trace)
    for note in result.notes:
        reporter.warn_once(note)
    triangles = frame.join(result.parts)
    if not len(triangles):
        status = "failed" if result.failed else "skipped"
        return status, records.incomplete(result) or "no polygon is left"
    return Prepared(result, triangles)


def _compile(recipe: Recipe, bench: Bench, reporter: Reporter) -> None:
    """Have a triangulator's code compiled: the first time on a machine that takes a while."""

    def tell(waited: float) -> None:
        if waited > SAID_AFTER_S:
            reporter.once(
                f"compiling {recipe.base}, which only the first run on a machine does ..."
                if recipe.builtin
                else f"still waiting for {recipe.base}, on its first polygons ..."
            )

    bench.compile(recipe, tell)


def _triangulate(
    scene: Scene, frame: Frame, recipe: Recipe, bench: Bench, tick: Callable[[float], None]
) -> FrameTriangulation:
    """Run one triangulator over the frame, over the scene not yet turned, or over flat faces."""
    if frame.flat is not None:
        if recipe.base == ORIGINAL:
            return original(frame)
        return in_views(frame, bench.triangulate(recipe.before_turning, frame.flat.polygons, tick))
    if not recipe.upright:
        return bench.triangulate(recipe, frame.polygons, tick)
    upright = frame_of(scene, replace(frame.view, rotation=0.0))
    before = bench.triangulate(recipe.before_turning, upright.polygons, tick)
    return carry_over(before, upright, frame)
