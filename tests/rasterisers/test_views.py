"""Views of a model on every device equal the reference; each view is a separate draw call."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from harness.errors import NoRasteriserError, UsageError
from harness.frame import Frame, Viewing, get_scene_view, make_bare_frame, make_scene_frame
from harness.measuring import tasks
from harness.models.seen import read
from harness.rasterisers import Options, get
from harness.triangulating.carrying import carry_to_views, make_original_triangulation
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons
from tests.models.various import make_solid
from tests.rasterisers import pictures
from tests.rasterisers.conftest import (
    find_errors,
    open_on,
    require_covering_triangles,
    require_reference_counts,
    time_draws,
)

NATIVE = Options()


def read_frame(path: str, **options: Any) -> Frame:
    scene = read(path, **options)
    return make_scene_frame(scene, get_scene_view(scene))


def triangulate_views(frame: Frame, *names: str) -> list[np.ndarray]:
    """Return the model's original triangulation and triangulations of its faces by name."""
    parts = [make_original_triangulation(frame).parts]
    for name in names:
        flat = triangulate_polygons(parse(name), frame.flat.polygons)
        parts.append(carry_to_views(frame, flat, parse("original")).parts)
    return [frame.join_triangles(part) for part in parts]


@pytest.fixture(scope="session")
def views(tmp_path_factory) -> tuple[Frame, list[np.ndarray]]:
    path: Path = tmp_path_factory.mktemp("models") / "plate.glb"
    make_solid().export(path)
    frame = read_frame(str(path), views=4, pixels=128)
    return frame, triangulate_views(frame, "delaunay", "optimal:edge-length")


def test_counters_of_each_piece_equal_the_reference(on_device, views, reference):
    frame, triangulations = views
    for rows in triangulations:
        require_reference_counts(on_device, reference, frame, rows)


@pytest.fixture(scope="session", params=["file", "front"])
def depth_views(request: pytest.FixtureRequest, tmp_path_factory) -> tuple[Frame, list[np.ndarray]]:
    """Return views, with depths, of plates that hide and intersect each other, and of a ball."""
    parts = [make_solid(turn) for turn in (0.3, 1.9)]
    parts[1].apply_translation([3, -2, 1])
    ball = trimesh.creation.icosphere(2, radius=5.0)
    path: Path = tmp_path_factory.mktemp("models") / "heap.glb"
    trimesh.util.concatenate([*parts, ball]).export(path)
    frame = read_frame(str(path), views=4, pixels=128, depth=request.param)
    return frame, triangulate_views(frame, "optimal:edge-length")


def test_counters_with_depth_equal_the_reference_except_ties(on_device, depth_views, reference):
    rasteriser, call = on_device
    frame, triangulations = depth_views
    for rows in triangulations:
        exact = reference.draw_and_count(frame, rows, NATIVE)
        assert exact["depth_ties"].sum() < 0.001 * exact["fragments"].sum()
        if not get(rasteriser).supports_depth:
            with pytest.raises(UsageError, match="does not test depth before shading; use"):
                call(tasks.draw_and_count, frame, rows, NATIVE)
            continue
        drawn = call(tasks.draw_and_count, frame, rows, NATIVE)
        assert np.array_equal(drawn["depth_ties"], exact["depth_ties"])
        for name in ("fragments", "quads", "partial_quads", "covering_triangles"):
            assert (np.abs(drawn[name] - exact[name]) <= exact["depth_ties"]).all()
            assert drawn[name].sum() > 0
        assert (drawn["helper_lanes"] == 4 * drawn["quads"] - drawn["fragments"]).all()
        assert abs(drawn["samples_passed"] - exact["fragments"].sum()) <= exact["depth_ties"].sum()
        for samples in (1, 4):
            require_covering_triangles(call, frame, rows, Options(samples=samples))


def test_pictures_with_depth_equal_the_reference_except_ties(on_device, depth_views, reference):
    rasteriser, call = on_device
    if not get(rasteriser).supports_depth:
        return
    frame, (rows, _) = depth_views
    image = call(pictures.draw_image, frame, rows, NATIVE)
    expected = pictures.read_image(reference, frame, rows, NATIVE)
    ties = int(reference.draw_and_count(frame, rows, NATIVE)["depth_ties"].sum())
    assert (image != expected).any(axis=2).sum() <= ties
    # A later draw without depths has no depth test.
    flat = replace(frame, viewing=replace(frame.viewing, depths=None))
    counted = call(tasks.draw_and_count, flat, rows, NATIVE)
    assert find_errors(reference, counted, flat, rows) == []


def test_views_are_timed_with_depths_too(on_device, views, depth_views):
    rasteriser, call = on_device
    assert call(time_draws, (views[0], views[1][0])) > 0
    if get(rasteriser).supports_depth:
        for rows in (depth_views[1][0], np.empty((0, 3), np.int32)):
            assert call(time_draws, (depth_views[0], rows)) > 0


def make_sheets(depths: list[int]) -> tuple[Frame, np.ndarray]:
    square = np.array([[256, 256], [3840, 256], [3840, 3840], [256, 3840]], np.int32)
    count = len(depths)
    frame = make_bare_frame(16, np.tile(square, (count, 1)), 4)
    rows = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    pieces = {"pieces": frame.grid, "piece_offsets": np.array([0, count])}
    triangles = {"polygon_triangles": (rows,) * count, "other_triangles": {}}
    order = {"source": np.arange(count), "ranks": np.arange(2 * count)}
    depths = np.repeat(np.array(depths, np.int32), 4)
    viewing = Viewing(pixels=16, names=("",), depths=depths, **pieces, **triangles, **order)
    frame = replace(frame, tiles=viewing.piece_offsets, viewing=viewing)
    return frame, frame.join_triangles([rows] * count)


@pytest.mark.parametrize(
    ("depths", "fragments", "ties"),
    [
        ([5000, 9000, 1000], [196, 0, 196], 0),
        ([5000, 5000], [196, 0], 196),
        ([5000, 4969], [196, 196], 196),  # within twice 16 steps
        ([5000, 4967], [196, 196], 0),
        ([1 << 24], [0], 0),  # at the far plane
    ],
)
def test_hidden_pixels_and_ties(reference, llvmpipe, depths, fragments, ties):
    frame, rows = make_sheets(depths)
    counted = reference.draw_and_count(frame, rows, NATIVE)
    assert counted["fragments"].tolist() == fragments
    assert counted["depth_ties"].sum() == ties
    # Both triangles shade the quads on the diagonal, except the quads of one pixel at its ends.
    quads = 8 * 8 + 6
    assert counted["quads"].tolist() == [quads if count else 0 for count in fragments]
    assert (counted["helper_lanes"] == 4 * counted["quads"] - counted["fragments"]).all()
    drawn = llvmpipe.draw_and_count(frame, rows, NATIVE)
    assert drawn["fragments"].tolist() == fragments


def test_intersecting_planes_hide_half_of_each_other(reference, llvmpipe):
    frame, rows = make_sheets([8 << 20, 8 << 20])
    sloping = frame.viewing.depths.copy()
    sloping[4:] = [4 << 20, 12 << 20, 12 << 20, 4 << 20]
    frame = replace(frame, viewing=replace(frame.viewing, depths=sloping))
    counted = reference.draw_and_count(frame, rows, NATIVE)
    assert counted["fragments"].tolist() == [196, 98]
    image = pictures.read_image(reference, frame, rows, NATIVE)
    assert (image[1:15, 1:8] != image[1:15, 8:15]).any(axis=2).all()
    assert llvmpipe.draw_and_count(frame, rows, NATIVE)["fragments"].tolist() == [196, 98]


def make_partly_hidden() -> tuple[Frame, np.ndarray]:
    """Return a square behind a smaller one, whose edge crosses quads."""
    frame, rows = make_sheets([5000, 9000])
    points = frame.points.copy()
    points[:4] = np.clip(points[:4] + 512, 0, 3840)
    return frame.with_points(points), rows


def test_hidden_pixels_of_a_quad_are_not_counted(reference, llvmpipe):
    case = make_partly_hidden()
    drawn = llvmpipe.draw_and_count(*case, NATIVE)
    assert drawn["fragments"].tolist() == [144, 196 - 144]
    assert find_errors(reference, drawn, *case) == []


def test_drivers_with_late_depth_test_or_without_helper_lanes_are_refused(llvmpipe, monkeypatch):
    case = (*make_partly_hidden(), NATIVE)
    result, count = llvmpipe.context.read_query, llvmpipe._count_per_polygon
    with monkeypatch.context() as late:
        late.setattr(llvmpipe.context, "read_query", lambda query: result(query) - 1)
        with pytest.raises(NoRasteriserError, match="does not test depth before shading"):
            llvmpipe.draw_and_count(*case)
    with monkeypatch.context() as patch:
        patch.setattr(llvmpipe, "_count_per_polygon", lambda *mesh: count(*mesh) - [0, 0, 1, 0, 0])
        with pytest.raises(NoRasteriserError, match="does not report helper invocations"):
            llvmpipe.draw_and_count(*case)


def test_softpipe_counts_pixels_that_pass_the_depth_test():
    with open_on("opengl", "softpipe") as call:
        drawn = call(tasks.draw_and_count, *make_partly_hidden(), NATIVE)
    assert drawn["fragments"].tolist() == [144, 196 - 144]
    assert drawn["samples_passed"] == 196
