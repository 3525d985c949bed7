"""Triangulates the flat faces of a 3D model again, in place: the same vertices, other diagonals."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from pandas.util import hash_pandas_object

from harness.errors import UsageError
from harness.models.diagonals import choose, cost_named
from harness.models.flat_faces import HALF, Ints, Mesh, Part, edge_numbers, flat_faces, sides_of
from harness.models.gltf import GltfModel
from harness.models.obj import ObjModel
from harness.models.views import PIXELS, Drawn, Seen, look
from scenes.readers import guard
from scenes.readers.guard import existing

CRITERION = "edge-length"
"""What is less in every view from afar: the mean half-perimeter over all rotations follows it."""


Model = GltfModel | ObjModel
"""A model whose triangles can be replaced."""

FORMATS: dict[str, type[GltfModel] | type[ObjModel]] = {
    ".glb": GltfModel,
    ".gltf": GltfModel,
    ".obj": ObjModel,
}
"""Suffix to what reads a model, and later writes it."""

_KIND = "a model"


@dataclass
class Changes:
    """What was found and done.

    triangles : of the model; flat : of those, in flat faces of two triangles or more
    faces : flat faces; changed : of those, with other diagonals; optimal : proven to be optimal
    area, flat_area : in the model's units
    before, after : length of all sides of changed faces' triangles, in the model's units
    left : faces and parts left as they are, by reason
    seen : where nothing is written, counters of the model before and after, in views from around
    """

    triangles: int = 0
    flat: int = 0
    faces: int = 0
    changed: int = 0
    optimal: int = 0
    area: float = 0.0
    flat_area: float = 0.0
    before: float = 0.0
    after: float = 0.0
    left: Counter[str] = field(default_factory=Counter)
    seen: list[Seen] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)


@np.errstate(all="ignore")
def retriangulate(
    source: Path,
    out: Path | None,
    criterion: str = CRITERION,
    sizes: Sequence[int] = PIXELS,
    tick: Callable[[int], None] = lambda _: None,
) -> Changes:
    """Choose the diagonals of a model's flat faces by a criterion, and write it to `out`.

    Every vertex and all that it carries stay as they are, and so do the number of triangles and
    what is seen. out : None to tell only what would be done; tick : told how many parts are done,
    and then how many of their places were looked at

    Raises
    ------
    SceneError
        for a file that is not there, is damaged, or holds its triangles packed
    UsageError
        for an output that cannot be written or has another suffix than the source, and a criterion
        that is no sum over triangles
    """
    model, groups = opened(source)
    if out is not None and out.suffix.lower() != source.suffix.lower():
        raise UsageError(f"-o {out}: a model stays what it is, so give {source.suffix}")
    cost_named(criterion)
    changes = Changes()
    changes.left += model.left
    drawn: list[Drawn] = []
    for parts in groups:
        made = []
        for part in parts:
            made.append(_made(part, criterion, changes))
            tick(len(drawn) + len(made))
        _revert_shared(parts, made, changes)
        for part, found in zip(parts, made, strict=True):
            drawn.append(Drawn(part.mesh, found.triangles, part.placements))
            if (found.triangles != part.mesh.triangles).any():
                with guard.clear_errors(str(source), _KIND):
                    model.replace(part, found.triangles)
    if out is None:
        changes.seen = look(drawn, sizes, tick) if changes.changed else []
    else:
        changes.files = model.write(out)
    return changes


@np.errstate(all="ignore")
def opened(source: Path) -> tuple[Model, list[list[Part]]]:
    """Return a model and its parts, those together that may touch.

    Raises
    ------
    SceneError
        for a file that is not there, is damaged, or holds its triangles packed
    UsageError
        for one that is no model, by its suffix
    """
    kind = FORMATS.get(source.suffix.lower())
    if kind is None:
        raise UsageError(f"{source}: models are read as {', '.join(FORMATS)}: export it")
    existing(str(source))
    with guard.clear_errors(str(source), _KIND):
        model = kind(source)
        return model, list(model.groups())


@dataclass
class _Made:
    """New triangles of a part.

    face : (m,) the changed face that each is of, -1 for no such
    diagonals : (d, 2) edges that changed faces did not have before; whose : (d,) their faces
    """

    triangles: Ints
    face: Ints
    diagonals: Ints
    whose: Ints


def _made(part: Part, criterion: str, changes: Changes) -> _Made:
    mesh = part.mesh
    face = np.full(len(mesh.triangles), -1)
    made = _Made(mesh.triangles.copy(), face, np.empty((0, 2), np.int64), np.empty(0, np.int64))
    changes.triangles += len(mesh.triangles)
    areas = np.nan_to_num(np.linalg.norm(mesh.normals, axis=1) / 2, posinf=0.0)
    changes.area += float(areas.sum())
    if part.left:
        changes.left[part.left] += 1
        return made
    faces, left = flat_faces(mesh)
    changes.left += left
    changes.faces += len(faces.starts) - 1
    changes.flat += len(faces.slots)
    if len(faces.slots) == 0:
        return made
    changes.flat_area += float(areas[faces.slots].sum())
    chosen = choose(faces, criterion)
    changes.optimal += chosen.optimal
    made.triangles[faces.slots] = faces.vertices[chosen.triangles]
    owner = np.repeat(np.arange(len(chosen.changed)), np.diff(faces.starts))
    changed = chosen.changed[owner]
    made.face[faces.slots[changed]] = owner[changed]
    after, before = (sides_of(each[changed]) for each in (chosen.triangles, faces.triangles))
    fresh = pd.Index(after).difference(pd.Index(before)).to_numpy()
    ends = np.stack([fresh >> HALF, fresh & ((1 << HALF) - 1)], axis=1)
    face_of = np.zeros(len(faces.points), dtype=np.int64)
    face_of[faces.triangles] = owner[:, None]
    made.diagonals, made.whose = faces.vertices[ends], face_of[ends[:, 0]]
    return made


def _revert_shared(parts: list[Part], made: list[_Made], changes: Changes) -> None:
    """Give a face its diagonals back where a new one is an edge of other triangles, too.

    Two triangles of a sheet that lie back to back would share an edge with those of the other side,
    and the model would no longer be watertight. Places that coincide count as one vertex.
    """
    if not parts:
        return
    points = np.concatenate([part.mesh.positions for part in parts]) + 0.0  # turns -0.0 into 0.0
    # to sort rows takes several times as long as to sort numbers; two places that get the same one
    # by chance would cost a face its new diagonals, and no more
    place = np.unique(hash_pandas_object(pd.DataFrame(points), index=False), return_inverse=True)[1]
    places = np.split(place, np.cumsum([len(part.mesh.positions) for part in parts])[:-1])
    before = [sides_of(at[part.mesh.triangles]) for part, at in zip(parts, places, strict=True)]
    after = [edge_numbers(at[each.diagonals]) for each, at in zip(made, places, strict=True)]
    own, times = np.unique(np.concatenate(after), return_counts=True)
    shared = own[(times > 1) | pd.Index(own).isin(np.concatenate(before))]
    for part, each, edges in zip(parts, made, after, strict=True):
        bad = np.unique(each.whose[pd.Index(edges).isin(shared)])
        gone = np.isin(each.face, bad)
        each.triangles[gone], each.face[gone] = part.mesh.triangles[gone], -1
        changed = each.face >= 0
        changes.changed += len(np.unique(each.face[changed]))
        changes.before += _length(part.mesh, part.mesh.triangles[changed])
        changes.after += _length(part.mesh, each.triangles[changed])
        if len(bad):
            changes.left["a diagonal would be an edge of other triangles, too"] += len(bad)


def _length(mesh: Mesh, triangles: Ints) -> float:
    """Return the length of all sides of triangles."""
    sides = mesh.positions[triangles] - mesh.positions[triangles[:, [1, 2, 0]]]
    return float(np.linalg.norm(sides, axis=2).sum())
