"""Models seen from all around: where the camera stands, and what is counted."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from harness.models import views
from harness.models.flat_faces import Mesh
from harness.models.gltf import GltfModel
from harness.rasterisers.reference import predict
from tests.models.build import KITE, LONG, Builder
from tests.models.test_in_place import plate

SHORT = np.array([(0, 1, 3), (1, 2, 3)])


def mesh_of(points: np.ndarray, triangles: np.ndarray) -> Mesh:
    none = np.empty((len(points), 0))
    return Mesh(points.astype(float), triangles, none, none, 1e-6)


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
    monkeypatch.setattr(views, "_AT_A_TIME", 1)
    assert views.look(parts, (256,)) == together
    assert len(calls) > 10 * ticks


def test_a_sphere_fills_the_picture_and_no_more():
    points = trimesh.creation.icosphere(4).vertices
    for direction in views.directions():
        flat, _ = views.projected(points, direction)
        assert flat.min() >= 0
        assert flat.max() <= 1
        assert np.ptp(flat, axis=0).min() > 0.99


def test_counts_are_those_of_the_front_faces(monkeypatch):
    """One direction, by hand: the camera looks down on a kite, which fills the picture."""
    monkeypatch.setattr(views, "directions", lambda: np.array([[0.0, 1e-9, 1.0]]))
    mesh = mesh_of(KITE, LONG)
    seen = views.look([views.Drawn(mesh, SHORT, (np.eye(4),))])
    radius = np.hypot(4.5, 0.0)
    for found in seen:
        grid = np.rint(
            views.projected((KITE - [4.5, 0, 0]) / radius, np.array([0.0, 1e-9, 1.0]))[0]
            * found.pixels
            * 256
        ).astype(np.int32)
        wanted = [predict(grid, each.astype(np.int32)) for each in (LONG, SHORT)]
        assert found.lanes_before == wanted[0]["helper_lanes"].sum() > 0
        assert found.lanes_after == wanted[1]["helper_lanes"].sum()
        assert found.quads_before == wanted[0]["quads"].sum()
        assert found.quads_after == wanted[1]["quads"].sum()
    below = views.look([views.Drawn(mesh_of(KITE, LONG[:, ::-1]), SHORT[:, ::-1], (np.eye(4),))])
    assert all(found.quads_before == found.quads_after == 0 for found in below)


def test_a_mirror_turns_front_faces_round(monkeypatch):
    monkeypatch.setattr(views, "directions", lambda: np.array([[0.0, 0.6, 0.8]]))
    mesh, mirror = mesh_of(KITE, LONG), np.diag([1.0, -1.0, 1.0, 1.0])
    plain = views.look([views.Drawn(mesh, SHORT, (np.eye(4),))])
    mirrored = views.look([views.Drawn(mesh, SHORT, (mirror,))])
    for one, other in zip(plain, mirrored, strict=True):
        # a kite is its own mirror image, and shows the same side
        assert one.quads_before > 0
        assert other.quads_before == pytest.approx(one.quads_before, rel=0.02)


def test_nothing_has_no_views():
    nowhere = np.full((3, 3), np.nan)
    mesh = mesh_of(nowhere, np.array([(0, 1, 2)]))
    assert views.look([]) == []
    assert views.look([views.Drawn(mesh, mesh.triangles, (np.eye(4),))]) == []


def test_nodes_place_a_mesh_as_others_read_it(tmp_path):
    builder = Builder()
    builder.primitive(KITE, LONG)
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


def test_check_tells_what_is_seen(tmp_path, harness):
    plate().export(tmp_path / "plate.glb")
    _, told, _ = harness("triangulate", "plate.glb", "--check")
    lines = [line for line in told.splitlines() if line.startswith("seen from 24 sides")]
    assert [line.split(" px")[0].split()[-1] for line in lines] == ["256", "1024"]
    assert all("helper lanes -" in line and "quads -" in line for line in lines)


def test_where_nothing_changes_nothing_is_looked_at(tmp_path, harness, monkeypatch):
    monkeypatch.setattr("harness.models.in_place.look", None)
    trimesh.creation.icosphere(2).export(tmp_path / "ball.glb")
    code, told, _ = harness("triangulate", "ball.glb", "--check")
    assert code == 0
    assert "nothing to gain" in told
