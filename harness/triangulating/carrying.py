"""Transfer of triangulations to another frame: to a rotated scene, or to a model's views."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.frame import Frame, Viewing
from harness.triangulating.recipes import ORIGINAL, Recipe
from harness.triangulating.triangulate import FrameTriangulation, Rows, sum_criteria_per_polygon
from triangulators.polygon_arrays import offsets_of
from triangulators.verify import verify


def carry_to_rotated_frame(
    before: FrameTriangulation, upright: Frame, turned: Frame
) -> FrameTriangulation:
    """Return the triangulation of `upright`'s polygons for the same polygons in `turned`.

    Polygons whose vertices were merged by snapping in only one frame fail. A polygon with a thin
    triangle that snapping inverted is drawn, and counts as having a T-junction.
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
            # Not a failure: a renderer would draw a triangulation that does not conform, too. The
            # coverage error counts the wrong pixels.
            junctions = max(1, len(checked.t_junctions))
        result.add(part, junctions, problem)
    result.predicted = sum_criteria_per_polygon(turned.polygons, result.parts)
    return result


FLIPPING_TRIANGULATORS = ("optimal", "flips")
"""Triangulators that flip diagonals of invalid faces, too, as the command `triangulate` does."""


def carry_to_views(frame: Frame, flat: FrameTriangulation, recipe: Recipe) -> FrameTriangulation:
    """Return the triangulation of a frame's pieces (see `Viewing`) from that of its flat faces.

    A face is triangulated once, in its plane, for all views; `FLIPPING_TRIANGULATORS` treat faces
    as the command `triangulate` does. Triangles outside of faces are unchanged.
    """
    viewing = frame.viewing
    assert viewing is not None
    sources = viewing.source.tolist()
    replaced = _replace_faces(frame, viewing, flat.parts, recipe)

    def get_triangles(piece: int, source: int) -> Rows | None:
        if source in replaced:
            return replaced[source]
        if piece in viewing.other_triangles:
            return viewing.other_triangles[piece]
        return flat.parts[source]

    parts = [get_triangles(piece, source) for piece, source in enumerate(sources)]
    skipped, failed = dict(flat.skipped), dict(flat.failed)
    gaps: dict[int, float] = {}
    if flat.gaps:
        solved = (face for face, part in enumerate(flat.parts) if part is not None)
        gaps = dict(zip(solved, flat.gaps, strict=True))
        gaps |= {source: math.inf for source in replaced if source > len(viewing.polygon_triangles)}
    return replace(
        flat,
        parts=parts,
        skipped=[(k, skipped[source]) for k, source in enumerate(sources) if source in skipped],
        failed=[(k, failed[source]) for k, source in enumerate(sources) if source in failed],
        t_junctions=[
            0 if piece in viewing.other_triangles else flat.t_junctions[source]
            for piece, source in enumerate(sources)
        ],
        gaps=[
            gaps.get(source, 0.0)
            for source, part in zip(sources, parts, strict=True)
            if gaps and part is not None
        ],
        predicted=sum_criteria_per_polygon(frame.polygons, parts),
    )


def _replace_faces(
    frame: Frame, viewing: Viewing, parts: Sequence[Rows | None], recipe: Recipe
) -> dict[int, Rows]:
    """Return the triangles that replace `parts`, by number of the face in `Viewing.source`.

    As in the command `triangulate`, a face whose cost would not decrease keeps the model's
    triangles, and an invalid face gets flipped diagonals.
    """
    method, _, criterion = recipe.base.partition(":")
    if method not in FLIPPING_TRIANGULATORS or recipe.calibration is not None or frame.flat is None:
        return {}
    from harness.models.diagonals import (  # compiled
        choose_diagonals,
        find_cheaper_faces,
        get_cost_function,
    )
    from harness.models.flat_faces import Faces

    try:
        cost = get_cost_function(criterion)
    except UsageError:  # the criterion's weights depend on the polygon
        return {}
    originals, first_vertices = viewing.polygon_triangles, frame.flat.grid.vertex_offsets[:-1]
    same_size = [
        k for k, part in enumerate(parts) if part is not None and len(part) == len(originals[k])
    ]
    before, offsets = _concatenate_faces(
        [originals[k] for k in same_size], first_vertices[same_size]
    )
    after, _ = _concatenate_faces([parts[k] for k in same_size], first_vertices[same_size])
    cheaper = find_cheaper_faces(frame.flat.points.astype(np.float64), before, after, offsets, cost)
    replaced = {k: originals[k] for k in np.array(same_size, int)[~cheaper].tolist()}
    if viewing.invalid_faces:
        points = np.concatenate([vertices for vertices, _ in viewing.invalid_faces])
        first_vertices = offsets_of([len(vertices) for vertices, _ in viewing.invalid_faces])[:-1]
        triangles, offsets = _concatenate_faces(
            [rows for _, rows in viewing.invalid_faces], first_vertices
        )
        slots = np.arange(len(triangles))
        faces = Faces(points, np.arange(len(points)), triangles, slots, offsets)
        rows_by_face = np.split(choose_diagonals(faces, criterion).triangles, offsets[1:-1])
        by_face = zip(rows_by_face, first_vertices, strict=True)
        for face, (rows, first) in enumerate(by_face, len(originals) + 1):
            replaced[face] = (rows - first).astype(np.int32)
    return replaced


def _concatenate_faces(
    parts: Sequence[Rows | None], first_vertices: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Concatenate faces whose vertices begin at `first_vertices`; return offsets (f + 1,), too."""
    rows = [part for part in parts if part is not None]
    renumbered = [part + first for part, first in zip(rows, first_vertices, strict=True)]
    triangles = np.concatenate([np.empty((0, 3), np.int64), *renumbered]).astype(np.int64)
    return triangles, offsets_of([len(part) for part in rows])


def make_original_triangulation(frame: Frame) -> FrameTriangulation:
    """Return the triangulation in a model's file, for all its views."""
    assert frame.viewing is not None
    originals: list[Rows | None] = list(frame.viewing.polygon_triangles)
    flat = FrameTriangulation(parts=originals, t_junctions=[0] * len(originals))
    return carry_to_views(frame, flat, Recipe(ORIGINAL))
