"""New diagonals for a 3D model's flat faces; vertices and file format stay the same."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from pandas.util import hash_pandas_object

from harness.errors import UsageError
from harness.models.diagonals import CHOOSE_CRITERION, choose_diagonals, get_cost_function
from harness.models.flat_faces import (
    INDEX_BITS,
    Ints,
    ModelMesh,
    ModelPart,
    find_flat_faces,
    number_edges,
    number_sides,
)
from harness.models.gltf import GltfModel
from harness.models.obj import ObjModel
from harness.models.views import PIXELS, DrawnPart, ViewCounts, count_views
from scenes.readers import guard
from scenes.readers.guard import check_path

CRITERION = "edge-length"  # proportional to half-perimeter averaged over all rotations

PIXEL_CRITERIA = ("expected-quads", "expected-blocks", "calibrated")

Model = GltfModel | ObjModel

FORMATS: dict[str, type[Model]] = {".glb": GltfModel, ".gltf": GltfModel, ".obj": ObjModel}

_KIND = "a model"


@dataclass
class Changes:
    """Statistics of a model's flat faces, and of the new diagonals."""

    triangles: int = 0
    flat: int = 0  # triangles in flat faces of two or more triangles
    faces: int = 0
    changed: int = 0  # number of flat faces with new diagonals
    optimal: int = 0  # number of flat faces with a proven optimum
    area: float = 0.0  # in the model's units
    flat_area: float = 0.0
    before: float = 0.0  # total side length of the changed faces' triangles, in the model's units
    after: float = 0.0
    unchanged: Counter[str] = field(default_factory=Counter)  # faces and parts by reason
    views: list[ViewCounts] = field(default_factory=list)  # if no file is written
    files: list[Path] = field(default_factory=list)


@np.errstate(all="ignore")
def retriangulate(
    source: Path,
    out: Path | None,
    criterion: str = CRITERION,
    sizes: Sequence[int] = PIXELS,
    tick: Callable[[int], None] = lambda _: None,
) -> Changes:
    """Choose the diagonals of a model's flat faces by a criterion, and write the model to `out`.

    Vertices, attributes and the visible surface stay the same. Without `out`, the changes are only
    computed. `tick` gets the number of finished parts, then of finished placements.
    """
    model, groups = open_model(source)
    if out is not None and out.suffix.lower() != source.suffix.lower():
        raise UsageError(f"-o {out}: the output must keep the input format ({source.suffix})")
    get_cost_function(criterion)
    if criterion in PIXEL_CRITERIA:
        raise UsageError(
            f"criterion {criterion}: depends on a size in pixels, which a model does not have "
            f"({CHOOSE_CRITERION})"
        )
    changes = Changes()
    changes.unchanged += model.unchanged
    drawn: list[DrawnPart] = []
    for parts in groups:
        results = []
        for part in parts:
            results.append(_retriangulate_part(part, criterion, changes))
            tick(len(drawn) + len(results))
        _revert_shared(parts, results, changes)
        for part, result in zip(parts, results, strict=True):
            drawn.append(DrawnPart(part.mesh, result.triangles, part.placements))
            if (result.triangles != part.mesh.triangles).any():
                with guard.raise_scene_errors(str(source), _KIND):
                    model.replace_triangles(part, result.triangles)
    if out is None:
        changes.views = count_views(drawn, sizes, tick) if changes.changed else []
    else:
        changes.files = model.write(out)
    return changes


@np.errstate(all="ignore")
def open_model(source: Path) -> tuple[Model, list[list[ModelPart]]]:
    """Return a model and its parts, in groups that may touch; raises SceneError or UsageError."""
    kind = FORMATS.get(source.suffix.lower())
    if kind is None:
        raise UsageError(f"{source}: unsupported model format; export it as {', '.join(FORMATS)}")
    check_path(str(source))
    with guard.raise_scene_errors(str(source), _KIND):
        model = kind(source)
        return model, list(model.iterate_groups())


@dataclass
class _NewPart:
    """New triangles of a part."""

    triangles: Ints
    face: Ints  # (m,) changed face of each triangle, or -1
    diagonals: Ints  # (d, 2) new edges of changed faces
    diagonal_face: Ints  # (d,)


def _retriangulate_part(part: ModelPart, criterion: str, changes: Changes) -> _NewPart:
    """Return new triangles of a part; add statistics of the part's flat faces to `changes`."""
    mesh = part.mesh
    face, no_edges = np.full(len(mesh.triangles), -1), np.empty((0, 2), np.int64)
    result = _NewPart(mesh.triangles.copy(), face, no_edges, no_edges[:, 0])
    changes.triangles += len(mesh.triangles)
    areas = np.nan_to_num(np.linalg.norm(mesh.normals, axis=1) / 2, posinf=0.0)
    changes.area += float(areas.sum())
    if part.reason_unchanged:
        changes.unchanged[part.reason_unchanged] += 1
        return result
    faces, unchanged = find_flat_faces(mesh)
    changes.unchanged += unchanged
    changes.faces += faces.face_count
    changes.flat += len(faces.slots)
    if len(faces.slots) == 0:
        return result
    changes.flat_area += float(areas[faces.slots].sum())
    diagonals = choose_diagonals(faces, criterion)
    changes.optimal += diagonals.optimal
    result.triangles[faces.slots] = faces.vertices[diagonals.triangles]
    owner = np.repeat(np.arange(len(diagonals.changed)), np.diff(faces.triangle_offsets))
    changed = diagonals.changed[owner]
    result.face[faces.slots[changed]] = owner[changed]
    before = pd.Index(number_sides(faces.triangles[changed]))
    after = pd.Index(number_sides(diagonals.triangles[changed]))
    new_edges = after.difference(before).to_numpy()
    ends = np.stack([new_edges >> INDEX_BITS, new_edges & ((1 << INDEX_BITS) - 1)], axis=1)
    face_of = np.zeros(len(faces.points), dtype=np.int64)
    face_of[faces.triangles] = owner[:, None]
    result.diagonals, result.diagonal_face = faces.vertices[ends], face_of[ends[:, 0]]
    return result


def _revert_shared(parts: list[ModelPart], new_parts: list[_NewPart], changes: Changes) -> None:
    """Restore faces with a new diagonal that is also an edge of other triangles.

    Otherwise both sides of a sheet could get the same edge, and the model would not be watertight.
    Coincident positions count as one vertex. Faces that stay changed are added to `changes`.
    """
    if not parts:
        return
    points = np.concatenate([part.mesh.positions for part in parts]) + 0.0  # turns -0.0 into 0.0
    # Hashes are sorted several times faster than rows. Equal hashes of different rows only restore
    # a face unnecessarily.
    hashes = hash_pandas_object(pd.DataFrame(points), index=False)
    distinct = np.unique(hashes, return_inverse=True)[1]
    vertices = np.split(distinct, np.cumsum([len(part.mesh.positions) for part in parts])[:-1])
    before = [number_sides(v[part.mesh.triangles]) for part, v in zip(parts, vertices, strict=True)]
    after = [number_edges(v[new.diagonals]) for new, v in zip(new_parts, vertices, strict=True)]
    diagonals, counts = np.unique(np.concatenate(after), return_counts=True)
    shared = diagonals[(counts > 1) | pd.Index(diagonals).isin(np.concatenate(before))]
    for part, new, edges in zip(parts, new_parts, after, strict=True):
        bad = np.unique(new.diagonal_face[pd.Index(edges).isin(shared)])
        reverted = np.isin(new.face, bad)
        new.triangles[reverted], new.face[reverted] = part.mesh.triangles[reverted], -1
        changed = new.face >= 0
        changes.changed += len(np.unique(new.face[changed]))
        changes.before += _sum_lengths(part.mesh, part.mesh.triangles[changed])
        changes.after += _sum_lengths(part.mesh, new.triangles[changed])
        if len(bad):
            changes.unchanged["a diagonal would also be an edge of other triangles"] += len(bad)


def _sum_lengths(mesh: ModelMesh, triangles: Ints) -> float:
    sides = mesh.positions[triangles] - mesh.positions[triangles[:, [1, 2, 0]]]
    return float(np.linalg.norm(sides, axis=2).sum())
