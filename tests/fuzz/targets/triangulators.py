"""Every triangulator on any polygon: a valid triangulation, and none better than the optimum."""

from __future__ import annotations

import numpy as np

from tests.fuzz.shapes import Rings, polygon_of, rings
from tests.fuzz.target import target
from tests.triangulators.cases import all_triangulations
from triangulators import Skipped, criteria, triangulate, vertices
from triangulators.registry import BUILTIN
from triangulators.verify import verify

LIBRARIES = ("ear-clipping", "delaunay", "sweep", "manifold")
"""Their T-junctions are passed on, and repaired when asked."""

LISTED = 14
"""Vertices up to which all triangulations may be listed."""


@target("triangulators", rings())
def check_triangulators(value: Rings) -> None:
    polygon = polygon_of(value)
    points = vertices(polygon)
    found = {}
    for entry in BUILTIN.values():
        if entry.available() is not None:
            continue
        if entry.name in ("exhaustive", "listed") and len(points) > LISTED:
            continue
        names = [entry.name]
        if entry.criteria:
            names = [f"{entry.name}:{criterion}" for criterion in STEERING]
        for name in names:
            try:
                triangles = triangulate(polygon, name)
            except Skipped:
                assert entry.name in ("fan", "strip") or (
                    polygon.interiors and not entry.handles_holes
                ), name
                continue
            result = verify(polygon, triangles)
            assert result.ok, (name, result.problems)
            assert abs(result.area_error) <= 1e-9 * polygon.area, name
            if not result.conforming:
                assert entry.name in LIBRARIES, (name, result.t_junctions)
                triangles = triangulate(polygon, name, repair=True)
                assert verify(polygon, triangles).conforming, name
            found[name] = triangles
    if not polygon.interiors:
        _extremes_are_extreme(points, found)


STEERING = ("overdraw", "half-perimeter", "edge-length", "shape")


def _extremes_are_extreme(points: np.ndarray, found: dict[str, np.ndarray]) -> None:
    for criterion in STEERING:
        cost = criteria.find(criterion)
        costs = {name: cost.total(points, triangles) for name, triangles in found.items()}
        least, most = costs[f"optimal:{criterion}"], costs[f"worst:{criterion}"]
        scale = 1e-9 * max(map(abs, costs.values()))
        for name, total in costs.items():
            assert least - scale <= total <= most + scale, (criterion, name, least, total, most)


@target("optimum", rings(max_vertices=8, max_holes=0))
def check_optimum(value: Rings) -> None:
    """Against all triangulations, listed by a program of its own in tests/triangulators."""
    polygon = polygon_of(value)
    points = vertices(polygon)
    if len(np.unique(points, axis=0)) < len(points):
        return  # the listing knows a vertex by its place
    everything = [np.array(each) for each in all_triangulations(polygon)]
    for criterion in STEERING:
        cost = criteria.find(criterion)
        costs = [cost.total(points, triangles) for triangles in everything]
        for name, expected in (("optimal", min(costs)), ("worst", max(costs))):
            total = cost.total(points, triangulate(polygon, f"{name}:{criterion}"))
            assert abs(total - expected) <= 1e-9 * max(costs), (name, criterion, total, expected)
