import numpy as np
import pytest
import trimesh

from harness.frame import get_scene_view, make_scene_frame
from harness.models import views
from harness.models.flat_faces import ModelMesh
from harness.models.gltf import GltfModel
from harness.models.in_place import open_model, retriangulate
from harness.models.seen import read
from harness.models.views import DISTANCE, VIEWS, find_bounding_sphere
from harness.rasterisers.reference import count_per_triangle
from harness.triangulating.carrying import make_original_triangulation
from tests.conftest import require_ok
from tests.models.build import KITE, LONG, Builder
from tests.models.various import make_solid

SHORT = np.array([(0, 1, 3), (1, 2, 3)])


def mesh_of(points: np.ndarray, triangles: np.ndarray) -> ModelMesh:
    none = np.empty((len(points), 0))
    return ModelMesh(points.astype(float), triangles, none, none, 1e-6)


def test_placements_are_counted_together(monkeypatch):
    """Of 40 placements, some mirrored: few calls, so that thousands do not take minutes."""
    mesh = mesh_of(KITE, LONG)
    matrices = []
    for number in range(40):
        matrix = np.eye(4)
        matrix[:3, 3] = (number % 7, number // 7, 0.1 * number)
        matrix[2, 2] = -1.0 if number % 3 == 0 else 1.0
        matrices.append(matrix)
    parts = [views.DrawnPart(mesh, SHORT, tuple(matrices))]
    calls: list[int] = []

    def counted(*arguments):
        calls.append(1)
        return count_per_triangle(*arguments)

    monkeypatch.setattr(views, "count_per_triangle", counted)
    together, ticks = views.count_views(parts, (256,), calls.append), len(calls)
    assert ticks <= views.VIEWS * 4
    monkeypatch.setattr(views, "_CHUNK_TRIANGLES", 1)
    assert views.count_views(parts, (256,)) == together
    assert len(calls) > 10 * ticks


def test_a_mirror_reverses_front_faces(monkeypatch):
    monkeypatch.setattr(views, "list_directions", lambda: np.array([[0.0, 0.6, 0.8]]))
    mesh, mirror = mesh_of(KITE, LONG), np.diag([1.0, -1.0, 1.0, 1.0])
    plain = views.count_views([views.DrawnPart(mesh, SHORT, (np.eye(4),))])
    mirrored = views.count_views([views.DrawnPart(mesh, SHORT, (mirror,))])
    for one, other in zip(plain, mirrored, strict=True):
        # a kite equals its mirror image, and shows the same side
        assert one.before[1] > 0
        assert other.before[1] == pytest.approx(one.before[1], rel=0.02)


def test_empty_models_have_no_views():
    nowhere = np.full((3, 3), np.nan)
    mesh = mesh_of(nowhere, np.array([(0, 1, 2)]))
    assert views.count_views([]) == []
    assert views.count_views([views.DrawnPart(mesh, mesh.triangles, (np.eye(4),))]) == []


def test_node_placements_agree_with_trimesh(tmp_path):
    builder = Builder(KITE, LONG)
    turned = trimesh.transformations.quaternion_about_axis(0.7, [1, 2, 3])
    w, x, y, z = turned.tolist()
    builder.json["nodes"] = [
        {"children": [1, 2], "rotation": [x, y, z, w], "scale": [1, 2, 3]},
        {"mesh": 0, "translation": [5, 6, 7]},
        {"mesh": 0, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 3, 4, 5, 1]},
    ]
    builder.json["scenes"] = [{"nodes": [0]}]
    path = builder.write(tmp_path / "nodes.glb")
    ((part,),) = GltfModel(path).iterate_groups()
    ours = [views.transform_points(part.mesh.positions, matrix) for matrix in part.placements]
    read = trimesh.load_scene(path)
    expected = [geometry.vertices for geometry in read.dump()]
    order = sorted(points.sum() for points in ours), sorted(p.sum() for p in expected)
    assert len(ours) == 2
    assert np.allclose(*order)
    assert np.allclose(np.sort(np.vstack(ours), axis=0), np.sort(np.vstack(expected), axis=0))


def test_unchanged_models_are_not_counted(tmp_path, harness, monkeypatch):
    monkeypatch.setattr("harness.models.in_place.count_views", None)
    trimesh.creation.icosphere(2).export(tmp_path / "ball.glb")
    output, _ = require_ok(harness("triangulate", "ball.glb", "--check"))
    assert "no change: no flat face" in output


@pytest.fixture(scope="module")
def plates(tmp_path_factory):
    """A plate, the plate with shorter diagonals, and the reduction of their length."""
    folder = tmp_path_factory.mktemp("law")
    before, after = folder / "before.glb", folder / "after.glb"
    make_solid().export(before)
    done = retriangulate(before, after)
    return before, after, done.before - done.after


def compute_savings(plates, pixels: int) -> tuple[float, float, float]:
    """Return the helper lanes saved by E, by Q of each view, and as counted."""
    before, after, shorter = plates
    lanes = []
    for path in (before, after):
        scene = read(str(path), pixels=pixels)
        frame = make_scene_frame(scene, get_scene_view(scene))
        original = make_original_triangulation(frame)
        totals = {name: values.sum() for name, values in original.predicted.items()}
        counts = count_per_triangle(frame.points, frame.join_triangles(original.parts))
        counted = int(counts["helper_lanes"].sum())
        lanes.append((4 * totals["expected_quads"] - totals["area"], counted))
    (part,) = [part for group in open_model(before)[1] for part in group]
    ball = find_bounding_sphere([part.mesh.positions])
    scale = pixels * np.sqrt(DISTANCE**2 - 1) / (2 * ball.radius * DISTANCE)
    # `shorter` counts each diagonal twice, as a side of two triangles
    by_e = VIEWS / 2 * scale * (shorter / 2)
    by_q, counted = np.subtract(*lanes)
    return by_e, by_q, counted


def test_e_predicts_savings_for_slivers_of_some_pixels(plates):
    by_e, by_q, counted = compute_savings(plates, 1024)
    assert by_e == pytest.approx(counted, rel=0.1)
    assert by_q == pytest.approx(counted, rel=0.02)


def test_only_q_predicts_savings_of_small_models(plates):
    by_e, by_q, counted = compute_savings(plates, 16)
    assert by_e > 3 * counted > 0
    assert by_q == pytest.approx(counted, rel=0.05)
