"""Triangulates the polygons of a frame, checks every result and says what went wrong where."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, box

from triangulators import Skipped, registry, triangulate
from triangulators.verify import verify

SEED_MARK = "#"
"""`random#7` is the random triangulation of seed 7, whatever the seed of the run."""


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


def is_builtin(name: str) -> bool:
    """Whether the triangulator `name` is one of the product's own; imports nothing of others."""
    return re.split(f"[:{SEED_MARK}]", name)[0] in registry.BUILTIN


def triangulate_polygons(name: str, polygons: Sequence[Polygon], seed: int) -> FrameTriangulation:
    """Run the triangulator `name` over polygons in px; never raises for a polygon's sake."""
    result = FrameTriangulation()
    _warm_up(name, seed)
    for number, polygon in enumerate(polygons):
        part, junctions = None, 0
        start = time.perf_counter()
        try:
            part = _call(name, polygon, seed)
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


def _call(name: str, polygon: Polygon, seed: int) -> NDArray[np.int32]:
    base, _, own_seed = name.partition(SEED_MARK)
    if base == "random":
        return triangulate(polygon, base, seed=int(own_seed or seed))
    return triangulate(polygon, name)


def _warm_up(name: str, seed: int) -> None:
    """Load compiled code, which would otherwise count as the first polygon's time."""
    hole = box(3, 3, 5, 5).exterior.coords
    for polygon in (box(0, 0, 8, 8), Polygon(box(0, 0, 8, 8).exterior.coords, [hole])):
        try:
            _call(name, polygon, seed)
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
