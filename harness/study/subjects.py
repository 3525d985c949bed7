"""Polygons and triangulations of a validation study.

A criterion is evaluated within a polygon, so each polygon is a separate scene that fills the
viewport. The polygon is triangulated in many ways: by common methods, with the minimum and the
maximum of each criterion, and at random, uniformly over all triangulations.

An ordinary run has too few triangulations of each polygon. For the run's report,
`evaluate_triangulations` makes and counts about 25 of some polygons, untimed.
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
from harness.rasterisers.reference import Reference, count_per_triangle
from harness.results.run_folder import Geometry
from harness.settings import StudySize
from harness.triangulating.recipes import Recipe, parse_all
from scenes import Scene
from triangulators import criteria, registry, triangulate, vertices
from triangulators.errors import TriangulationError

NOT_METHODS = ("exhaustive", "optimal", "worst", "random", "pareto", "listed")
"""Triangulators that are not methods for use in programs."""

MIN_VERTICES = 8  # smaller polygons have too few triangulations to rank (at most 42 for 7)
OPTIMISED = ("overdraw", "shape", "half-perimeter", "expected-quads", "edge-length")
"""Criteria for which the best and worst triangulations are measured."""

MIN_QUADS = "optimal:exact-quads"  # minimum of quads, for regret; large polygons are skipped


def choose_polygons(scene: Scene, design: StudySize) -> list[tuple[int, Scene]]:
    """Return (number in the scene, scene of that polygon only), from few to many vertices.

    Polygons have no holes, so that optima are exact and random triangulations uniform. They are
    sampled evenly by size. Raises InputError if none is suitable.
    """
    sizes = shapely.get_num_coordinates(np.array(scene.polygons, dtype=object)) - 1
    simple = np.array([not polygon.interiors for polygon in scene.polygons])
    suitable = _select_by_size(sizes, simple, design.max_vertices)
    if not suitable:
        raise InputError(
            f"{scene.name} has no polygon without holes of {MIN_VERTICES} to "
            f"{design.max_vertices} vertices, as a study needs; use another scene"
        )
    template = replace(scene, tiling=None, dropped=[], repaired=[], attributes=None)
    return [
        (number, replace(template, polygons=[scene.polygons[number]]))
        for number in sample_evenly(suitable, design.polygons)
    ]


def _select_by_size(sizes: NDArray[Any], simple: NDArray[np.bool_], limit: int) -> list[int]:
    """Return indices of simple polygons with `MIN_VERTICES` to `limit` vertices, by size."""
    numbers = np.flatnonzero(simple & (sizes >= MIN_VERTICES) & (sizes <= limit))
    return [int(number) for number in numbers[np.argsort(sizes[numbers], kind="stable")]]


def sample_evenly(numbers: Sequence[int], limit: int) -> list[int]:
    """Return at most `limit` numbers, evenly spaced from the first to the last."""
    steps = np.linspace(0, len(numbers) - 1, min(limit, len(numbers)))
    return list(dict.fromkeys(numbers[round(step)] for step in steps.tolist()))


def choose_triangulators(design: StudySize, polygon: Polygon) -> tuple[Recipe, ...]:
    """Return the triangulations to measure for a polygon without holes."""
    from triangulators.methods.exhaustive import count_triangulations, enumerate_triangulations

    methods = [
        name
        for name, entry in registry.BUILTIN.items()
        if name not in NOT_METHODS and entry.find_install_command() is None
    ]
    optimised = [f"{end}:{name}" for name in OPTIMISED for end in ("optimal", "worst")]
    # Blender's flips, in addition to the default ones of `flips`.
    optimised += ["flips:beauty", MIN_QUADS]
    if count_triangulations(polygon, design.all_below) < design.all_below:
        count = len(enumerate_triangulations(polygon, "paper"))
        return parse_all([*methods, *optimised, *(f"listed#{k}" for k in range(count))])
    return parse_all([*methods, *optimised, *(f"random#{seed}" for seed in range(design.random))])


POLYGONS = 24  # limit of `evaluate_triangulations`
RANDOM = 20  # random triangulations of each polygon
MAX_VERTICES = 60  # random triangulations of larger polygons are slow

COUNTED = (  # in addition to random triangulations
    "ear-clipping",
    "delaunay",
    *(f"{end}:{name}" for name in ("half-perimeter", "overdraw") for end in ("optimal", "worst")),
)

MEASURES = Reference.counters  # with which criteria can be correlated


def evaluate_triangulations(geometry: Geometry, view: View) -> list[dict[str, Any]]:
    """Return a row of criteria and counters for each triangulation of some polygons."""
    sizes = geometry.grid.vertex_counts
    simple = geometry.grid.ring_counts == 1
    columns = (*list_predictions(), "area", "triangles")
    rows = []
    for k in sample_evenly(_select_by_size(sizes, simple, MAX_VERTICES), POLYGONS):
        points, _ = geometry.grid.rings_of(k)
        for name, triangles in _list_triangulations(Polygon(points / SUBPIXEL)):
            counts = count_per_triangle(points, triangles)
            predicted = criteria.predict(points / SUBPIXEL, triangles)
            rows.append(
                {
                    "polygon": int(geometry.source[k]),
                    **vars(view),
                    "triangulator": name,
                    **{column: predicted[column] for column in columns},
                    **{measure: int(counts[measure].sum()) for measure in MEASURES},
                }
            )
    return rows


def _list_triangulations(polygon: Polygon) -> Iterator[tuple[str, NDArray[np.int32]]]:
    """Yield (name, triangles) of each triangulation that uses all vertices of the polygon."""
    for name in (*COUNTED, *(f"random#{seed}" for seed in range(RANDOM))):
        triangulator, _, seed = name.partition("#")
        parameters: dict[str, Any] = {"seed": int(seed)} if seed else {}
        try:
            triangles = triangulate(polygon, triangulator, **parameters)
        except TriangulationError:
            continue
        if len(triangles) == len(vertices(polygon)) - 2:
            yield name, triangles
