"""The meshes of a glTF file, as they are drawn, and their new indices."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from harness.models.flat_faces import Mesh, Part, tolerance_of
from harness.models.gltf_file import FAN, STRIP, TRIANGLES, GltfFile, index

_VARIANTS = "KHR_materials_variants"
HARMLESS = (_VARIANTS, "EXT_mesh_features", "EXT_structural_metadata", "KHR_xmp_json_ld")
"""Extensions of a mesh or primitive that say nothing of its triangles' order."""

_LEAST = {"NORMAL": 1e-4, "TANGENT": 1e-4, "COLOR": 1e-4, "TEXCOORD": 2.0**-18, "POSITION": 0.0}
"""By how much an attribute may be off an affine function on a face, at least: nobody sees that."""

_WHOLE = 1e-4
"""Of a mesh's extent: what a step of whole coordinates counts for, at most."""

_FULL = {"i1": 127.0, "u1": 255.0, "i2": 32767.0, "u2": 65535.0}


class GltfModel(GltfFile):
    """A glTF model; `groups` yields the parts of each mesh, `replace` and `write` change them."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.left: Counter[str] = Counter()

    def groups(self) -> Iterator[list[Part]]:
        """Yield the parts of each mesh."""
        seen: set[str] = set()
        meshes = self.json.get("meshes", [])
        alike: dict[str, list[dict[str, Any]]] = {}
        places: dict[str, tuple[NDArray[np.float64], ...]] = {}
        left: dict[str, str] = {}
        for mesh, matrices in zip(meshes, self._placements(len(meshes)), strict=True):
            for primitive in mesh["primitives"]:
                key = _key(primitive)
                alike.setdefault(key, []).append(primitive)
                places[key] = places.get(key, ()) + matrices
                left[key] = left.get(key) or self._why_left(mesh, primitive)
        for mesh in meshes:
            keys = [_key(each) for each in mesh["primitives"]]
            fresh = [key for key in dict.fromkeys(keys) if key not in seen]
            seen.update(fresh)
            parts = [self._part(alike[key], places[key], left[key]) for key in fresh]
            yield [part for part in parts if part is not None]

    def replace(self, part: Part, triangles: NDArray[np.int64]) -> None:
        """Give a part other triangles (m, 3)."""
        self.refer(part.source, triangles.reshape(-1))

    def _placements(self, count: int) -> list[tuple[NDArray[np.float64], ...]]:
        """Return for each mesh where the scene's nodes place it; as it is, if there is no scene."""
        told = self.json
        scenes = told.get("scenes")
        if not scenes:
            return [(np.eye(4),)] * count
        nodes = told.get("nodes", [])
        found: list[tuple[NDArray[np.float64], ...]] = [()] * count
        waiting = [
            (number, np.eye(4)) for number in scenes[index(told.get("scene", 0))].get("nodes", [])
        ]
        for _ in range(len(nodes)):  # a tree has each node once
            if not waiting:
                break
            number, above = waiting.pop()
            node = nodes[index(number)]
            matrix = above @ _matrix(node)
            if "mesh" in node:
                found[index(node["mesh"])] += (matrix,)
            waiting += [(child, matrix) for child in node.get("children", [])]
        return found

    def _why_left(self, mesh: dict[str, Any], primitive: dict[str, Any]) -> str:
        """Return why a primitive's triangles stay as they are, "" if they need not."""
        own = primitive.get("extensions", {})
        strange = [name for name in (*mesh.get("extensions", {}), *own) if name not in HARMLESS]
        if strange:
            return f"extension {strange[0]}"
        materials = self.json.get("materials", [])
        for each in (primitive, *own.get(_VARIANTS, {}).get("mappings", [])):
            if (
                "material" in each
                and materials[index(each["material"])].get("alphaMode") == "BLEND"
            ):
                return "a blended material shows in which order triangles are drawn"
        return ""

    def _part(
        self,
        primitives: list[dict[str, Any]],
        placements: tuple[NDArray[np.float64], ...],
        left: str,
    ) -> Part | None:
        """Return what primitives draw; None for lines, points and what has no positions."""
        primitive = primitives[0]
        mode = primitive.get("mode", TRIANGLES)
        attributes = primitive["attributes"]
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in attributes:
            return None
        positions, normalized = self._values(attributes["POSITION"])
        if positions.shape[1] != 3:
            raise ValueError(f"POSITION has {positions.shape[1]} numbers a vertex, not 3")
        if normalized:
            units = np.diag([*3 * [1.0 / _FULL[positions.dtype.str[1:]]], 1.0])
            placements = tuple(matrix @ units for matrix in placements)
        triangles = self._triangles(primitive, mode, len(positions))
        at = np.unique(triangles)
        carried = self._carried(primitive, len(positions), at)
        exact = positions.astype(np.float64)
        used = exact[at]
        if positions.dtype.kind == "f" or len(used) == 0:
            tolerance = tolerance_of(used)
        else:
            tolerance = min(1.0, _WHOLE * float(np.ptp(used, axis=0).max()))
        mesh = Mesh(exact, triangles, *carried, tolerance)
        return Part(mesh, primitives, left, placements)

    def _carried(
        self, primitive: dict[str, Any], count: int, used: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What `count` vertices carry beside positions; used : those that triangles use.

        Returns (n, k) what has to be affine, in units of what may be off, and (n, j) what has to be
        fixed: joints, weights and what is nobody's standard. A skinned vertex moves by products of
        weights and position, which are not affine.
        """
        affine, fixed = [np.empty((count, 0))], [np.empty((count, 0))]
        named = sorted(each for each in primitive["attributes"].items() if each[0] != "POSITION")
        for target in primitive.get("targets", []):
            named += sorted(target.items())
        for name, accessor in named:
            values, normalized = self._values(accessor)
            given = values.astype(np.float64)
            if len(given) != count:
                raise ValueError(f"{name} has {len(given):,} of {count:,} values")
            least = _LEAST.get(name.partition("_")[0])
            if least is None:
                fixed.append(given)
                continue
            if normalized:
                given = given / _FULL[values.dtype.str[1:]]
            affine.append(given / max(least, tolerance_of(given[used])))
        return np.concatenate(affine, axis=1), np.concatenate(fixed, axis=1)

    def _values(self, accessor: int) -> tuple[NDArray[Any], bool]:
        about = self.json["accessors"][index(accessor)]
        return self.array(accessor), bool(about.get("normalized"))

    def _triangles(self, primitive: dict[str, Any], mode: int, count: int) -> NDArray[np.int64]:
        if "indices" in primitive:
            corner = self.array(primitive["indices"])[:, 0].astype(np.int64)
        else:
            corner = np.arange(count)
        if len(corner) and not 0 <= corner.min() <= corner.max() < count:
            raise ValueError(f"index {corner.max():,} of {count:,} vertices")
        if mode == TRIANGLES:
            if len(corner) % 3:
                raise ValueError(f"{len(corner):,} indices are no triangles")
            return corner.reshape(-1, 3)
        if mode == FAN:
            hub = np.full(max(len(corner) - 2, 0), corner[0] if len(corner) else 0)
            return np.stack([corner[1:-1], corner[2:], hub], axis=1)
        odd = np.arange(max(len(corner) - 2, 0)) % 2
        strip = np.stack([corner[:-2], corner[1:-1], corner[2:]], axis=1)
        strip[odd == 1] = strip[odd == 1][:, [0, 2, 1]]
        return strip


def _key(primitive: dict[str, Any]) -> str:
    """What makes primitives draw the same triangles."""
    names = ("attributes", "indices", "mode", "targets", "extensions")
    return repr([primitive.get(name) for name in names])


def _matrix(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return the (4, 4) matrix by which a node places what is in it."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    turned = Rotation.from_quat(node.get("rotation", (0, 0, 0, 1))).as_matrix()
    result = np.eye(4)
    result[:3, :3] = turned * np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    result[:3, 3] = node.get("translation", (0, 0, 0))
    return result
