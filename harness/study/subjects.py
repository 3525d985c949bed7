"""Which polygons and which triangulations a validation study measures.

A criterion is judged within a polygon, so each polygon is a scene of its own that fills the
viewport. Each is triangulated in many ways: as programs do it, with the least and the most of each
criterion, and at random, uniformly over all of its triangulations.

A run draws each polygon as a handful of triangulators do it, which differ little. To judge a
criterion within polygons more is needed. So some polygons of the run's first view are triangulated
in some 25 more ways, and what each costs is counted on the exact CPU reference, where they lie in
the frame. Nothing of it is timed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from harness.errors import InputError
from harness.frame import View
from harness.grid import SUBPIXEL
from harness.metrics.registry import list_predictions
from harness.rasterisers.reference import Reference, predict
from harness.results import drawings
from harness.settings import StudySize
from harness.triangulating.recipes import Recipe, parse_all
from scenes import Scene
from triangulators import criteria, registry, triangulate, vertices
from triangulators.errors import TriangulationError

NOT_NAMED = ("exhaustive", "optimal", "worst", "random", "pareto", "listed")
"""Triangulators that are not methods a program would choose by name."""

FEWEST_VERTICES = 8
"""A smaller polygon has too few triangulations (at most 42 at seven) to rank."""

STEERED = ("overdraw", "shape", "half-perimeter", "expected-quads", "edge-length")
"""Criteria whose optimal and worst triangulations are measured."""

LEAST = "optimal:exact-quads"
"""What regret is measured against: no triangulation shades fewer quads. Large ones are skipped."""


def choose_polygons(scene: Scene, design: StudySize) -> list[tuple[int, Scene]]:
    """Return (number in the scene, scene of that polygon alone), from few to many vertices.

    Simple polygons only: the optimum is exact, and random triangulations are uniform, where
    there are no holes. They are taken at equal steps through all sizes.

    Raises
    ------
    InputError
        if the scene has no suitable polygon
    """
    sizes = shapely.get_num_coordinates(np.array(scene.polygons, dtype=object)) - 1
    simple = np.array([not polygon.interiors for polygon in scene.polygons])
    fit = _fit(sizes, simple, design.most_vertices)
    if not fit:
        raise InputError(
            f"{scene.name} has no polygon without holes of {FEWEST_VERTICES} to "
            f"{design.most_vertices} vertices; a study needs some with many triangulations: "
            "give another scene or file"
        )
    whole = replace(scene, tiling=None, dropped=[], repaired=[], attributes=None)
    return [
        (number, replace(whole, polygons=[scene.polygons[number]]))
        for number in evenly(fit, design.polygons)
    ]


def _fit(sizes: NDArray[Any], simple: NDArray[np.bool_], most: int) -> list[int]:
    """Return which (p,) polygons without holes are not too small or large, by their vertices."""
    fit = np.flatnonzero(simple & (sizes >= FEWEST_VERTICES) & (sizes <= most))
    return [int(number) for number in fit[np.argsort(sizes[fit], kind="stable")]]


def evenly(numbers: Sequence[int], most: int) -> list[int]:
    """Return at most so many of the numbers, at equal steps from the first to the last."""
    steps = np.linspace(0, len(numbers) - 1, min(most, len(numbers)))
    return list(dict.fromkeys(numbers[round(step)] for step in steps.tolist()))


def choose_triangulators(design: StudySize, polygon: Polygon) -> tuple[Recipe, ...]:
    """Return all triangulations to measure of a polygon without holes."""
    from triangulators.methods.counting import count_triangulations
    from triangulators.methods.exhaustive import enumerate_triangulations

    named = [
        name
        for name, entry in registry.BUILTIN.items()
        if name not in NOT_NAMED and entry.available() is None
    ]
    steered = [f"{end}:{name}" for name in STEERED for end in ("optimal", "worst")]
    # Beside the flips that `flips` alone stands for, the rule of the most used program, Blender.
    steered += ["flips:beauty", LEAST]
    if count_triangulations(polygon, design.all_below) < design.all_below:
        count = len(enumerate_triangulations(polygon, "paper"))
        return parse_all([*named, *steered, *(f"listed#{k}" for k in range(count))])
    return parse_all([*named, *steered, *(f"random#{seed}" for seed in range(design.random))])


POLYGONS = 24
RANDOM = 20
MOST_VERTICES = 60
"""Of larger polygons random triangulations take long."""

NAMED = (
    "ear-clipping",
    "delaunay",
    *(f"{end}:{name}" for name in ("half-perimeter", "overdraw") for end in ("optimal", "worst")),
)

MEASURES = Reference.counters
"""What can be judged: what the reference counts."""


def count_triangulations(kept: drawings.Geometry, view: View) -> list[dict[str, Any]]:
    """Return each triangulation's criteria and counts, of polygons at steps through all sizes."""
    sizes = kept.grid.vertex_counts
    simple = kept.grid.ring_counts == 1
    rows = []
    for k in evenly(_fit(sizes, simple, MOST_VERTICES), POLYGONS):
        points, _ = kept.grid.rings_of(k)
        for name, triangles in _triangulations(Polygon(points / SUBPIXEL)):
            counts = predict(points, triangles)
            predicted = criteria.predict(points / SUBPIXEL, triangles)
            rows.append(
                {
                    "polygon": int(kept.source[k]),
                    "resolution": view.resolution,
                    "rotation": view.rotation,
                    "fit": view.fit,
                    "triangulator": name,
                    **{
                        name: predicted[name] for name in (*list_predictions(), "area", "triangles")
                    },
                    **{name: int(counts[name].sum()) for name in MEASURES},
                }
            )
    return rows


def _triangulations(polygon: Polygon) -> Iterator[tuple[str, NDArray[np.int32]]]:
    """Yield (name, triangles) of each way that does the polygon without leaving a vertex out."""
    for name in (*NAMED, *(f"random#{seed}" for seed in range(RANDOM))):
        triangulator, _, seed = name.partition("#")
        parameters: dict[str, Any] = {"seed": int(seed)} if seed else {}
        try:
            triangles = triangulate(polygon, triangulator, **parameters)
        except TriangulationError:
            continue
        if len(triangles) == len(vertices(polygon)) - 2:
            yield name, triangles
