"""How large a validation study is, and which triangulations it always measures."""

from __future__ import annotations

from dataclasses import dataclass

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
