"""Triangulates the polygons of a frame, checks every result and says what went wrong where."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, box

from harness.frame import Frame
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
    """

    parts: list[NDArray[np.int32] | None] = field(default_factory=list)
    seconds: float = 0.0
    skipped: list[tuple[int, str]] = field(default_factory=list)
    failed: list[tuple[int, str]] = field(default_factory=list)
    t_junctions: list[int] = field(default_factory=list)

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
    result = FrameTriangulation(seconds=before.seconds)
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
) -> FrameTriangulation:
    """Run the triangulator `name` over polygons in px; never raises for a polygon's sake.

    calibration : coefficients that the criterion `calibrated` weighs its terms with
    """
    result = FrameTriangulation()
    _warm_up(name, seed, calibration)
    for number, polygon in enumerate(polygons):
        part, junctions = None, 0
        start = time.perf_counter()
        try:
            part = _call(name, polygon, seed, calibration)
        except Skipped as reason:
            result.skipped.append((number, str(reason)))
        except Exception as error:
            result.failed.append((number, f"{type(error).__name__}: {error}"))
        result.seconds += time.perf_counter() - start
        if part is not None:
            part, junctions, problem = _check(polygon, part)
            if problem:
                result.failed.append((number, problem))
        result.parts.append(part)
        result.t_junctions.append(junctions)
    return result


def _call(
    name: str, polygon: Polygon, seed: int, calibration: Mapping[str, float] | None
) -> NDArray[np.int32]:
    base, mark, number = name.partition(SEED_MARK)
    if mark:
        parameters: dict[str, Any] = {NUMBERED[base]: int(number)}
        return triangulate(polygon, base, **parameters)
    if base == "random":
        return triangulate(polygon, base, seed=seed)
    if base.endswith(":calibrated") and calibration is not None:
        # A draw's own cost is the same however it is cut, so it is no criterion's term.
        terms = {term: calibration[term] for term in calibration if term != "draw"}
        return triangulate(polygon, base, criterion=criteria.calibrated(terms))
    return triangulate(polygon, name)


def _warm_up(name: str, seed: int, calibration: Mapping[str, float] | None) -> None:
    """Load compiled code, which would otherwise count as the first polygon's time."""
    hole = box(3, 3, 5, 5).exterior.coords
    for polygon in (box(0, 0, 8, 8), Polygon(box(0, 0, 8, 8).exterior.coords, [hole])):
        try:
            _call(name, polygon, seed, calibration)
        except Exception:  # the real polygons will tell
            continue


def _check(
    polygon: Polygon, part: NDArray[np.int32]
) -> tuple[NDArray[np.int32] | None, int, str | None]:
    """Return the triangles if they are a triangulation, T-junctions, and what is wrong if not."""
    result = verify(polygon, part)
    if not result.ok:
        return None, 0, "; ".join(result.problems[:3])
    return part, len(result.t_junctions), None
