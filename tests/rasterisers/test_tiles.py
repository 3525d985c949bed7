"""Map tiles on every device: clipped at the edge of the tile, each in a separate draw call."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from harness.errors import UsageError
from harness.frame import Frame
from harness.heatmaps import make_lane_maps
from harness.measuring.records import _sum_counters_per_view
from harness.rasterisers import Options, Rasteriser, get
from harness.rasterisers.base import order_submission
from harness.rasterisers.reference import Reference, count_outline_quads
from tests.rasterisers import pictures
from tests.rasterisers.conftest import (
    loose_triangles,
    random_triangles,
    require_reference_counts,
    time_draws,
)
from tests.rasterisers.pictures import find_covered

NATIVE = Options()


@pytest.fixture(scope="session")
def tiles() -> tuple[Frame, np.ndarray]:
    """Return two tiles of 128 px in a viewport of 256 px, with triangles across their edges."""
    frame, triangles = random_triangles(seed=3, size=256, number=160, grid=128)
    cut = replace(frame, scissor=(64, 64, 128, 128), tiles=np.array([0, 100, 160]))
    return cut, triangles


def test_counters_and_pictures_equal_the_reference(on_device, tiles, reference):
    _, call = on_device
    for options in (NATIVE, Options(order="shuffled", seed=1)):
        require_reference_counts(on_device, reference, *tiles, options)
    # Later triangles hide earlier ones, so that pictures depend on the order, too.
    # Without a scissor the picture has the size of the viewport again, and vice versa.
    frame, triangles = tiles
    for case in (frame, replace(frame, scissor=None), frame):
        image = call(pictures.draw_image, case, triangles, NATIVE)
        assert np.array_equal(image, pictures.read_image(reference, case, triangles, NATIVE))


def test_reference_counts_only_pixels_of_the_window(reference, tiles):
    frame, triangles = tiles
    counted = reference.draw_and_count(frame, triangles, NATIVE)
    quads = count_outline_quads(frame, [np.array([[0, 1, 2]], np.int32)] * 160)
    for number, rows in enumerate(triangles):
        inside, helpers = make_lane_maps(frame, rows[None])
        assert not inside[:64].any()
        assert not inside[:, 192:].any()
        assert counted["fragments"][number] == inside.sum()
        assert counted["helper_lanes"][number] == helpers.sum()
        assert counted["quads"][number] == quads[number] == (inside + helpers).sum() // 4


def test_window_clips_the_picture_of_edge_functions(reference):
    rng = np.random.default_rng(4)
    corners = rng.integers(0, 32, (60, 3, 2)) * 128
    frame, triangles = loose_triangles(corners, 16)
    cut = replace(frame, scissor=(4, 6, 8, 6))
    counted = reference.draw_and_count(cut, triangles, NATIVE)
    for number in range(60):
        mask = find_covered(corners[number])
        assert counted["fragments"][number] == mask[6:12, 4:12].sum()
        blocks = mask[6:12, 4:12].reshape(3, 2, 4, 2).any(axis=(1, 3))
        assert counted["quads"][number] == blocks.sum()


def test_bins_overlap_the_window(tiles):
    binning = get("binning")(get("binning").devices()[0])
    big = [[256, 256], [255 * 256, 256], [256, 255 * 256]]
    frame, triangles = loose_triangles(big, 256)
    cut = replace(frame, scissor=(64, 64, 128, 128))
    assert binning.draw_and_count(frame, triangles, NATIVE)["tiles_64"].tolist() == [16]
    counted = binning.draw_and_count(cut, triangles, NATIVE)
    assert counted["tiles_64"].tolist() == [4]
    triangle = shapely.Polygon(big)
    starts = range(64 * 256, 192 * 256, 4096)
    bins = [shapely.box(x, y, x + 4096, y + 4096) for x in starts for y in starts]
    exact = sum(shapely.intersection(bin_, triangle).area > 0 for bin_ in bins)
    assert counted["tiles_16_exact"].tolist() == [exact]


def test_each_tile_is_a_call_and_keeps_its_triangles_in_any_order(tiles):
    frame, triangles = tiles
    assert frame.split_by_draw(triangles) == [slice(0, 100), slice(100, 160)]
    assert frame.split_by_draw(triangles[120:]) == [slice(0, 0), slice(0, 40)]
    assert replace(frame, tiles=None).split_by_draw(triangles) == [slice(0, 160)]
    for order in ("walk", "vertex-cache", "morton", "shuffled"):
        rows = order_submission(frame, triangles, Options(order=order))
        assert {*map(tuple, np.sort(rows))} == {*map(tuple, np.sort(triangles))}
        assert (frame.find_owners(rows[:100]) < 100).all()
        by_neighbour = order in ("walk", "vertex-cache")  # no triangle has a neighbour
        assert np.array_equal(rows, triangles) == by_neighbour


def test_hidden_tiles_are_drawn(llvmpipe):
    layer = [[0, 0], [512 * 256, 0], [0, 512 * 256]]
    frame, triangles = loose_triangles(layer * 3, 256)
    cut = replace(frame, scissor=(64, 64, 128, 128), tiles=np.array([0, 1, 2, 3]))
    assert llvmpipe.draw_and_count(cut, triangles, NATIVE)["samples_passed"] == 3 * 128**2
    with llvmpipe.prepare(cut, triangles, NATIVE) as drawing:
        calls, draw = [], drawing.draw_rows
        drawing.draw_rows = lambda rows, *_: [calls.append(rows), draw(rows)]
        drawing.sample(2)
    assert calls == 2 * [slice(0, 1), slice(1, 2), slice(2, 3)]


def test_tiles_without_triangles_are_timed_too(on_device, tiles):
    _, call = on_device
    for rows in (tiles[1], np.empty((0, 3), np.int32)):
        assert call(time_draws, (tiles[0], rows)) > 0


def test_rasterisers_without_scissor_refuse_tiles(tiles):
    rasteriser: Rasteriser = object.__new__(get("pyrender"))
    with pytest.raises(UsageError, match="pyrender does not support map tiles"):
        rasteriser.draw_and_count(*tiles, NATIVE)
    unclipped = replace(tiles[0], scissor=None)
    assert rasteriser._check_and_order(unclipped, tiles[1], NATIVE) is not None


def test_record_has_the_sum_of_each_counter_by_tile(tiles):
    frame, triangles = tiles
    cut = replace(frame, tiles=np.array([0, 100, 100, 160]))
    counters = Reference().draw_and_count(cut, triangles, NATIVE)
    sums = _sum_counters_per_view(cut, counters).counters
    assert set(sums) == set(counters)
    for name, values in counters.items():
        assert sums[name] == (values[:100].sum(), 0, values[100:].sum())
    assert _sum_counters_per_view(replace(frame, tiles=None), counters) is None
