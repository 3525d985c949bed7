"""Models seen from all around: where the camera stands, and what is counted."""

import numpy as np
import pytest
import trimesh

from harness.frame import frame_of, view_of
from harness.models import views
from harness.models.flat_faces import ModelMesh
from harness.models.gltf import GltfModel
from harness.models.in_place import open_model, retriangulate
from harness.models.seen import read
from harness.models.views import DISTANCE, VIEWS, ball_of
from harness.rasterisers.reference import predict
from harness.triangulating.carrying import original_triangulation
from tests.conftest import require_ok
from tests.models.build import KITE, LONG, Builder
from tests.models.various import solid

SHORT = np.array([(0, 1, 3), (1, 2, 3)])


def mesh_of(points: np.ndarray, triangles: np.ndarray) -> ModelMesh:
    none = np.empty((len(points), 0))
    return ModelMesh(points.astype(float), triangles, none, none, 1e-6)


def test_directions_are_all_around():
    found = views.directions()
    assert found.shape == (views.VIEWS, 3)
    assert np.allclose(np.linalg.norm(found, axis=1), 1)
    assert np.allclose(found.sum(axis=0), 0)
    assert len({tuple(np.round(row, 9)) for row in found}) == views.VIEWS
    assert np.allclose(found.T @ found, np.eye(3) * views.VIEWS / 3)  # as even as a sphere's


def test_places_are_looked_at_together_as_one_by_one(monkeypatch):
    """Of 40 places, some mirrored: in a few calls, so that thousands do not take minutes."""
    mesh = mesh_of(KITE, LONG)
    matrices = []
    for number in range(40):
        matrix = np.eye(4)
        matrix[:3, 3] = (number % 7, number // 7, 0.1 * number)
        matrix[2, 2] = -1.0 if number % 3 == 0 else 1.0
        matrices.append(matrix)
    parts = [views.Drawn(mesh, SHORT, tuple(matrices))]
    calls: list[int] = []

    def counted(*arguments):
        calls.append(1)
        return predict(*arguments)

    monkeypatch.setattr(views, "predict", counted)
    together, ticks = views.look(parts, (256,), calls.append), len(calls)
    assert ticks <= views.VIEWS * 4
    monkeypatch.setattr(views, "_CHUNK_TRIANGLES", 1)
    assert views.look(parts, (256,)) == together
    assert len(calls) > 10 * ticks


def test_a_sphere_fills_the_picture_and_no_more():
    points = trimesh.creation.icosphere(4).vertices
    for direction in views.directions():
        flat, _ = views.projected(points, direction)
        assert flat.min() >= 0
        assert flat.max() <= 1
        assert np.ptp(flat, axis=0).min() > 0.99


def test_a_mirror_turns_front_faces_round(monkeypatch):
    monkeypatch.setattr(views, "directions", lambda: np.array([[0.0, 0.6, 0.8]]))
    mesh, mirror = mesh_of(KITE, LONG), np.diag([1.0, -1.0, 1.0, 1.0])
    plain = views.look([views.Drawn(mesh, SHORT, (np.eye(4),))])
    mirrored = views.look([views.Drawn(mesh, SHORT, (mirror,))])
    for one, other in zip(plain, mirrored, strict=True):
        # a kite is its own mirror image, and shows the same side
        assert one.before[1] > 0
        assert other.before[1] == pytest.approx(one.before[1], rel=0.02)


def test_nothing_has_no_views():
    nowhere = np.full((3, 3), np.nan)
    mesh = mesh_of(nowhere, np.array([(0, 1, 2)]))
    assert views.look([]) == []
    assert views.look([views.Drawn(mesh, mesh.triangles, (np.eye(4),))]) == []


def test_nodes_place_a_mesh_as_others_read_it(tmp_path):
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
    ((part,),) = GltfModel(path).groups()
    ours = [views.placed(part.mesh.positions, matrix) for matrix in part.placements]
    read = trimesh.load_scene(path)
    theirs = [each.vertices for each in read.dump()]
    order = sorted(points.sum() for points in ours), sorted(p.sum() for p in theirs)
    assert len(ours) == 2
    assert np.allclose(*order)
    assert np.allclose(np.sort(np.vstack(ours), axis=0), np.sort(np.vstack(theirs), axis=0))


def test_where_nothing_changes_nothing_is_looked_at(tmp_path, harness, monkeypatch):
    monkeypatch.setattr("harness.models.in_place.look", None)
    trimesh.creation.icosphere(2).export(tmp_path / "ball.glb")
    told, _ = require_ok(harness("triangulate", "ball.glb", "--check"))
    assert "no change: no flat face" in told


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """A plate, the same with shorter diagonals, and by how much they are shorter."""
    folder = tmp_path_factory.mktemp("law")
    before, after = folder / "before.glb", folder / "after.glb"
    solid().export(before)
    done = retriangulate(before, after)
    return before, after, done.before - done.after


def expected_and_counted(both, pixels: int) -> tuple[float, float, float]:
    """Return helper lanes saved by E, by Q of each view, and as they are counted."""
    before, after, shorter = both
    lanes = []
    for path in (before, after):
        scene = read(str(path), pixels=pixels)
        frame = frame_of(scene, view_of(scene))
        found = original_triangulation(frame)
        totals = {name: each.sum() for name, each in found.predicted.items()}
        counted = predict(frame.points, frame.join(found.parts))["helper_lanes"].sum()
        lanes.append((4 * totals["expected_quads"] - totals["area"], int(counted)))
    (part,) = [part for group in open_model(before)[1] for part in group]
    ball = ball_of([part.mesh.positions])
    scale = pixels * np.sqrt(DISTANCE**2 - 1) / (2 * ball.radius * DISTANCE)
    # `shorter` has each diagonal twice, as a side of two triangles
    by_e = VIEWS / 2 * scale * (shorter / 2)
    by_q, counted = np.subtract(*lanes)
    return by_e, by_q, counted


def test_e_expects_what_is_saved_where_slivers_are_some_pixels_high(both):
    by_e, by_q, counted = expected_and_counted(both, 1024)
    assert by_e == pytest.approx(counted, rel=0.1)
    assert by_q == pytest.approx(counted, rel=0.02)


def test_of_a_small_model_q_alone_is_right(both):
    by_e, by_q, counted = expected_and_counted(both, 16)
    assert by_e > 3 * counted > 0
    assert by_q == pytest.approx(counted, rel=0.05)
