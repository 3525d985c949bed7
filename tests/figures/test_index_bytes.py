"""The bytes of triangles: read back, they are the same triangles; by hand, the same bytes."""

from __future__ import annotations

import gzip

import brotli
import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from harness.figures import index_bytes
from harness.figures.index_bytes import (
    index_data,
    index_sizes,
    packed,
    packers,
    triangles_of,
    varints,
)
from harness.figures.registry import INDEX, INDEX_BYTES, METRICS
from harness.frame import frame_of, view_of
from harness.rasterisers import Options
from harness.rasterisers.submission_order import submission
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse
from scenes import load


def test_two_squares_are_the_bytes_that_the_specification_says():
    triangles = np.array([[4, 5, 6], [4, 6, 7], [2, 3, 0], [0, 1, 2]], np.int32)
    data = index_data(triangles, np.array([0, 4, 8]))
    steps = [2, 1, -3, 0, 1, 1, -2, 1, 1, -2, 2, 1]
    zigzag = [2 * step if step >= 0 else -2 * step - 1 for step in steps]
    assert list(data) == [2, 2, *zigzag]
    back = triangles_of(data, np.array([0, 4, 8]))
    assert back.tolist() == [[2, 3, 0], [0, 1, 2], [4, 5, 6], [4, 6, 7]]


@given(st.lists(st.integers(0, 2**32 - 1), max_size=30))
def test_numbers_come_back(numbers):
    assert varints(packed(np.array(numbers, np.int64))).tolist() == numbers


@pytest.mark.parametrize("order", ["native", "walk", "vertex-cache"])
def test_tiles_come_back_from_what_is_counted(order):
    scene = load("helsinki-tiles:zoom=16,tiles=3")
    frame = frame_of(scene, view_of(scene))
    parts = triangulate_polygons(parse("ear-clipping"), frame.polygons).parts
    rows = submission(frame, frame.join(parts), Options(order=order))
    sizes = index_sizes(frame, rows)
    own = []
    for first, last, tile in zip(frame.tiles, frame.tiles[1:], frame.draws(rows), strict=False):
        offsets = frame.offsets[first : last + 1]
        data = index_data(rows[tile], offsets)
        back = triangles_of(data, offsets)
        assert sorted(map(tuple, back.tolist())) == sorted(map(tuple, rows[tile].tolist()))
        own.append(data)
    assert sizes["index_bytes_raw"] == 6 * len(rows)
    assert sizes["index_bytes"] == sum(map(len, own))
    assert sizes["index_bytes_gzip"] == sum(len(gzip.compress(data, 9)) for data in own)
    assert sizes["index_bytes_brotli"] == sum(len(brotli.compress(data)) for data in own)
    assert sizes["index_bytes_zstd"] == sum(
        len(zstandard.ZstdCompressor(19).compress(data)) for data in own
    )
    for name, _, _ in INDEX_BYTES:
        assert METRICS[name]({INDEX: sizes}) == sizes[name]


def test_what_is_not_installed_is_not_counted(monkeypatch):
    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(index_bytes, "import_module", absent)
    assert list(packers()) == ["gzip"]
