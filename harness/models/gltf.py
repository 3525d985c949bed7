"""The meshes of a glTF file, as they are drawn, and their new indices."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.models.flat_faces import ModelMesh, ModelPart, tolerance_of
from harness.models.gltf_file import GltfEditor
from scenes.readers.gltf import FAN, FULL_SCALE, STRIP, TRIANGLES, index

_VARIANTS = "KHR_materials_variants"
HARMLESS = (_VARIANTS, "EXT_mesh_features", "EXT_structural_metadata", "KHR_xmp_json_ld")
"""Extensions of a mesh or primitive that say nothing of its triangles' order."""

_LEAST = {"NORMAL": 1e-4, "TANGENT": 1e-4, "COLOR": 1e-4, "TEXCOORD": 2.0**-18, "POSITION": 0.0}
"""By how much an attribute may be off an affine function on a face, at least: nobody sees that."""

_WHOLE = 1e-4
"""Of a mesh's extent: what a step of whole coordinates counts for, at most."""


class GltfModel(GltfEditor):
    """A glTF model; `groups` yields the parts of each mesh, `replace` and `write` change them."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.left: Counter[str] = Counter()

    def groups(self) -> Iterator[list[ModelPart]]:
        """Yield the parts of each mesh."""
        seen: set[str] = set()
        meshes = self.json.get("meshes", [])
        alike: dict[str, list[dict[str, Any]]] = {}
        places: dict[str, tuple[NDArray[np.float64], ...]] = {}
        left: dict[str, str] = {}
        for mesh, matrices in zip(meshes, self.placements(), strict=True):
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

    def replace(self, part: ModelPart, triangles: NDArray[np.int64]) -> None:
        """Give a part other triangles (m, 3)."""
        self.refer(part.source, triangles.reshape(-1))

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
    ) -> ModelPart | None:
        """Return what primitives draw; None for lines, points and what has no positions."""
        primitive = primitives[0]
        mode = primitive.get("mode", TRIANGLES)
        attributes = primitive["attributes"]
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in attributes:
            return None
        positions, placements = self.positions(primitive, placements)
        triangles = self.triangles(primitive, len(positions))
        at = np.unique(triangles)
        carried = self._carried(primitive, len(positions), at)
        exact = positions.astype(np.float64)
        used = exact[at]
        if positions.dtype.kind == "f" or len(used) == 0:
            tolerance = tolerance_of(used)
        else:
            tolerance = min(1.0, _WHOLE * float(np.ptp(used, axis=0).max()))
        mesh = ModelMesh(exact, triangles, *carried, tolerance)
        return ModelPart(mesh, primitives, left, placements)

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
            values, normalized = self.values(accessor)
            given = values.astype(np.float64)
            if len(given) != count:
                raise ValueError(f"{name} has {len(given):,} of {count:,} values")
            least = _LEAST.get(name.partition("_")[0])
            if least is None:
                fixed.append(given)
                continue
            if normalized:
                given = given / FULL_SCALE[values.dtype.str[1:]]
            affine.append(given / max(least, tolerance_of(given[used])))
        return np.concatenate(affine, axis=1), np.concatenate(fixed, axis=1)


def _key(primitive: dict[str, Any]) -> str:
    """What makes primitives draw the same triangles."""
    names = ("attributes", "indices", "mode", "targets", "extensions")
    return repr([primitive.get(name) for name in names])
