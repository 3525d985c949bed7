"""n-gon faces of a 3D model, each in its own plane: what a mesh pipeline triangulates."""

from __future__ import annotations

import numpy as np
import shapely

from scenes.cleaning.clean import clean, in_rows
from scenes.generated import cad
from scenes.readers.meshes import facets
from scenes.scene import Scene


def build(*, seed: int = 0) -> Scene:
    """Faces of ten generated sheet metal parts, 20 mm thick, laid out in rows."""
    polygons = []
    for part in cad.build(seed=seed, parts=10, segments=16).polygons:
        polygons += facets(*_extruded(part, 20.0))[0]
    cleaned = clean(in_rows(polygons), [f"facet {i}" for i in range(len(polygons))])
    return Scene(
        name="meshes",
        polygons=list(cleaned.polygons),
        units="mm",
        description="faces of sheet metal parts, each in its plane",
        licence="generated, no rights reserved",
        parameters={"seed": seed},
        dropped=cleaned.dropped,
        repaired=cleaned.repaired,
    )


def _extruded(part: shapely.Polygon, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a prism over the polygon."""
    import trimesh

    solid = trimesh.creation.extrude_polygon(part, height, engine="earcut")
    return np.asarray(solid.vertices), np.asarray(solid.faces, dtype=np.int64)
