"""Meshes of a glTF file, and replacement of the triangles."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.models.flat_faces import ModelMesh, ModelPart, get_single_precision_tolerance
from harness.models.gltf_file import GltfEditor
from scenes.readers.gltf import FAN, FULL_SCALE, STRIP, TRIANGLES, check_index

_VARIANTS = "KHR_materials_variants"
HARMLESS = (_VARIANTS, "EXT_mesh_features", "EXT_structural_metadata", "KHR_xmp_json_ld")
"""Extensions of a mesh or primitive that do not depend on the order of triangles."""

_MIN_TOLERANCES = {  # invisible deviations from an affine function on the face
    "NORMAL": 1e-4,
    "TANGENT": 1e-4,
    "COLOR": 1e-4,
    "TEXCOORD": 2.0**-18,
    "POSITION": 0.0,
}

_MAX_INTEGER_STEP = 1e-4  # maximum tolerance of integer coordinates, as a share of the extent


class GltfModel(GltfEditor):
    """A glTF model whose parts can be replaced."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.unchanged: Counter[str] = Counter()

    def iterate_groups(self) -> Iterator[list[ModelPart]]:
        """Yield the parts of each mesh; a part of several meshes is yielded with the first mesh."""
        seen: set[str] = set()
        meshes = self.json.get("meshes", [])
        primitives: dict[str, list[dict[str, Any]]] = {}
        placements: dict[str, tuple[NDArray[np.float64], ...]] = {}
        reasons: dict[str, str] = {}
        for mesh, matrices in zip(meshes, self.list_placements(), strict=True):
            for primitive in mesh["primitives"]:
                key = _make_key(primitive)
                primitives.setdefault(key, []).append(primitive)
                placements[key] = placements.get(key, ()) + matrices
                reasons[key] = reasons.get(key) or self._explain_unchanged(mesh, primitive)
        for mesh in meshes:
            keys = dict.fromkeys(_make_key(primitive) for primitive in mesh["primitives"])
            new_keys = [key for key in keys if key not in seen]
            seen.update(new_keys)
            parts = [
                self._make_part(primitives[key], placements[key], reasons[key]) for key in new_keys
            ]
            yield [part for part in parts if part is not None]

    def replace_triangles(self, part: ModelPart, triangles: NDArray[np.int64]) -> None:
        """Replace the triangles of a part by (m, 3) `triangles`."""
        self.replace_indices(part.source, triangles.reshape(-1))

    def _explain_unchanged(self, mesh: dict[str, Any], primitive: dict[str, Any]) -> str:
        extensions = primitive.get("extensions", {})
        for name in (*mesh.get("extensions", {}), *extensions):
            if name not in HARMLESS:
                return f"extension {name}"
        materials = self.json.get("materials", [])
        for entry in (primitive, *extensions.get(_VARIANTS, {}).get("mappings", [])):
            if (
                "material" in entry
                and materials[check_index(entry["material"])].get("alphaMode") == "BLEND"
            ):
                return "with a blended material the order of triangles is visible"
        return ""

    def _make_part(
        self,
        primitives: list[dict[str, Any]],
        placements: tuple[NDArray[np.float64], ...],
        reason_unchanged: str,
    ) -> ModelPart | None:
        primitive = primitives[0]
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in primitive["attributes"]:
            return None
        positions, placements = self.read_positions(primitive, placements)
        triangles = self.read_triangles(primitive, len(positions))
        used_vertices = np.unique(triangles)
        attributes = self._read_attributes(primitive, len(positions), used_vertices)
        exact = positions.astype(np.float64)
        used = exact[used_vertices]
        if positions.dtype.kind == "f" or len(used) == 0:
            tolerance = get_single_precision_tolerance(used)
        else:
            tolerance = min(1.0, _MAX_INTEGER_STEP * float(np.ptp(used, axis=0).max()))
        mesh = ModelMesh(exact, triangles, *attributes, tolerance)
        return ModelPart(mesh, primitives, reason_unchanged, placements)

    def _read_attributes(
        self, primitive: dict[str, Any], count: int, used: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the affine and the fixed attributes of `ModelMesh`; `used` sets the tolerance.

        Joints and weights are fixed, because products of weights and position are not affine.
        """
        affine, fixed = [np.empty((count, 0))], [np.empty((count, 0))]
        accessors = sorted(
            item for item in primitive["attributes"].items() if item[0] != "POSITION"
        )
        for target in primitive.get("targets", []):
            accessors += sorted(target.items())
        for name, accessor in accessors:
            values, normalized = self.read_values(accessor)
            column = values.astype(np.float64)
            if len(column) != count:
                raise ValueError(f"{name}: {len(column):,} values for {count:,} vertices")
            tolerance = _MIN_TOLERANCES.get(name.partition("_")[0])
            if tolerance is None:
                fixed.append(column)
                continue
            if normalized:
                column = column / FULL_SCALE[values.dtype.str[1:]]
            affine.append(column / max(tolerance, get_single_precision_tolerance(column[used])))
        return np.concatenate(affine, axis=1), np.concatenate(fixed, axis=1)


def _make_key(primitive: dict[str, Any]) -> str:
    """Return a text that is equal for primitives with the same vertices and triangles."""
    names = ("attributes", "indices", "mode", "targets", "extensions")
    return repr([primitive.get(name) for name in names])
