"""The triangulations of a frame's polygons by one triangulator."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from triangulators.criteria import predict_many
from triangulators.polygon_arrays import PolygonArray, offsets_of
from triangulators.verify import verify

Rows = NDArray[np.int32]
Columns = dict[str, NDArray[np.float64]]
"""Triangles (m, 3), rows of three vertex indices; values per polygon, (p,), by name."""


@dataclass
class FrameTriangulation:
    """Result of one triangulator for the polygons of a frame.

    parts : for each polygon the (m, 3) triangles, or None without triangles
    seconds : CPU time without checks and compilation; for `cached` polygons the stored time
    samples_s : `seconds` of several interleaved rounds; [] if timed once
    skipped, failed : (polygon number in the frame, reason)
    t_junctions : for each polygon, the number of vertices inside an edge of a triangle
    cached : number of polygons read from the model database
    gaps : for optima, for each polygon with triangles, the maximum relative excess over the minimum
        cost: 0 if proven optimal, infinite if unknown
    predicted : (p,) sums of each criterion over each polygon's triangles; lengths in px, areas px^2
    notes : messages about the model database
    trace : traceback of the first error in a triangulator's code, or ""
    """

    parts: list[Rows | None] = field(default_factory=list)
    seconds: float = 0.0
    samples_s: list[float] = field(default_factory=list)
    skipped: list[tuple[int, str]] = field(default_factory=list)
    failed: list[tuple[int, str]] = field(default_factory=list)
    t_junctions: list[int] = field(default_factory=list)
    cached: int = 0
    gaps: list[float] = field(default_factory=list)
    predicted: Columns = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    trace: str = ""

    @property
    def conforming(self) -> bool:
        """True if no polygon's triangulation has a T-junction."""
        return not any(self.t_junctions)

    @property
    def drawn(self) -> NDArray[np.bool_]:
        """Flags (p,) of polygons with triangles."""
        return np.array([part is not None for part in self.parts], np.bool_)

    def add(self, part: Rows | None, junctions: int = 0, problem: str = "") -> None:
        """Add the triangles of the next polygon with the number of T-junctions, or the problem."""
        if problem:
            self.failed.append((len(self.parts), problem))
        self.parts.append(None if problem else part)
        self.t_junctions.append(junctions)


def sum_criteria_per_polygon(polygons: PolygonArray, parts: Sequence[Rows | None]) -> Columns:
    """Return each criterion's sum over each polygon's triangles (m, 3), (p,) by column."""
    if not len(polygons):
        return {}
    empty = np.empty((0, 3), np.int32)
    rows = [empty if part is None else part for part in parts]
    offsets = offsets_of([len(part) for part in rows])
    return predict_many(polygons.coords, polygons.vertex_offsets, np.concatenate(rows), offsets)


def check_triangles(polygon: Polygon, triangles: Rows) -> tuple[int, str]:
    """Return the number of T-junctions, and "" if the triangulation is valid, else its problems."""
    result = verify(polygon, triangles)
    return (len(result.t_junctions), "") if result.ok else (0, "; ".join(result.problems[:3]))


LARGE_VERTICES, LARGE_HOLES = 50_000, 5_000  # from there on, ear clipping takes more than 5 s


def describe_large_polygon(polygons: Sequence[Polygon] | NDArray[Any]) -> str:
    """Return a line about the first polygon that takes long, or ""."""
    geometries = np.asarray(polygons, dtype=object)
    vertices = shapely.get_num_coordinates(geometries) if len(geometries) else geometries
    holes = shapely.get_num_interior_rings(geometries) if len(geometries) else geometries
    large = np.flatnonzero((vertices >= LARGE_VERTICES) | (holes >= LARGE_HOLES))
    if not len(large):
        return ""
    index = large[0]
    return (
        f"polygon {index} has {vertices[index]:,} vertices and {holes[index]:,} holes; ear "
        "clipping takes time quadratic in both, Delaunay and the test of validity up to quadratic: "
        "minutes to hours; Ctrl-C stops"
    )
