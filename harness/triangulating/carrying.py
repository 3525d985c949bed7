"""Transfer of triangulations to another frame: to a rotated scene, or to a model's views."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.frame import Frame
from harness.triangulating.recipes import ORIGINAL, Recipe
from harness.triangulating.result import FrameTriangulation, Rows, predict_polygons
from harness.viewing import Viewing
from triangulators.polygon_arrays import offsets_of
from triangulators.verify import verify


def carry_over(before: FrameTriangulation, upright: Frame, turned: Frame) -> FrameTriangulation:
    """Return the triangulation of `upright`'s polygons for the same polygons in `turned`.

    Polygons whose vertices were merged by snapping in only one frame are failed, with the reason. A
    thin triangle that snapping inverted is drawn unchanged, and counts as not conforming.
    """
    numbers = {number: k for k, number in enumerate(upright.source.tolist())}
    result = FrameTriangulation(seconds=before.seconds, cached=before.cached, notes=before.notes)
    vertices = upright.grid.vertex_counts
    for index, source in enumerate(turned.source.tolist()):
        origin = numbers.get(source, -1)
        part = before.parts[origin] if origin >= 0 else None
        junctions, problem = 0, ""
        if part is None:
            problem = "not triangulated before the rotation"
        elif turned.grid.vertex_counts[index] != vertices[origin]:
            problem = "snapping changed its vertices in the rotation"
        elif not (checked := verify(turned.polygons[index], part)).conforming:
            # A program would draw it anyway; the coverage error reports the effect.
            junctions = max(1, len(checked.t_junctions))
        result.add(part, junctions, problem)
    result.predicted = predict_polygons(turned.polygons, result.parts)
    return result


FLIPPING = ("optimal", "flips")
"""Triangulators that flip diagonals of faces that are not polygons, as `triangulate` does."""


def carry_to_views(frame: Frame, flat: FrameTriangulation, recipe: Recipe) -> FrameTriangulation:
    """Return the triangulation of a frame's pieces, given that of its flat faces.

    A face is triangulated once, in its plane, and drawn so in each view. Loose triangles, the rest
    of a view, are not changed. Recipes of `FLIPPING` treat faces as `triangulate` does, including
    faces that are not polygons. Seconds are those of one triangulation of the polygons.
    """
    viewing = frame.viewing
    assert viewing is not None
    sources = viewing.source.tolist()
    turned = _replace_faces(frame, viewing, flat.parts, recipe)

    def triangles(piece: int, source: int) -> Rows | None:
        if source in turned:
            return turned[source]
        return viewing.rest[piece] if piece in viewing.rest else flat.parts[source]

    parts = [triangles(piece, source) for piece, source in enumerate(sources)]
    skipped, failed = dict(flat.skipped), dict(flat.failed)
    gaps: dict[int, float] = {}
    if flat.gaps:
        done = (face for face, part in enumerate(flat.parts) if part is not None)
        gaps = dict(zip(done, flat.gaps, strict=True))
        gaps |= {source: math.inf for source in turned if source > len(viewing.given)}
    return replace(
        flat,
        parts=parts,
        skipped=[(k, skipped[source]) for k, source in enumerate(sources) if source in skipped],
        failed=[(k, failed[source]) for k, source in enumerate(sources) if source in failed],
        t_junctions=[
            0 if piece in viewing.rest else flat.t_junctions[source]
            for piece, source in enumerate(sources)
        ],
        gaps=[
            gaps.get(source, 0.0)
            for source, part in zip(sources, parts, strict=True)
            if gaps and part is not None
        ],
        predicted=predict_polygons(frame.polygons, parts),
    )


def _replace_faces(
    frame: Frame, viewing: Viewing, parts: Sequence[Rows | None], recipe: Recipe
) -> dict[int, Rows]:
    """Return by source the faces for which `triangulate` differs from a polygon's triangulator.

    It does not change a face without a gain, and flips diagonals of faces that are not polygons.
    parts : triangles (m, 3) of each polygon
    """
    method, _, criterion = recipe.base.partition(":")
    if method not in FLIPPING or recipe.calibration is not None or frame.flat is None:
        return {}
    from harness.models.diagonals import choose, find_cost, gains  # compiled code
    from harness.models.flat_faces import Faces

    try:
        cost = find_cost(criterion)
    except UsageError:  # its weights depend on the polygon
        return {}
    given, first_vertices = viewing.given, frame.flat.grid.vertex_offsets[:-1]
    same_size = [
        k for k, part in enumerate(parts) if part is not None and len(part) == len(given[k])
    ]
    before, offsets = _renumber([given[k] for k in same_size], first_vertices[same_size])
    after, _ = _renumber([parts[k] for k in same_size], first_vertices[same_size])
    cheaper = gains(frame.flat.points.astype(np.float64), before, after, offsets, cost)
    turned = {k: given[k] for k, less in zip(same_size, cheaper.tolist(), strict=True) if not less}
    if viewing.bound:
        points = np.concatenate([vertices for vertices, _ in viewing.bound])
        first_vertices = offsets_of([len(vertices) for vertices, _ in viewing.bound])[:-1]
        triangles, offsets = _renumber([rows for _, rows in viewing.bound], first_vertices)
        slots = np.arange(len(triangles))
        faces = Faces(points, np.arange(len(points)), triangles, slots, offsets)
        rows_by_face = np.split(choose(faces, criterion).triangles, offsets[1:-1])
        by_face = zip(rows_by_face, first_vertices, strict=True)
        for face, (rows, first) in enumerate(by_face, len(given) + 1):
            turned[face] = (rows - first).astype(np.int32)
    return turned


def _renumber(
    parts: Sequence[Rows | None], first_vertices: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return triangles of faces whose vertices begin at `first_vertices`, and their offsets."""
    rows = [part for part in parts if part is not None]
    moved = [part + first for part, first in zip(rows, first_vertices, strict=True)]
    none = np.empty((0, 3), np.int64)
    return np.concatenate([none, *moved]).astype(np.int64), offsets_of([len(part) for part in rows])


def original_triangulation(frame: Frame) -> FrameTriangulation:
    """Return the triangulation in a model's file, for all its views."""
    assert frame.viewing is not None
    given: list[Rows | None] = list(frame.viewing.given)
    flat = FrameTriangulation(parts=given, t_junctions=[0] * len(given))
    return carry_to_views(frame, flat, Recipe(ORIGINAL))
