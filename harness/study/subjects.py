"""Which polygons and which triangulations a validation study measures.

A criterion is judged within a polygon, so each polygon is a scene of its own that fills the
viewport. Each is triangulated in many ways: as programs do it, with the least and the most of each
criterion, and at random, uniformly over all of its triangulations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from harness.errors import UsageError
from harness.triangulating.recipes import Recipe, parse_all
from scenes import Scene
from triangulators import registry

NOT_NAMED = ("exhaustive", "optimal", "worst", "random", "pareto", "listed")
"""Triangulators that are not methods a program would choose by name."""

FEWEST_VERTICES = 8
"""A smaller polygon has too few triangulations (at most 42 at seven) to rank."""

STEERED = ("overdraw", "shape", "half-perimeter", "expected-quads", "edge-length")
"""Criteria whose optimal and worst triangulations are measured."""

LEAST = "optimal:exact-quads"
"""What regret is measured against: no triangulation shades fewer quads. Large ones are skipped."""


@dataclass(frozen=True)
class Design:
    """Size of a study.

    polygons : how many are drawn from the scene
    random : random triangulations of each
    most_vertices : larger polygons are left out, because their optima take long
    all_below : a polygon with fewer triangulations than this has all of them measured instead of
        random ones, among them those with T-junctions that the paper's method makes
    """

    polygons: int = 24
    random: int = 30
    most_vertices: int = 400
    all_below: int = 100


def choose_polygons(scene: Scene, design: Design) -> list[tuple[int, Scene]]:
    """Return (number in the scene, scene of that polygon alone), from few to many vertices.

    Simple polygons only: the optimum is exact, and random triangulations are uniform, where
    there are no holes. They are taken at equal steps through all sizes.

    Raises
    ------
    UsageError
        if the scene has no suitable polygon
    """
    sizes = _sizes(scene.polygons)
    fit = [
        number
        for number in np.argsort(sizes, kind="stable").tolist()
        if FEWEST_VERTICES <= sizes[number] <= design.most_vertices
        and not scene.polygons[number].interiors
    ]
    if not fit:
        raise UsageError(
            f"{scene.name} has no polygon without holes of {FEWEST_VERTICES} to "
            f"{design.most_vertices} vertices; a study needs some with many triangulations: "
            "give another scene or file"
        )
    return [(number, _alone(scene, number)) for number in evenly(fit, design.polygons)]


def evenly(numbers: Sequence[int], most: int) -> list[int]:
    """Return at most so many of the numbers, at equal steps from the first to the last."""
    steps = np.linspace(0, len(numbers) - 1, min(most, len(numbers)))
    return list(dict.fromkeys(numbers[round(step)] for step in steps.tolist()))


def _sizes(polygons: Sequence[Polygon]) -> NDArray[np.int64]:
    return np.asarray(shapely.get_num_coordinates(np.array(polygons, dtype=object)) - 1)


def _alone(scene: Scene, number: int) -> Scene:
    attributes = None if scene.attributes is None else scene.attributes.iloc[[number]]
    polygons = [scene.polygons[number]]
    alone = replace(scene, polygons=polygons, attributes=attributes, tiling=None, viewing=None)
    return replace(alone, dropped=[], repaired=[])


def choose_triangulators(design: Design, polygon: Polygon) -> tuple[Recipe, ...]:
    """Return all triangulations to measure of a polygon without holes."""
    from triangulators.methods.exhaustive import count_triangulations, enumerate_triangulations

    named = [
        name
        for name, entry in registry.BUILTIN.items()
        if name not in NOT_NAMED and entry.available() is None
    ]
    steered = [f"{end}:{name}" for name in STEERED for end in ("optimal", "worst")]
    steered.append(LEAST)
    if count_triangulations(polygon, design.all_below) < design.all_below:
        count = len(enumerate_triangulations(polygon, "paper"))
        return parse_all([*named, *steered, *(f"listed#{k}" for k in range(count))])
    return parse_all([*named, *steered, *(f"random#{seed}" for seed in range(design.random))])
