"""Generated models with textures, nodes, strips, quantised positions and other content.

Each has flat faces that ear clipping cut into slivers, and is closed unless a comment denies it.
"""

import base64
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
import trimesh
from PIL import Image

from tests.models.build import Builder, split_glb


class Shape(NamedTuple):
    """A mesh: points (n, 3), normals (n, 3), uv (n, 2), triangles (m, 3), facet of each vertex."""

    points: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    triangles: np.ndarray
    facet: np.ndarray


def make_solid(turn: float = 0.7, size: float = 10.0) -> trimesh.Trimesh:
    """Return a rotated plate with a round hole and a slot."""
    shape = shapely.Point(0, 0).buffer(size, quad_segs=8)
    shape = shape.difference(shapely.Point(0.2 * size, 0.1 * size).buffer(0.3 * size, quad_segs=8))
    shape = shape.difference(shapely.box(-0.6 * size, -0.2 * size, -0.4 * size, 0.2 * size))
    mesh = trimesh.creation.extrude_polygon(shape, 0.2 * size, engine="earcut")
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, [1, 2, 3]))
    return mesh


def make_shape(mesh: trimesh.Trimesh, *, hard: bool = True) -> Shape:
    """Return a mesh with an affine map on each face; `hard`: faces share no vertices."""
    number = np.arange(len(mesh.faces)) + len(mesh.facets)
    for face, rows in enumerate(mesh.facets):
        number[rows] = face
    owner = np.repeat(number, 3) if hard else np.zeros(3 * len(mesh.faces), np.int64)
    keys = np.column_stack([owner, mesh.faces.reshape(-1)])
    rows, first, triangles = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    points = mesh.vertices[rows[:, 1]].astype("<f4")
    normals = mesh.face_normals[first // 3].astype("<f4")
    across = np.cross(normals, [0.3, 0.5, 0.8])
    up = np.cross(normals, across)
    uv = np.stack([(points * axis).sum(axis=1) / 40 + 0.5 for axis in (across, up)], axis=1)
    return Shape(points, normals, uv.astype("<f4"), triangles.reshape(-1, 3), rows[:, 0])


def move_shape(shape: Shape, *by: float) -> Shape:
    """Return a shape moved apart: if shapes intersected, their order would decide pixels."""
    return shape._replace(points=shape.points + np.float32(by))


def make_picture() -> bytes:
    """Return a PNG of slowly changing colours, so that small offsets change little."""
    ramp = np.linspace(0, 255, 64)
    red, green = np.meshgrid(ramp, ramp)
    pixels = np.stack([red, green, 255 - red], axis=2).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


class Model(Builder):
    """A glTF model with materials, nodes and extras."""

    def add(self, shape: Shape, kind: str = "<u2", **attributes: int) -> dict[str, Any]:
        names = {"POSITION": self.accessor(shape.points), "NORMAL": self.accessor(shape.normals)}
        corners = self.accessor(shape.triangles.astype(kind).reshape(-1))
        primitive = {"attributes": names | attributes, "indices": corners}
        self.json["meshes"][-1]["primitives"].append(primitive)
        return primitive

    def textured(self) -> int:
        self.json["images"] = [{"bufferView": self.view(make_picture()), "mimeType": "image/png"}]
        self.json["textures"] = [{"source": 0}]
        about = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
        self.json.setdefault("materials", []).append(about)
        return len(self.json["materials"]) - 1

    def node(self, **about: Any) -> int:
        self.json.setdefault("nodes", []).append(about)
        return len(self.json["nodes"]) - 1

    def saved(self, path: Path) -> Path:
        if "nodes" not in self.json:
            self.node(mesh=0)
        if "scenes" not in self.json:
            self.json |= {"scenes": [{"nodes": list(range(len(self.json["nodes"])))}], "scene": 0}
        return self.write(path)


def written(make: Callable[[Model], None]) -> Callable[[Path], Path]:
    def write(path: Path) -> Path:
        model = Model()
        make(model)
        return model.saved(path)

    return write


SHAPE = make_shape(make_solid())
SOFT = make_shape(make_solid(), hard=False)


def textured(model: Model) -> None:
    primitive = model.add(SHAPE, TEXCOORD_0=model.accessor(SHAPE.uv))
    primitive["material"] = model.textured()


def coloured(model: Model) -> None:
    colours = np.column_stack([SHAPE.uv, 1 - SHAPE.uv[:, 0]]).astype("<f4")
    model.add(SHAPE, COLOR_0=model.accessor(colours))


def several(model: Model) -> None:
    """Three primitives, two of which share vertices."""
    model.json["materials"] = [
        {"pbrMetallicRoughness": {"baseColorFactor": [*colour, 1.0]}}
        for colour in ((0.8, 0.2, 0.1), (0.1, 0.5, 0.9))
    ]
    first = model.add(SHAPE)
    first["material"] = 0
    second = model.add(move_shape(SHAPE, 0, 0, 30))
    second |= {"material": 1, "indices": first["indices"]}
    third = model.add(move_shape(make_shape(make_solid(2.0, 4.0)), 0, 30, 0))
    third["material"] = 1


def without_indices(model: Model) -> None:
    """No two triangles share a vertex, so no triangle changes."""
    corners = SHAPE.triangles.reshape(-1)
    about = {
        "POSITION": model.accessor(SHAPE.points[corners]),
        "NORMAL": model.accessor(SHAPE.normals[corners]),
    }
    model.json["meshes"][0]["primitives"].append({"attributes": about})


def strip(model: Model) -> None:
    """A bar as one strip: separate triangles, joined by degenerate triangles."""
    primitive = model.add(SOFT)
    del primitive["attributes"]["NORMAL"]
    rows: list[int] = []
    for a, b, c in SOFT.triangles.tolist():
        rows += [*rows[-1:], *[a, a] * bool(rows), a, b, c]
    primitive |= {"mode": 5, "indices": model.accessor(np.array(rows, "<u2"))}


def fan(model: Model) -> None:
    """A disk of slivers from one vertex; it is open."""
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    points = np.column_stack([9 * np.cos(angles), 7 * np.sin(angles), 0 * angles]).astype("<f4")
    about = {"POSITION": model.accessor(points)}
    model.json["meshes"][0]["primitives"].append({"attributes": about, "mode": 6})


def small_and_large_indices(model: Model) -> None:
    """Indices of one byte, and of four bytes although two would suffice."""
    small = make_shape(make_solid(0.2, 3.0), hard=False)
    primitive = model.add(small, "u1")
    del primitive["attributes"]["NORMAL"]
    model.add(move_shape(make_shape(make_solid(1.3, 5.0)), 12, 0, 0), "<u4")


def quantized(model: Model) -> None:
    """Integer positions, transformed by a node."""
    upright = trimesh.creation.extrude_polygon(
        shapely.Point(0, 0).buffer(900, quad_segs=12).difference(shapely.box(-500, -200, 300, 200)),
        300.0,
        engine="earcut",
    )
    points = np.zeros((len(upright.vertices), 4), "<i2")
    points[:, :3] = np.rint(upright.vertices)
    places = model.accessor(points)
    model.json["accessors"][places]["type"] = "VEC3"
    model.json["bufferViews"][-1]["byteStride"] = 8
    indices = model.accessor(upright.faces.astype("<u2").reshape(-1))
    primitive = {"attributes": {"POSITION": places}, "indices": indices}
    model.json["meshes"][0]["primitives"].append(primitive)
    model.node(mesh=0, scale=[0.01, 0.01, 0.01])
    name = "KHR_mesh_quantization"
    model.json |= {"extensionsUsed": [name], "extensionsRequired": [name]}


def with_variants(model: Model) -> None:
    """Material variants, extras everywhere, and feature identifiers."""
    model.json["materials"] = [{"name": "red"}, {"name": "blue", "extras": {"price": 7}}]
    name = "KHR_materials_variants"
    ids = (SHAPE.facet % 3).astype("<f4")[:, None]
    primitive = model.add(SHAPE, _FEATURE_ID_0=model.accessor(ids))
    mappings = {"mappings": [{"material": 1, "variants": [0]}]}
    primitive |= {"material": 0, "extensions": {name: mappings}, "extras": {"id": "wall-7"}}
    model.json["extensions"] = {name: {"variants": [{"name": "night"}]}}
    model.json |= {"extensionsUsed": [name], "extras": {"by": ["us"]}}


def with_data_uri(path: Path) -> Path:
    return _as_gltf(path, lambda data: "data:application/octet-stream;base64," + data)


def with_buffer_file(path: Path) -> Path:
    file = path.with_suffix(".bin")

    def write_buffer(data: str) -> str:
        file.write_bytes(base64.b64decode(data))
        return file.name

    return _as_gltf(path, write_buffer)


def _as_gltf(path: Path, store: Callable[[str], str]) -> Path:
    binary = written(coloured)(path.with_suffix(".glb"))
    document, data = split_glb(binary.read_bytes())
    content = data[: document["buffers"][0]["byteLength"]]
    document["buffers"][0]["uri"] = store(base64.b64encode(content).decode())
    path.write_text(json.dumps(document, indent=1))
    binary.unlink()
    return path


def plain(path: Path) -> Path:
    make_solid().export(path)
    return path


MODELS: dict[str, Callable[[Path], Path]] = {
    "plain.glb": plain,
    "textured.glb": written(textured),
    "coloured.glb": written(coloured),
    "several.glb": written(several),
    "no-indices.glb": written(without_indices),
    "strip.glb": written(strip),
    "fan.glb": written(fan),
    "few.glb": written(small_and_large_indices),
    "quantized.glb": written(quantized),
    "variants.glb": written(with_variants),
    "plain.gltf": with_data_uri,
    "beside.gltf": with_buffer_file,
    "plain.obj": plain,
}
