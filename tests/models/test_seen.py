"""A model in space as a scene: faces in their planes, and the pieces of each view."""

import hashlib
import itertools
import re

import numpy as np
import pytest
import shapely
import trimesh

from harness.frame import Frame, get_scene_view, make_scene_frame
from harness.models import views
from harness.models.in_place import open_model, retriangulate
from harness.models.seen import read
from harness.rasterisers import Options
from harness.rasterisers.base import order_submission
from harness.rasterisers.reference import count_per_triangle
from harness.triangulating.carrying import carry_to_views, make_original_triangulation
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import FrameTriangulation, triangulate_polygons
from scenes import Scene, SceneError
from tests.models.build import KITE, LONG, Builder
from tests.models.various import make_solid
from tests.scenes.conftest import assert_valid_polygons


def framed(scene: Scene) -> Frame:
    return make_scene_frame(scene, get_scene_view(scene))


def join_original(frame: Frame) -> np.ndarray:
    return frame.join_triangles(make_original_triangulation(frame).parts)


@pytest.fixture(scope="module")
def plate_file(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("models") / "plate.glb"
    make_solid().export(path)
    return str(path)


def built(builder: Builder, path) -> str:
    return str(builder.write(path / "model.glb"))


def test_loose_triangles_have_the_counters_that_check_reports(tmp_path):
    """`run` and `triangulate --check` count the same images by different code."""
    path = tmp_path / "ball.glb"
    trimesh.creation.icosphere(2).export(path)
    _, groups = open_model(path)
    parts = [part for group in groups for part in group]
    drawn = [views.DrawnPart(part.mesh, part.mesh.triangles, part.placements) for part in parts]
    (counts,) = views.count_views(drawn, (256,))
    frame = framed(read(str(path), pixels=256))
    counted = count_per_triangle(frame.points, join_original(frame))
    assert counted["helper_lanes"].sum() == counts.before[0] > 0
    assert counted["quads"].sum() == counts.before[1]


def perforated() -> trimesh.Trimesh:
    """A plate whose square holes are in line, so that earcut leaves vertices on edges."""
    shape = shapely.box(0, 0, 40, 12)
    for x, y in itertools.product(range(5, 40, 6), (4, 8)):
        shape = shape.difference(shapely.box(x - 1, y - 1, x + 1, y + 1))
    return trimesh.creation.extrude_polygon(shape, 2.0, engine="earcut")


@pytest.mark.parametrize("pieces", [perforated, make_solid])
def test_a_run_draws_the_triangles_that_triangulate_writes(tmp_path, pieces):
    """Also if a face's outline touches itself, so that the face is not a valid polygon."""
    path = tmp_path / "model.glb"
    pieces().export(path)
    (counts,) = retriangulate(path, None, sizes=(256,)).views
    scene = read(str(path), pixels=256)
    frame, recipe = framed(scene), parse("optimal:edge-length")
    assert bool(scene.viewing.invalid_faces) == (pieces is perforated)
    done = carry_to_views(frame, triangulate_polygons(recipe, frame.flat.polygons), recipe)
    for parts, lanes, quads in (
        (make_original_triangulation(frame).parts, *counts.before),
        (done.parts, *counts.after),
    ):
        counted = count_per_triangle(frame.points, frame.join_triangles(parts))
        assert counted["helper_lanes"].sum() == lanes
        assert counted["quads"].sum() == quads
    assert counts.after[0] < 0.95 * counts.before[0]
    unproven = np.isinf(done.gaps)
    assert (unproven == (scene.viewing.source > len(scene.polygons))).all()
    fans = triangulate_polygons(parse("fan"), frame.flat.polygons)
    carried = carry_to_views(frame, fans, parse("fan"))
    for piece, rows in scene.viewing.other_triangles.items():
        assert np.array_equal(carried.parts[piece], rows)


def test_notes_have_the_area_outside_polygons(tmp_path):
    path = tmp_path / "model.glb"
    model = perforated()
    model.export(path)
    (note,) = read(str(path), views=2).notes
    share = 2 * (40 * 12 - 12 * 4) / model.area  # of both sides
    assert f"{1 - share:.0%} of the area; {share:.0%} of the area in faces that are not" in note
    trimesh.util.concatenate([perforated(), trimesh.creation.icosphere(2, 9)]).export(path)
    (note,) = read(str(path), views=2).notes
    assert re.search(r"; \d+% of the area outside flat faces, not changed; 2 views", note)


def test_faces_lie_in_their_planes_and_their_triangles_are_the_models(plate_file):
    scene = read(plate_file, views=2, pixels=128)
    assert_valid_polygons(scene.polygons)
    holes, areas = shapely.get_num_interior_rings(scene.polygons), shapely.area(scene.polygons)
    assert (len(holes), holes.sum()) == (70, 4)
    vertices = shapely.get_num_coordinates(scene.polygons) - 1 - holes
    triangles = [len(rows) for rows in scene.viewing.polygon_triangles]
    assert triangles == (vertices + 2 * holes - 2).tolist()
    model = trimesh.load_mesh(plate_file)
    largest = max(model.area_faces[facet].sum() for facet in model.facets)
    assert areas.max() / areas.sum() == pytest.approx(largest / model.area, rel=1e-6)


def test_a_mirror_image_shows_its_own_front(tmp_path):
    builder = Builder(KITE, LONG)
    builder.json["nodes"] = [{"mesh": 0}, {"mesh": 0, "scale": [1, 1, -1]}]
    builder.json["scenes"] = [{"nodes": [0]}]
    plain = read(built(builder, tmp_path)).viewing
    builder.json["scenes"] = [{"nodes": [1]}]
    mirrored = read(built(builder, tmp_path)).viewing
    # (x, y, -z) of a sheet at z = 0 is the sheet itself with the opposite front
    counts = [np.diff(viewing.piece_offsets) for viewing in (plain, mirrored)]
    assert (counts[0] + counts[1] == 1).all()
    assert 0 < plain.piece_offsets[-1] < 24


def test_instances_are_separate_pieces_of_one_face(tmp_path):
    builder = Builder(KITE, LONG)
    builder.json["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 5]}]
    builder.json["scenes"] = [{"nodes": [0, 1]}]
    scene = read(built(builder, tmp_path), views=4)
    assert len(scene.polygons) == 1
    sizes = np.diff(scene.viewing.piece_offsets)
    assert set(sizes.tolist()) <= {0, 2}
    assert (scene.viewing.source == 0).all()


def test_loose_triangles_are_the_last_piece_of_each_view(tmp_path):
    bent = np.array([(20, 0, 0), (22, -1, 0), (29, 0, 0), (22, 1, 3)], "<f4")
    builder = Builder(KITE, LONG)
    builder.primitive(bent, LONG)
    scene = read(built(builder, tmp_path), views=8, pixels=256)
    viewing = scene.viewing
    assert len(scene.polygons) == 1
    assert viewing.other_triangles
    for piece, rows in viewing.other_triangles.items():
        assert viewing.source[piece] == 1
        assert sorted(np.unique(rows)) == list(range(viewing.pieces.vertex_counts[piece]))
    frame = framed(scene)
    flat = FrameTriangulation(parts=[None], skipped=[(0, "why")], t_junctions=[0])
    done = carry_to_views(frame, flat, parse("original"))
    faces = [piece for piece in range(len(viewing.source)) if piece not in viewing.other_triangles]
    assert done.skipped == [(piece, "why") for piece in faces]
    assert [done.parts[piece] is None for piece in faces] == [True] * len(faces)
    assert all(done.parts[piece] is rows for piece, rows in viewing.other_triangles.items())


@pytest.mark.parametrize("depth", ["none", "file", "front"])
def test_triangles_are_drawn_in_the_models_order_or_front_to_back(tmp_path, depth):
    points = np.vstack([KITE, KITE + [0, 0, 4], KITE + [0, 0, 8]]).astype("<f4")
    order = np.array([(4, 5, 6), (0, 1, 2), (8, 9, 10), (0, 2, 3), (8, 10, 11), (4, 6, 7)])
    builder = Builder(points, order)
    scene = read(built(builder, tmp_path), views=24, depth=depth)
    frame = framed(scene)
    rows = order_submission(frame, join_original(frame), Options())
    for span in frame.split_by_draw(rows):
        view_rows = rows[span]
        if len(view_rows) == 0:
            continue
        if depth == "front":
            deep = scene.viewing.depths[view_rows].sum(axis=1)
            assert (np.diff(deep) >= 0).all()
            continue
        pieces = frame.find_owners(view_rows)
        sheets = scene.viewing.source[pieces]
        # the sheets in the order of the file: 1, 0, 2, 0, 2, 1
        names = {int(sheets[0]): 1, int(sheets[1]): 0, int(sheets[2]): 2}
        assert [names[int(sheet)] for sheet in sheets] == [1, 0, 2, 0, 2, 1]


def make_kites(*heights):
    builder = Builder()
    for height in heights:
        builder.primitive(KITE + np.array([0, 0, height], "<f4"), LONG)
    return builder


def test_parts_are_drawn_one_after_the_other(tmp_path):
    frame = framed(read(built(make_kites(0, 5, 2), tmp_path)))
    rows = order_submission(frame, join_original(frame), Options())
    drawn = [frame.find_owners(rows[span]) for span in frame.split_by_draw(rows)]
    seen = [tuple(frame.source[pieces].tolist()) for pieces in drawn]
    assert sorted(seen) == 12 * [()] + 12 * [(0, 0, 1, 1, 2, 2)]


def test_gaps_belong_to_faces_with_triangles(tmp_path):
    frame = framed(read(built(make_kites(0, 5), tmp_path), views=8))
    one = np.array([(0, 1, 3), (1, 2, 3)], np.int32)
    flat = FrameTriangulation(parts=[None, one], t_junctions=[0, 1], gaps=[0.25], failed=[(0, "")])
    done = carry_to_views(frame, flat, parse("original"))
    solved = [part is not None for part in done.parts]
    assert done.gaps == [0.25] * sum(solved)
    assert sum(solved) == len(solved) / 2 > 0
    assert done.t_junctions == [int(flag) for flag in solved]


def test_another_distance_is_another_scene(tmp_path):
    path = built(Builder(KITE, LONG), tmp_path)
    hashes = {read(path, distance=distance).content_hash for distance in (3.0, 3.0, 3.001)}
    assert len(hashes) == 2


def test_views_are_the_same_on_every_machine(tmp_path):
    """The hash of one model's integer coordinates, noted once."""
    builder = Builder(KITE, LONG)
    viewing = read(built(builder, tmp_path), pixels=1024, distance=3.0, depth="file").viewing
    assert viewing.names[:2] == ("1 2 3", "1 -2 -3")
    places = [[232560, 171758], [176178, 171758], [9733, 82428], [204036, 135947]]
    assert viewing.pieces.coords[:4].tolist() == places
    assert viewing.depths[:4].tolist() == [13044988, 13044988, 9267751, 11530761]
    content = viewing.pieces.coords.astype("<i4").tobytes() + viewing.depths.astype("<i4").tobytes()
    assert hashlib.sha256(content).hexdigest()[:16] == "31d800fb31ff19a0"


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"views": 0}, r"views=0: out of range \(1 to 24\)"),
        ({"views": 25}, "views=25: out of range"),
        ({"pixels": 511}, "pixels=511: not an even number"),
        ({"pixels": 4}, "pixels=4: not an even number from 8"),
        ({"distance": 1.0}, r"distance=1: out of range \(1.1 to 1000 radii\)"),
        ({"distance": float("nan")}, "distance=nan: out of range"),
        ({"depth": "back"}, "unknown depth=back"),
    ],
)
def test_invalid_parameters_are_refused(plate_file, wrong, reason):
    with pytest.raises(SceneError, match=reason):
        read(plate_file, **wrong)


def test_models_without_visible_triangles_are_refused(tmp_path):
    (tmp_path / "a.txt").write_text("no model")
    with pytest.raises(SceneError, match="unsupported model format"):
        read(str(tmp_path / "a.txt"))
    with pytest.raises(SceneError, match=r"b\.glb"):
        read(str(tmp_path / "b.glb"))
    builder = Builder(np.zeros((3, 3), "<f4"), [(0, 1, 2)])
    with pytest.raises(SceneError, match="no visible triangle"):
        read(built(builder, tmp_path))


def test_nan_positions_are_not_drawn(tmp_path):
    points = np.vstack([KITE, [(np.nan, 0, 0)]]).astype("<f4")
    builder = Builder(points, [*LONG, (3, 2, 4)])
    viewing = read(built(builder, tmp_path)).viewing
    assert viewing.other_triangles == {}
    assert viewing.piece_offsets[-1] == 12


@pytest.mark.parametrize(
    ("name", "limit", "noun"), [("MAX_VERTICES", 1000, "vertices"), ("MAX_PIECES", 90, "faces")]
)
def test_too_many_pieces_are_refused(plate_file, monkeypatch, name, limit, noun):
    monkeypatch.setattr(f"harness.models.seen.{name}", limit)
    message = f"more than .*{limit:,} {noun}.* in all views; reduce views="
    with pytest.raises(SceneError, match=message):
        read(plate_file)
