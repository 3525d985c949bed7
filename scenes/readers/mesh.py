"""Faces of 3D models: n-gons of OBJ and PLY as they are, coplanar triangles of others joined."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.cleaning.layout import in_rows
from scenes.readers import obj, ply
from scenes.readers.reader import Raw, Source
from scenes.scene import Note, SceneError

_FLAT = "each face flat in its own plane, side by side"
_PLANAR = 1e-3
"""A face that leaves its plane by more than this share of its size is noted."""


def read(source: Source, size: int) -> Iterator[Raw]:  # noqa: ARG001 - a model is one chunk
    """Every face in its own plane, laid out in rows, in model units.

    Level faces keep their plan and upright ones stand; `layer` is not used.
    """
    suffix = source.path.suffix.lower()
    if suffix == ".obj":
        vertices, faces = obj.parse(source.path)
    elif suffix == ".ply":
        vertices, faces = ply.parse(source.path)
    else:
        yield from _joined(source)
        return
    polygons, labels, dropped, repaired = [], [], [], []
    for number, face in enumerate(faces):
        label = f"face {number}"
        if len(face) < 3 or face.min() < 0 or face.max() >= len(vertices):
            reason = (
                "has fewer than 3 vertices" if len(face) < 3 else "has a vertex not in the file"
            )
            dropped.append((label, reason))
            continue
        polygon, off = _flat(vertices[face])
        if polygon is None:
            dropped.append((label, "has no area, or a NaN or infinite coordinate"))
            continue
        if off > _PLANAR:
            repaired.append((label, f"is not planar by {off:.2g} of its size; projected"))
        polygons.append(polygon)
        labels.append(label)
    yield Raw(in_rows(polygons), labels, dropped=dropped, repaired=repaired, notes=(_FLAT,))


def _flat(points: NDArray[np.float64]) -> tuple[shapely.Polygon | None, float]:
    """A face in its plane, and by how much of its size its vertices leave that plane."""
    with np.errstate(over="ignore", invalid="ignore"):
        local = points - points.mean(axis=0)
        after = np.roll(local, -1, axis=0)
        # Newell's normal: right for concave and for slightly bent faces
        normal = np.cross(local, after).sum(axis=0)
        length = np.linalg.norm(normal)
    if not np.isfinite(length) or length == 0.0:
        return None, 0.0
    axes = plane(normal / length)
    size = np.abs(local).max()
    return shapely.Polygon(local @ axes[:2].T), float(np.abs(local @ axes[2]).max() / size)


def plane(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows x, y, normal of a right-handed frame; x is level, and y up where that can be."""
    x = np.cross([0.0, 0.0, 1.0], normal)
    if np.linalg.norm(x) < 1e-9:
        x = np.array([1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(normal, x), normal])


def _joined(source: Source) -> Iterator[Raw]:
    """Faces of a format that has triangles only: neighbours in one plane become one polygon."""
    import trimesh  # slow to import, and needed for these formats alone

    model = trimesh.load_mesh(source.path, process=True)
    triangles = np.asarray(getattr(model, "faces", np.empty((0, 3), int)), dtype=np.int64)
    if len(triangles) == 0:
        raise SceneError(f"{source.path} holds no face: give a model with faces")
    polygons, dropped = facets(np.asarray(model.vertices, dtype=float), triangles)
    labels = [f"facet {i}" for i in range(len(polygons))]
    yield Raw(in_rows(polygons), labels, dropped=dropped, notes=(_FLAT,))


def facets(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64]
) -> tuple[list[Any], list[Note]]:
    """Coplanar neighbouring triangles of a mesh, joined and laid flat: one geometry per facet."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    groups = [np.asarray(group) for group in mesh.facets]
    alone = np.setdiff1d(np.arange(len(triangles)), np.concatenate([*groups, np.empty(0, int)]))
    groups += [np.array([i]) for i in alone]
    polygons: list[Any] = []
    dropped: list[Note] = []
    for group in groups:
        corners = vertices[triangles[group]]
        edges = corners[:, 1:] - corners[:, :1]
        normal = np.cross(edges[:, 0], edges[:, 1]).sum(axis=0)
        length = np.linalg.norm(normal)
        if not np.isfinite(length) or length == 0.0:
            dropped.append((f"triangle {group[0]}", "has no area, or a NaN or infinite coordinate"))
            continue
        flat = (corners - corners[0, 0]) @ plane(normal / length)[:2].T
        polygons.append(shapely.union_all(shapely.polygons(flat)))
    return polygons, dropped
