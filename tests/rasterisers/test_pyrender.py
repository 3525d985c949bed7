import pickle
from itertools import pairwise

import numpy as np
import pytest
from shapely import Polygon, box

from harness.errors import NoRasteriserError, UsageError
from harness.frame import Frame, View, get_scene_view, make_frame, make_scene_frame
from harness.measuring import tasks
from harness.models.seen import read
from harness.rasterisers import Options, find_device, get, pyrender
from harness.rasterisers.base import Triangles, order_submission
from harness.rasterisers.pyrender import extrude_polygons
from harness.rasterisers.reference import Reference
from harness.triangulating.carrying import make_original_triangulation
from tests.models.various import make_solid
from tests.rasterisers import pictures
from tests.rasterisers.conftest import open_on, time_draws
from triangulators import triangulate

COURT = box(0, 0, 30, 20).difference(box(8, 6, 20, 14))
ELL = Polygon([(40, 0), (60, 0), (60, 8), (48, 8), (48, 20), (40, 20)])


@pytest.fixture(scope="module")
def frame() -> Frame:
    return make_frame([COURT, ELL], View(128))


def joined(frame: Frame, triangulator: str) -> Triangles:
    return frame.join_triangles([triangulate(polygon, triangulator) for polygon in frame.polygons])


@pytest.mark.parametrize("name", ["llvmpipe", "osmesa"])
def test_it_draws_and_times_but_does_not_count(frame, name):
    one, other = ((frame, joined(frame, name)) for name in ("delaunay", "ear-clipping"))
    with open_on("pyrender", name) as call:
        picture = call(pictures.draw_image, *one, Options())
        other = call(pictures.draw_image, *other, Options())
        assert call(tasks.draw_and_count, *one, Options()) == {}
        assert get("pyrender").counters == ()
        assert call(time_draws, one) > 0
    assert picture.shape == (128, 128, 4)
    sky = np.rint(np.array(pyrender.SKY) * 255)
    built = (abs(picture - sky).max(axis=2) > 2).mean()
    assert 0.05 < built < 0.8
    # Another triangulation of the same roofs gives the same picture.
    assert (abs(picture.astype(int) - other).max(axis=2) > 2).mean() < 0.002


def test_missing_pyrender_has_no_devices_and_an_install_command(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert get("pyrender").devices() == []
    with pytest.raises(NoRasteriserError, match=r"pip install .*\[pyrender\]"):
        find_device("pyrender")


def test_walls_stand_under_the_rings_and_close_them(frame):
    triangles = joined(frame, "delaunay")
    # Pickled, as for the worker that builds the walls.
    solid = extrude_polygons(pickle.loads(pickle.dumps(frame)), triangles)
    number = len(frame.points)
    assert len(solid.faces) == len(triangles) + 2 * number
    assert np.array_equal(solid.faces[: len(triangles)], triangles)
    following = solid.faces[len(triangles) :][:number, 1] - 2 * number
    assert sorted(following) == list(range(number))
    assert following[:8].tolist() == [1, 2, 3, 0, 5, 6, 7, 4]
    heights = solid.positions[:number, 2]
    for start, stop in pairwise(frame.grid.vertex_offsets):
        assert heights[start] > 0
        assert (heights[start:stop] == heights[start]).all()
    corners = solid.positions[solid.faces[len(triangles) :]]
    assert (corners[..., 2].min(axis=1) == 0).all()
    # Each wall is upright: seen from above its triangles have no area.
    plan = corners[..., :2].astype(float)
    first, second = plan[:, 1] - plan[:, 0], plan[:, 2] - plan[:, 0]
    assert abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).max() < 1e-3


def test_unsupported_options_are_refused(frame):
    kind = get("pyrender")
    rasteriser = object.__new__(kind)
    with pytest.raises(UsageError, match="does not support these options"):
        rasteriser.prepare(frame, joined(frame, "delaunay"), Options(samples=4))


def test_views_of_a_model_are_drawn_in_projection(tmp_path):
    make_solid().export(tmp_path / "plate.glb")
    frames = {}
    for depth in ("none", "file"):
        scene = read(str(tmp_path / "plate.glb"), views=2, pixels=128, depth=depth)
        frames[depth] = make_scene_frame(scene, get_scene_view(scene))
    frame = frames["file"]
    triangles = frame.join_triangles(make_original_triangulation(frame).parts)
    rows = order_submission(frame, triangles, Options())
    with open_on("pyrender", "llvmpipe") as call:
        with pytest.raises(UsageError, match="pyrender always tests depth; add depth=file"):
            call(pictures.draw_image, frames["none"], rows, Options())
        picture = call(pictures.draw_image, frame, rows, Options())
        assert call(time_draws, (frame, rows)) > 0
        assert call(time_draws, (frame, rows[:0])) > 0
    exact = pictures.read_image(Reference(), frame, rows[frame.split_by_draw(rows)[-1]], Options())
    drawn = exact[..., 3] > 0
    sky = np.rint(np.array(pyrender.SKY) * 255)
    built = abs(picture - sky).max(axis=2) > 2
    assert 0.2 < drawn.mean() < 0.8
    # pyrender smooths edges; inside, each face has its colour
    assert (built != drawn).mean() < 0.02
    inside = drawn.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            inside &= (np.roll(exact, step, axis) == exact).all(axis=2)
    assert inside.sum() > 1000
    assert abs(picture[inside, :3].astype(int) - exact[inside, :3]).max() <= 2
