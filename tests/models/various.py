"""Thirty models in five formats, with all that a model carries, made by small code.

Each has flat faces that ear clipping cut into slivers. All are closed but where a comment says so.
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

from tests.models.build import Builder, parts_of

TARGETS = {"indices": 34963, "attributes": 34962}


class Shape(NamedTuple):
    """points (n, 3) float32, normals (n, 3), uv (n, 2), triangles (m, 3), facet of each vertex."""

    points: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    triangles: np.ndarray
    facet: np.ndarray


def solid(turn: float = 0.7, size: float = 10.0) -> trimesh.Trimesh:
    """A plate with a round hole and a slot, askew."""
    shape = shapely.Point(0, 0).buffer(size, quad_segs=8)
    shape = shape.difference(shapely.Point(0.2 * size, 0.1 * size).buffer(0.3 * size, quad_segs=8))
    shape = shape.difference(shapely.box(-0.6 * size, -0.2 * size, -0.4 * size, 0.2 * size))
    made = trimesh.creation.extrude_polygon(shape, 0.2 * size, engine="earcut")
    made.apply_transform(trimesh.transformations.rotation_matrix(turn, [1, 2, 3]))
    return made


def shape_of(mesh: trimesh.Trimesh, *, hard: bool = True) -> Shape:
    """Return a mesh with an affine map on each face; `hard`: each face has vertices of its own."""
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


def moved(shape: Shape, *by: float) -> Shape:
    """Return a shape elsewhere: where two cut into each other, their order decides a pixel."""
    return shape._replace(points=shape.points + np.float32(by))


def picture() -> bytes:
    """A PNG of colours that change slowly, so that a place that is a little off shows little."""
    ramp = np.linspace(0, 255, 64)
    red, green = np.meshgrid(ramp, ramp)
    pixels = np.stack([red, green, 255 - red], axis=2).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


class Model(Builder):
    """A glTF model whose accessors say all that a validator asks for."""

    def values(self, array: np.ndarray, *, normalized: bool = False) -> int:
        number = self.accessor(np.ascontiguousarray(array), normalized)
        self.json["bufferViews"][-1]["target"] = TARGETS["attributes"]
        return number

    def places(self, array: np.ndarray) -> int:
        number = self.values(array)
        self.json["accessors"][number]["min"] = array.min(axis=0).tolist()
        self.json["accessors"][number]["max"] = array.max(axis=0).tolist()
        return number

    def corners(self, triangles: np.ndarray, kind: str = "<u2") -> int:
        number = self.accessor(np.asarray(triangles, kind).reshape(-1))
        self.json["bufferViews"][-1]["target"] = TARGETS["indices"]
        return number

    def add(self, shape: Shape, kind: str = "<u2", **attributes: int) -> dict[str, Any]:
        """Add a primitive of positions, normals and more."""
        about = {"POSITION": self.places(shape.points), "NORMAL": self.values(shape.normals)}
        made = {"attributes": about | attributes, "indices": self.corners(shape.triangles, kind)}
        self.json["meshes"][-1]["primitives"].append(made)
        return made

    def textured(self) -> int:
        """Add a material with a texture; returns its number."""
        self.json["images"] = [{"bufferView": self.view(picture()), "mimeType": "image/png"}]
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
    """Return what writes the model that a function fills."""

    def write(path: Path) -> Path:
        model = Model()
        make(model)
        return model.saved(path)

    return write


SHAPE = shape_of(solid())
SOFT = shape_of(solid(), hard=False)


def textured(model: Model) -> None:
    primitive = model.add(SHAPE, TEXCOORD_0=model.values(SHAPE.uv))
    primitive["material"] = model.textured()


def two_maps(model: Model) -> None:
    """A second map in normalized whole numbers, which is affine only up to its last bit."""
    whole = np.rint(SHAPE.uv * 65535).astype("<u2")
    maps = {
        "TEXCOORD_0": model.values(SHAPE.uv),
        "TEXCOORD_1": model.values(whole, normalized=True),
    }
    model.add(SHAPE, **maps)["material"] = model.textured()


def coloured(model: Model) -> None:
    colours = np.column_stack([SHAPE.uv, 1 - SHAPE.uv[:, 0]]).astype("<f4")
    model.add(SHAPE, COLOR_0=model.values(colours))


def with_tangents(model: Model) -> None:
    along = np.cross(SHAPE.normals, [0.3, 0.5, 0.8])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    tangents = np.column_stack([along, np.ones(len(along))]).astype("<f4")
    made = {"TANGENT": model.values(tangents), "TEXCOORD_0": model.values(SHAPE.uv)}
    model.add(SHAPE, **made)["material"] = model.textured()


def skinned(model: Model) -> None:
    """Two plates, each moved by a bone of its own."""
    other = shape_of(solid(1.1, 6.0))
    points = np.vstack([SHAPE.points, other.points + np.float32([25, 0, 0])])
    count, whole = len(SHAPE.points), len(points)
    both = Shape(
        points,
        np.vstack([SHAPE.normals, other.normals]),
        np.vstack([SHAPE.uv, other.uv]),
        np.vstack([SHAPE.triangles, other.triangles + count]),
        np.zeros(whole),
    )
    joints = np.zeros((whole, 4), "u1")
    joints[count:, 0] = 1
    weights = np.zeros((whole, 4), "<f4")
    weights[:, 0] = 1.0
    model.add(both, JOINTS_0=model.values(joints), WEIGHTS_0=model.values(weights))
    matrices = model.view(np.tile(np.eye(4, dtype="<f4"), (2, 1, 1)).tobytes())
    inverse = len(model.json["accessors"])
    about = {"bufferView": matrices, "componentType": 5126, "count": 2, "type": "MAT4"}
    model.json["accessors"].append(about)
    bones = [model.node(name="one", children=[1]), model.node(name="two")]
    body = model.node(mesh=0, skin=0)
    model.json["skins"] = [{"joints": bones, "inverseBindMatrices": inverse}]
    model.json |= {"scenes": [{"nodes": [bones[0], body]}], "scene": 0}


def morphed(model: Model) -> None:
    """A target that shears all, and one that moves places and normals."""
    primitive = model.add(SHAPE)
    shear = np.column_stack(
        [SHAPE.points[:, 1] / 4, SHAPE.points[:, 2] / 8, SHAPE.points[:, 0] / 2]
    )
    shifted, tilted = np.full_like(SHAPE.points, 0.5), np.full_like(SHAPE.normals, 0.1)
    primitive["targets"] = [
        {"POSITION": model.places(shear.astype("<f4"))},
        {"POSITION": model.places(shifted), "NORMAL": model.values(tilted)},
    ]
    model.json["meshes"][0]["weights"] = [0.25, 0.0]


def several(model: Model) -> None:
    """Three primitives, two of which share their corners."""
    model.json["materials"] = [
        {"pbrMetallicRoughness": {"baseColorFactor": [*colour, 1.0]}}
        for colour in ((0.8, 0.2, 0.1), (0.1, 0.5, 0.9))
    ]
    first = model.add(SHAPE)
    first["material"] = 0
    second = model.add(moved(SHAPE, 0, 0, 30))
    second |= {"material": 1, "indices": first["indices"]}
    third = model.add(moved(shape_of(solid(2.0, 4.0)), 0, 30, 0))
    third["material"] = 1


def instanced(model: Model) -> None:
    """One mesh in four places, one of them a mirror image, below a turned node."""
    model.add(SHAPE)
    places = [model.node(mesh=0, translation=[30.0 * k, 0.0, 0.0]) for k in range(3)]
    places.append(model.node(mesh=0, translation=[0.0, 30.0, 0.0], scale=[-1.0, 1.0, 1.0]))
    above = model.node(children=places, rotation=[0.0, 0.6, 0.0, 0.8])
    model.json |= {"scenes": [{"nodes": [above]}], "scene": 0}


def instanced_by_extension(model: Model) -> None:
    model.add(SHAPE)
    places = model.values(np.array([(0, 0, 0), (30, 0, 0)], "<f4"))
    del model.json["bufferViews"][-1]["target"]
    name = "EXT_mesh_gpu_instancing"
    model.node(mesh=0, extensions={name: {"attributes": {"TRANSLATION": places}}})
    model.json |= {"extensionsUsed": [name]}


def animated(model: Model) -> None:
    model.add(SHAPE)
    times = model.accessor(np.array([0, 1], "<f4"))
    model.json["accessors"][times] |= {"min": [0.0], "max": [1.0]}
    moves = model.accessor(np.array([(0, 0, 0), (5, 0, 0)], "<f4"))
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    model.json["animations"] = [
        {"channels": [channel], "samplers": [{"input": times, "output": moves}]}
    ]


def without_indices(model: Model) -> None:
    """Each corner a vertex of its own: no two triangles share one, so all stays."""
    corners = SHAPE.triangles.reshape(-1)
    about = {
        "POSITION": model.places(SHAPE.points[corners]),
        "NORMAL": model.values(SHAPE.normals[corners]),
    }
    model.json["meshes"][0]["primitives"].append({"attributes": about})


def strip(model: Model) -> None:
    """A bar as one strip: each triangle by itself, joined by triangles without area."""
    primitive = model.add(SOFT)
    del primitive["attributes"]["NORMAL"]
    rows: list[int] = []
    for a, b, c in SOFT.triangles.tolist():
        rows += [*rows[-1:], *[a, a] * bool(rows), a, b, c]
    primitive |= {"mode": 5, "indices": model.corners(np.array(rows))}


def fan(model: Model) -> None:
    """A disk of slivers, from one corner: it is open."""
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    points = np.column_stack([9 * np.cos(angles), 7 * np.sin(angles), 0 * angles]).astype("<f4")
    about = {"POSITION": model.places(points)}
    model.json["meshes"][0]["primitives"].append({"attributes": about, "mode": 6})


def sparse(model: Model) -> None:
    """Positions of which some are replaced."""
    primitive = model.add(SHAPE)
    rows = np.arange(5, dtype="<u2")
    about = model.json["accessors"][primitive["attributes"]["POSITION"]]
    about["sparse"] = {
        "count": 5,
        "indices": {"bufferView": model.view(rows.tobytes()), "componentType": 5123},
        "values": {"bufferView": model.view(SHAPE.points[:5].tobytes())},
    }


def sheet(model: Model) -> None:
    """A plate without thickness, one side on the other: new diagonals would hang together."""
    top = trimesh.creation.triangulate_polygon(
        shapely.Point(0, 0).buffer(9).difference(shapely.box(-5, -2, 4, 3)), engine="earcut"
    )
    points = np.column_stack([top[0], 0 * top[0][:, 0]]).astype("<f4")
    rows = np.vstack([top[1], top[1][:, ::-1]])
    about = {"POSITION": model.places(points)}
    made = {"attributes": about, "indices": model.corners(rows)}
    model.json["meshes"][0]["primitives"].append(made)


def few(model: Model) -> None:
    """Indices of one byte, and others of four, though two would do."""
    small = shape_of(solid(0.2, 3.0), hard=False)
    primitive = model.add(small, "u1")
    del primitive["attributes"]["NORMAL"]
    model.add(moved(shape_of(solid(1.3, 5.0)), 12, 0, 0), "<u4")


def many(model: Model) -> None:
    """More vertices than two bytes name; most are used by nothing."""
    unused = np.zeros((65_536, 3), "<f4")
    points = np.vstack([unused, SHAPE.points])
    normals = np.vstack([unused + np.float32([0, 0, 1]), SHAPE.normals])
    rows = SHAPE.triangles + len(unused)
    model.add(SHAPE._replace(points=points, normals=normals, triangles=rows), "<u4")


def quantized(model: Model) -> None:
    """Positions in whole numbers, placed by a node."""
    upright = trimesh.creation.extrude_polygon(
        shapely.Point(0, 0).buffer(900, quad_segs=12).difference(shapely.box(-500, -200, 300, 200)),
        300.0,
        engine="earcut",
    )
    points = np.zeros((len(upright.vertices), 4), "<i2")
    points[:, :3] = np.rint(upright.vertices)
    places = model.accessor(points)
    about = model.json["accessors"][places]
    about |= {"type": "VEC3", "min": points[:, :3].min(axis=0).tolist()}
    about["max"] = points[:, :3].max(axis=0).tolist()
    model.json["bufferViews"][-1] |= {"byteStride": 8, "target": TARGETS["attributes"]}
    made = {"attributes": {"POSITION": places}, "indices": model.corners(upright.faces)}
    model.json["meshes"][0]["primitives"].append(made)
    model.node(mesh=0, scale=[0.01, 0.01, 0.01])
    name = "KHR_mesh_quantization"
    model.json |= {"extensionsUsed": [name], "extensionsRequired": [name]}


def with_variants(model: Model) -> None:
    """Materials to choose from, extras everywhere, and identifiers of features."""
    model.json["materials"] = [{"name": "red"}, {"name": "blue", "extras": {"price": 7}}]
    name = "KHR_materials_variants"
    ids = (SHAPE.facet % 3).astype("<f4")[:, None]
    primitive = model.add(SHAPE, _FEATURE_ID_0=model.values(ids))
    chosen = {"mappings": [{"material": 1, "variants": [0]}]}
    primitive |= {"material": 0, "extensions": {name: chosen}, "extras": {"id": "wall-7"}}
    model.json["extensions"] = {name: {"variants": [{"name": "night"}]}}
    model.json |= {"extensionsUsed": [name], "extras": {"by": ["us"]}}


def with_data_uri(path: Path) -> Path:
    """A .gltf that holds its buffer."""
    return _as_gltf(path, lambda data: "data:application/octet-stream;base64," + data)


def with_buffer_beside(path: Path) -> Path:
    made = path.with_suffix(".bin")

    def beside(data: str) -> str:
        made.write_bytes(base64.b64decode(data))
        return made.name

    return _as_gltf(path, beside)


def _as_gltf(path: Path, place: Callable[[str], str]) -> Path:
    binary = written(coloured)(path.with_suffix(".glb"))
    told, data = parts_of(binary.read_bytes())
    content = data[: told["buffers"][0]["byteLength"]]
    told["buffers"][0]["uri"] = place(base64.b64encode(content).decode())
    path.write_text(json.dumps(told, indent=1))
    binary.unlink()
    return path


def textured_obj(path: Path) -> Path:
    """With a material, a map, normals and groups; some faces are named from the end."""
    path.with_suffix(".png").write_bytes(picture())
    path.with_suffix(".mtl").write_text(f"newmtl skin\nKd 1 1 1\nmap_Kd {path.stem}.png\n")
    lines = ["# a plate", f"mtllib {path.stem}.mtl", "o plate"]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in SHAPE.points.tolist()]
    lines += [f"vt {u:.6f} {v:.6f}" for u, v in SHAPE.uv.tolist()]
    lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in SHAPE.normals.tolist()]
    lines += ["usemtl skin", "g walls"]
    count = len(SHAPE.points)
    for number, row in enumerate(SHAPE.triangles.tolist()):
        names = [k + 1 if number % 2 else k - count for k in row]
        lines.append("f " + " ".join(f"{k}/{k}/{k}" for k in names))
    path.write_text("\n".join(lines) + "\n")
    return path


def grouped_obj(path: Path) -> Path:
    """Two materials on faces that touch."""
    mesh = solid()
    top = np.isin(np.arange(len(mesh.faces)), mesh.facets[0])
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in mesh.vertices.tolist()]
    for name, rows in (("top", mesh.faces[top]), ("rest", mesh.faces[~top])):
        lines += [f"usemtl {name}"]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in rows.tolist()]
    path.write_text("\n".join(lines) + "\n")
    return path


def plain(path: Path) -> Path:
    solid().export(path)
    return path


MODELS: dict[str, Callable[[Path], Path]] = {
    "plain.glb": plain,
    "textured.glb": written(textured),
    "two-maps.glb": written(two_maps),
    "coloured.glb": written(coloured),
    "tangents.glb": written(with_tangents),
    "skinned.glb": written(skinned),
    "morphed.glb": written(morphed),
    "several.glb": written(several),
    "instanced.glb": written(instanced),
    "instanced-by-extension.glb": written(instanced_by_extension),
    "animated.glb": written(animated),
    "no-indices.glb": written(without_indices),
    "strip.glb": written(strip),
    "fan.glb": written(fan),
    "sparse.glb": written(sparse),
    "sheet.glb": written(sheet),
    "few.glb": written(few),
    "many.glb": written(many),
    "quantized.glb": written(quantized),
    "variants.glb": written(with_variants),
    "plain.gltf": with_data_uri,
    "beside.gltf": with_buffer_beside,
    "plain.obj": plain,
    "textured.obj": textured_obj,
    "grouped.obj": grouped_obj,
}
