"""Views of a model on every device: equal to the reference, each view a call of its own."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from harness.errors import NoRasteriserError, UsageError
from harness.frame import Frame, bare_frame, frame_of, view_of
from harness.measuring import tasks
from harness.models.seen import read
from harness.rasterisers import Options, get
from harness.rasterisers.reference import find_disagreements
from harness.triangulating.carrying import carry_to_views, original_triangulation
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons
from harness.viewing import Viewing
from tests.models.various import solid
from tests.rasterisers import pictures
from tests.rasterisers.conftest import require_reference_counts, seconds, worker_on

NATIVE = Options()


def framed(path: str, **how: Any) -> Frame:
    scene = read(path, **how)
    return frame_of(scene, view_of(scene))


def triangulations(frame: Frame, *names: str) -> list[np.ndarray]:
    """Return the model's own, and those of its faces by name."""
    assert frame.flat is not None
    parts = [original_triangulation(frame).parts]
    for name in names:
        flat = triangulate_polygons(parse(name), frame.flat.polygons)
        parts.append(carry_to_views(frame, flat, parse("original")).parts)
    return [frame.join(each) for each in parts]


@pytest.fixture(scope="session")
def seen(tmp_path_factory) -> tuple[Frame, list[np.ndarray]]:
    """Views of a plate and three triangulations of its faces."""
    path: Path = tmp_path_factory.mktemp("models") / "plate.glb"
    solid().export(path)
    frame = framed(str(path), views=4, pixels=128)
    return frame, triangulations(frame, "delaunay", "optimal:edge-length")


def test_counters_of_each_piece_equal_the_reference(on_device, seen, reference):
    frame, found = seen
    for rows in found:
        require_reference_counts(on_device, reference, frame, rows)


@pytest.fixture(scope="session", params=["file", "front"])
def deep(request: pytest.FixtureRequest, tmp_path_factory) -> tuple[Frame, list[np.ndarray]]:
    """Views of plates that hide each other and cut into each other, and of a ball, with depths."""
    parts = [solid(turn) for turn in (0.3, 1.9)]
    parts[1].apply_translation([3, -2, 1])
    ball = trimesh.creation.icosphere(2, radius=5.0)
    path: Path = tmp_path_factory.mktemp("models") / "heap.glb"
    trimesh.util.concatenate([*parts, ball]).export(path)
    frame = framed(str(path), views=4, pixels=128, depth=request.param)
    return frame, triangulations(frame, "optimal:edge-length")


def test_counters_with_depth_test_equal_the_reference_except_ties(on_device, deep, reference):
    rasteriser, call = on_device
    frame, found = deep
    for rows in found:
        exact = reference.count(frame, rows, NATIVE)
        assert exact["depth_ties"].sum() < 0.001 * exact["fragments"].sum()
        if not get(rasteriser).supports_depth:
            with pytest.raises(UsageError, match="does not test depth before shading; use"):
                call(tasks.count, frame, rows, NATIVE)
            continue
        drawn = call(tasks.count, frame, rows, NATIVE)
        assert np.array_equal(drawn["depth_ties"], exact["depth_ties"])
        for name in ("fragments", "quads", "partial_quads"):
            assert (np.abs(drawn[name] - exact[name]) <= exact["depth_ties"]).all()
            assert drawn[name].sum() > 0
        assert (drawn["helper_lanes"] == 4 * drawn["quads"] - drawn["fragments"]).all()
        assert abs(drawn["samples_passed"] - exact["fragments"].sum()) <= exact["depth_ties"].sum()


def test_pictures_with_depth_test_equal_the_reference_except_ties(on_device, deep, reference):
    rasteriser, call = on_device
    if not get(rasteriser).supports_depth:
        return
    frame, (rows, _) = deep
    images = [
        call(pictures.image, frame, rows, NATIVE),
        pictures.image_of(reference, frame, rows, NATIVE),
    ]
    ties = int(reference.count(frame, rows, NATIVE)["depth_ties"].sum())
    assert (images[0] != images[1]).any(axis=2).sum() <= ties
    # and what is drawn afterwards without depths is not tested
    flat = replace(frame, viewing=replace(frame.viewing, depths=None))
    counted = call(tasks.count, flat, rows, NATIVE)
    assert find_disagreements(flat, counted, reference.count(flat, rows, NATIVE)) == []


def test_views_are_timed_with_depths_too(on_device, seen, deep):
    rasteriser, call = on_device
    deep_rows = (deep[1][0], np.empty((0, 3), np.int32)) if get(rasteriser).supports_depth else ()
    for case in ((seen[0], seen[1][0]), *((deep[0], rows) for rows in deep_rows)):
        assert call(seconds, case) > 0


def sheets(depths: list[int]) -> tuple[Frame, np.ndarray]:
    """One square after another in the same place, at depths, of two triangles each."""
    square = np.array([[256, 256], [3840, 256], [3840, 3840], [256, 3840]], np.int32)
    count = len(depths)
    frame = bare_frame(16, np.tile(square, (count, 1)), 4)
    rows = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    viewing = Viewing(
        pixels=16,
        names=("",),
        pieces=frame.grid,
        depths=np.repeat(np.array(depths, np.int32), 4),
        source=np.arange(count),
        first=np.array([0, count]),
        given=(rows,) * count,
        rest={},
        ranks=np.arange(2 * count),
    )
    frame = replace(frame, tiles=viewing.first, viewing=viewing)
    return frame, frame.join([rows] * count)


@pytest.mark.parametrize(
    ("depths", "fragments", "ties"),
    [
        ([5000, 9000, 1000], [196, 0, 196], 0),
        ([5000, 5000], [196, 0], 196),
        ([5000, 4969], [196, 196], 196),  # within twice 16 steps
        ([5000, 4967], [196, 196], 0),
        ([1 << 24], [0], 0),  # as deep as nothing
    ],
)
def test_hidden_pixels_and_ties(reference, llvmpipe, depths, fragments, ties):
    frame, rows = sheets(depths)
    counted = reference.count(frame, rows, NATIVE)
    assert counted["fragments"].tolist() == fragments
    assert counted["depth_ties"].sum() == ties
    # both triangles shade the quads on the diagonal, but for the corners' quads of one pixel
    quads = 8 * 8 + 6
    assert counted["quads"].tolist() == [quads if each else 0 for each in fragments]
    assert (counted["helper_lanes"] == 4 * counted["quads"] - counted["fragments"]).all()
    drawn = llvmpipe.count(frame, rows, NATIVE)
    assert drawn["fragments"].tolist() == fragments


def test_a_sloping_plane_is_cut_where_it_meets_a_level_one(reference, llvmpipe):
    """Two sheets that cross: each is nearer on one half."""
    frame, rows = sheets([8 << 20, 8 << 20])
    sloping = frame.viewing.depths.copy()
    sloping[4:] = [4 << 20, 12 << 20, 12 << 20, 4 << 20]
    frame = replace(frame, viewing=replace(frame.viewing, depths=sloping))
    counted = reference.count(frame, rows, NATIVE)
    assert counted["fragments"].tolist() == [196, 98]
    image = pictures.image_of(reference, frame, rows, NATIVE)
    assert (image[1:15, 1:8] != image[1:15, 8:15]).any(axis=2).all()
    assert llvmpipe.count(frame, rows, NATIVE)["fragments"].tolist() == [196, 98]


def partly_hidden() -> tuple[Frame, np.ndarray]:
    """A square behind a smaller one, whose edge runs through quads."""
    frame, rows = sheets([5000, 9000])
    points = frame.points.copy()
    points[:4] = np.clip(points[:4] + 512, 0, 3840)
    return frame.with_points(points), rows


def test_hidden_pixels_of_a_quad_are_not_counted(reference, llvmpipe):
    frame, rows = partly_hidden()
    drawn, exact = (each.count(frame, rows, NATIVE) for each in (llvmpipe, reference))
    assert drawn["fragments"].tolist() == [144, 196 - 144]
    assert find_disagreements(frame, drawn, exact) == []


def test_drivers_with_late_depth_test_or_without_helper_lanes_are_refused(llvmpipe, monkeypatch):
    case = (*partly_hidden(), NATIVE)
    result, tally = llvmpipe.context.result, llvmpipe._tally
    with monkeypatch.context() as late:
        late.setattr(llvmpipe.context, "result", lambda query: result(query) - 1)
        with pytest.raises(NoRasteriserError, match="does not test depth before shading"):
            llvmpipe.count(*case)
    with monkeypatch.context() as untold:
        untold.setattr(llvmpipe, "_tally", lambda *mesh: tally(*mesh) - [0, 0, 1, 0])
        with pytest.raises(NoRasteriserError, match="which lanes of a quad are helpers"):
            llvmpipe.count(*case)


def test_softpipe_counts_pixels_that_pass_the_depth_test():
    with worker_on("opengl", "softpipe") as call:
        drawn = call(tasks.count, *partly_hidden(), NATIVE)
    assert drawn["fragments"].tolist() == [144, 196 - 144]
    assert drawn["samples_passed"] == 196
