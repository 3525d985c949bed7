"""Compute-shader rasterisers on llvmpipe: tests as predicted, pixels as the reference's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.errors import UsageError
from harness.rasterisers import Options
from harness.rasterisers.compute import JOB_PIXELS, LANES, split_into_jobs
from tests.rasterisers.conftest import loose_triangles, random_triangles


def test_bounding_box_of_4096_px_is_tested_completely(opened):
    corners = [[0, 0], [4096 * 256, 0], [0, 4096 * 256]]
    frame, triangles = loose_triangles(corners, 4096)
    counted = opened("bounding-box").draw_and_count(frame, triangles, Options())
    assert counted["bbox_tests"].tolist() == [4096**2]


def test_dispatch_splits_more_triangles_than_one_dimension_allows(opened):
    corner = [[256, 256], [768, 256], [256, 768]]
    frame, triangles = loose_triangles(corner * 70_000, 8)
    counted = opened("bounding-box").draw_and_count(frame, triangles, Options())
    assert counted["bbox_tests"].tolist() == [4] * 70_000


def test_scanline_counts_the_rows_of_the_box(opened):
    frame, triangles = loose_triangles([[256, 256], [31 * 256, 1024], [512, 20 * 256]], 32)
    assert opened("scanline").draw_and_count(frame, triangles, Options())["rows"].tolist() == [19]


@pytest.mark.parametrize("name", ["bounding-box", "scanline"])
def test_multisampling_and_work_are_refused(opened, name):
    frame, triangles = random_triangles(seed=1, size=64, number=2, grid=1)
    problem = "neither multisampling nor fragment work nor textures"
    for options in (Options(samples=4), Options(work=3), Options(texture=1)):
        with pytest.raises(UsageError, match=problem):
            opened(name).draw_and_count(frame, triangles, options)


corner = st.tuples(*[st.integers(0, 16384 * 256)] * 2)


@given(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=3))
def test_jobs_cover_each_row_once_and_are_small(corners):
    frame, triangles = loose_triangles(corners, 16384)
    jobs = split_into_jobs(frame, triangles)
    boxes = frame.points[triangles]
    first = np.ceil(boxes.min(axis=1) / 256 - 0.5).astype(int)
    last = np.floor(boxes.max(axis=1) / 256 - 0.5).astype(int)
    for number, (low, high) in enumerate(zip(first, last, strict=True)):
        mine = jobs[jobs[:, 0] == number]
        rows = [row for _, start, stop, _ in mine for row in range(start, stop + 1)]
        assert rows == list(range(low[1], high[1] + 1))
        width = max(high[0] - low[0] + 1, 1)
        max_rows = max(JOB_PIXELS / width, LANES)
        assert all(stop - start + 1 <= max_rows for _, start, stop, _ in mine)
