"""Triangulates the polygons of a frame, checks every result and says what went wrong where."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, box

from harness.frame import Frame
from harness.triangulating.remembered import Kept
from triangulators import Skipped, criteria, registry, triangulate, vertices
from triangulators.verify import verify

SEED_MARK = "#"
"""`random#7` is the random triangulation of seed 7, whatever the seed of the run, and `pareto#3`
the third after the first of each polygon's Pareto front."""

NUMBERED = {"random": "seed", "pareto": "k", "listed": "k"}
"""Triangulators that take a number, and the parameter that it is."""

BEFORE_TURNING = "@"
"""`optimal:overdraw@0` is cut at rotation 0 and drawn as the view turns, as a program does that
triangulates once and then moves its camera."""


@dataclass
class FrameTriangulation:
    """What one triangulator made of the polygons of a frame.

    parts : for each polygon its (m, 3) int32 triangles, or None where it gave none
    seconds : wall time of the triangulator alone, without checks and without compiling
    skipped, failed : (polygon number in the frame, reason)
    t_junctions : for each polygon, how many vertices lie inside an edge of a triangle
    cached : polygons whose triangles were read from the model database; `seconds` has for them
        what computing them took when they were
    notes : what the user should know of the model database
    """

    parts: list[NDArray[np.int32] | None] = field(default_factory=list)
    seconds: float = 0.0
    skipped: list[tuple[int, str]] = field(default_factory=list)
    failed: list[tuple[int, str]] = field(default_factory=list)
    t_junctions: list[int] = field(default_factory=list)
    cached: int = 0
    notes: list[str] = field(default_factory=list)

    @property
    def conforming(self) -> bool:
        """True where no polygon's triangulation has a T-junction."""
        return not any(self.t_junctions)


def carry_over(before: FrameTriangulation, upright: Frame, turned: Frame) -> FrameTriangulation:
    """Return the triangulation of `upright`'s polygons for the same polygons in `turned`.

    Polygons whose vertices snapping merged in one frame only are failed, with the reason. A thin
    triangle that snapping turned over is drawn as it is, and counts as not conforming.
    """
    numbers = {number: k for k, number in enumerate(upright.source.tolist())}
    result = FrameTriangulation(seconds=before.seconds, cached=before.cached, notes=before.notes)
    for number, (polygon, source) in enumerate(
        zip(turned.polygons, turned.source.tolist(), strict=True)
    ):
        origin = numbers.get(source, -1)
        part = before.parts[origin] if origin >= 0 else None
        junctions, problem = 0, None
        if part is None:
            problem = "not triangulated before turning"
        elif len(vertices(polygon)) != len(vertices(upright.polygons[origin])):
            part, problem = None, "snapping changed its vertices as it was turned"
        elif not (checked := verify(polygon, part)).conforming:
            # A program would draw it all the same; the coverage error says what that costs.
            junctions = max(1, len(checked.t_junctions))
        if problem:
            result.failed.append((number, problem))
        result.parts.append(part)
        result.t_junctions.append(junctions)
    return result


def is_builtin(name: str) -> bool:
    """Whether the triangulator `name` is one of the product's own; imports nothing of others."""
    return re.split(f"[:{SEED_MARK}{BEFORE_TURNING}]", name)[0] in registry.BUILTIN


def triangulate_polygons(
    name: str,
    polygons: Sequence[Polygon],
    seed: int,
    calibration: Mapping[str, float] | None = None,
    database: Path | None = None,
) -> FrameTriangulation:
    """Run the triangulator `name` over polygons in px; never raises for a polygon's sake.

    calibration : coefficients that the criterion `calibrated` weighs its terms with
    database : model database to read from and write to; only for triangulators of our own, whose
        version it knows
    """
    result = FrameTriangulation()
    if not is_builtin(name):
        database = None
    parameters = {} if database is None else _parameters(name, seed, calibration)
    with Kept(database, name.partition(SEED_MARK)[0], parameters) as kept:
        known = kept.find(polygons)
        if None in known:
            _warm_up(name, seed, calibration)
        for number, (polygon, timed) in enumerate(zip(polygons, known, strict=True)):
            part, junctions, seconds = None, 0, 0.0
            if timed is not None:
                part, junctions, _ = check(polygon, timed.triangles)
                seconds = timed.seconds
            if part is not None:
                result.cached += 1
            else:
                part, junctions, seconds = _compute(
                    name, polygon, seed, calibration, number, result
                )
                if part is not None:
                    kept.keep(number, part, seconds)
            result.seconds += seconds
            result.parts.append(part)
            result.t_junctions.append(junctions)
    result.notes = kept.notes
    return result


def _compute(
    name: str,
    polygon: Polygon,
    seed: int,
    calibration: Mapping[str, float] | None,
    number: int,
    result: FrameTriangulation,
) -> tuple[NDArray[np.int32] | None, int, float]:
    """Return triangles, T-junctions and seconds; without triangles `result` is told why."""
    part, junctions = None, 0
    start = time.perf_counter()
    try:
        part = _call(name, polygon, seed, calibration)
    except Skipped as reason:
        result.skipped.append((number, str(reason)))
    except Exception as error:
        result.failed.append((number, f"{type(error).__name__}: {error}"))
    seconds = time.perf_counter() - start
    if part is not None:
        part, junctions, problem = check(polygon, part)
        if problem:
            result.failed.append((number, problem))
    return part, junctions, seconds


def _parameters(name: str, seed: int, calibration: Mapping[str, float] | None) -> dict[str, Any]:
    """Return what besides the polygon decides the triangulation, JSON-ready."""
    base, numbered = _numbered(name, seed)
    if base.endswith(":calibrated") and calibration is not None:
        return {"calibration": sorted(_terms(calibration).items())}
    return numbered


def parameters_of(
    name: str, seed: int, calibration: Mapping[str, float] | None
) -> tuple[str, dict[str, Any]]:
    """Return a name as `triangulators` knows it and its parameters; `calibration` are terms."""
    base, numbered = _numbered(name, seed)
    if base.endswith(":calibrated") and calibration is not None:
        return base, {"calibration": _terms(calibration)}
    return base, numbered


def _numbered(name: str, seed: int) -> tuple[str, dict[str, Any]]:
    """Return a name without its number, and the number as the parameter that it is."""
    base, mark, number = name.partition(SEED_MARK)
    if mark:
        return base, {NUMBERED[base]: int(number)}
    return base, {"seed": seed} if base == "random" else {}


def _terms(calibration: Mapping[str, float]) -> dict[str, float]:
    # A draw's own cost is the same however it is cut, so it is no criterion's term.
    return {term: calibration[term] for term in calibration if term != "draw"}


def _call(
    name: str, polygon: Polygon, seed: int, calibration: Mapping[str, float] | None
) -> NDArray[np.int32]:
    base, numbered = _numbered(name, seed)
    if base.endswith(":calibrated") and calibration is not None:
        return triangulate(polygon, base, criterion=criteria.calibrated(_terms(calibration)))
    return triangulate(polygon, base, **numbered)


def _warm_up(name: str, seed: int, calibration: Mapping[str, float] | None) -> None:
    """Load compiled code, which would otherwise count as the first polygon's time."""
    for polygon in warm_up_polygons():
        try:
            _call(name, polygon, seed, calibration)
        except Exception:  # the real polygons will tell
            continue


def warm_up_polygons() -> tuple[Polygon, ...]:
    """Return polygons that between them need all of a triangulator's compiled code."""
    square = box(0, 0, 8, 8).exterior
    holes = [box(x, 3, x + 2, 5).exterior for x in (1, 5)]
    # Many vertices, few of which see each other: large polygons take other paths than small ones.
    turn = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    reach = np.where(np.arange(200) % 2, 50.0, 400.0)
    star = np.column_stack([reach * np.cos(turn), reach * np.sin(turn)])
    return Polygon(square), Polygon(square, holes[:1]), Polygon(square, holes), Polygon(star)


def check(
    polygon: Polygon, part: NDArray[np.int32]
) -> tuple[NDArray[np.int32] | None, int, str | None]:
    """Return the triangles if they are a triangulation, T-junctions, and what is wrong if not."""
    result = verify(polygon, part)
    if not result.ok:
        return None, 0, "; ".join(result.problems[:3])
    return part, len(result.t_junctions), None
