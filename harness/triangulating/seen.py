"""Triangulations of a model's flat faces, carried to the pieces of its views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.triangulating.frames import FrameTriangulation, predict_polygons


def in_views(frame: Frame, flat: FrameTriangulation) -> FrameTriangulation:
    """Return the triangulation of a frame's pieces that follows from that of its flat faces.

    A face is triangulated once, in its plane, and drawn so in each view. What no face has, the rest
    of a view, keeps its triangles. Seconds are those of the faces, once.
    """
    viewing = frame.viewing
    assert viewing is not None
    sources = viewing.source.tolist()
    parts = [
        viewing.rest[piece] if piece in viewing.rest else flat.parts[source]
        for piece, source in enumerate(sources)
    ]
    skipped, failed = dict(flat.skipped), dict(flat.failed)
    gaps = _gaps(flat)
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


def original(frame: Frame) -> FrameTriangulation:
    """Return the triangulation that a model came with, in all its views."""
    assert frame.viewing is not None
    given: list[NDArray[np.int32] | None] = list(frame.viewing.given)
    return in_views(frame, FrameTriangulation(parts=given, t_junctions=[0] * len(given)))


def _gaps(flat: FrameTriangulation) -> dict[int, float]:
    """Return the gap of each face that has triangles; {} where the triangulator is no optimum."""
    if not flat.gaps:
        return {}
    done = [face for face, part in enumerate(flat.parts) if part is not None]
    return dict(zip(done, flat.gaps, strict=True))
