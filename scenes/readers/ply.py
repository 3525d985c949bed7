"""PLY (Stanford polygon format), text and binary, read by the package plyfile: n-gon faces.

trimesh, which reads the other models, would triangulate the faces.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenes.scene import SceneError

_INDICES = ("vertex_indices", "vertex_index")


def parse(path: Path) -> tuple[NDArray[np.float64], list[NDArray[np.int64]]]:
    """(n, 3) vertices and, for each face, the indices of its vertices from 0.

    Raises SceneError for a file without faces and where plyfile is missing, and whatever plyfile
    does for one that is not PLY or is cut short.
    """
    try:
        from plyfile import PlyData  # type: ignore[import-untyped]
    except ImportError:
        raise SceneError(
            f'{path} needs plyfile to be read: pip install "raster-harness[ply]"'
        ) from None
    data = PlyData.read(path, mmap=False)
    if "face" not in data or not len(data["face"].data):
        raise SceneError(f"{path} holds no face: give a model with faces")
    vertex, face = data["vertex"].data, data["face"].data
    name = next((name for name in _INDICES if name in face.dtype.names), None)
    if name is None:
        raise SceneError(f"{path} has faces without {_INDICES[0]}: give a model with polygons")
    vertices = np.column_stack([np.asarray(vertex[axis], dtype=float) for axis in "xyz"])
    return vertices, [np.atleast_1d(np.asarray(each, dtype=np.int64)) for each in face[name]]
