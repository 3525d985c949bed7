"""Compute-shader rasterisers on llvmpipe: tests as predicted, pixels as the reference's."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness.errors import UsageError
from harness.rasterisers import Options, Rasteriser
from harness.rasterisers.compute import JOB_PIXELS, LANES, split_rows


@pytest.fixture(params=["bounding-box", "scanline"])
def walker(request, opened) -> Rasteriser:
    return opened(request.param)


@pytest.fixture
def bounding_box(opened) -> Rasteriser:
    return opened("bounding-box")


def test_a_box_of_4096_px_is_tested_in_full(bounding_box, native, loose):
    corners = [[0, 0], [4096 * 256, 0], [0, 4096 * 256]]
    frame, triangles = loose(corners, 4096)
    assert bounding_box.count(frame, triangles, native)["bbox_tests"].tolist() == [4096**2]


def test_a_dispatch_may_have_more_triangles_than_one_dimension_holds(bounding_box, native, loose):
    corner = [[256, 256], [768, 256], [256, 768]]
    frame, triangles = loose(corner * 70_000, 8)
    assert bounding_box.count(frame, triangles, native)["bbox_tests"].tolist() == [4] * 70_000


half_pixel = st.tuples(*[st.integers(2, 60).map(lambda v: v * 128)] * 2)
anywhere = st.tuples(*[st.integers(256, 31 * 256)] * 2)


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=50
)
@given(st.lists(half_pixel | anywhere, min_size=3, max_size=3))
def test_any_triangle_is_hit_as_by_the_reference(walker, reference, native, loose, corners):
    frame, triangles = loose(corners, 32)
    drawn = walker.count(frame, triangles, native)["hits"]
    assert drawn.tolist() == reference.count(frame, triangles, native)["fragments"].tolist()


def test_scanline_counts_the_rows_of_the_box(opened, native, loose):
    frame, triangles = loose([[256, 256], [31 * 256, 1024], [512, 20 * 256]], 32)
    assert opened("scanline").count(frame, triangles, native)["rows"].tolist() == [19]


def test_multisampling_and_work_are_refused(walker, scattered):
    frame, triangles = scattered(seed=1, size=64, number=2, grid=1)
    for options in (Options(samples=4), Options(work=3)):
        with pytest.raises(UsageError, match="neither multisampling nor fragment work"):
            walker.count(frame, triangles, options)


@given(
    st.lists(st.tuples(*[st.integers(0, 16384 * 256)] * 2), min_size=3, max_size=9).filter(
        lambda corners: len(corners) % 3 == 0
    )
)
def test_jobs_cover_each_row_once_and_are_small(loose, corners):
    frame, triangles = loose(corners, 16384)
    jobs = split_rows(frame, triangles)
    boxes = frame.points[triangles]
    first = np.ceil(boxes.min(axis=1) / 256 - 0.5).astype(int)
    last = np.floor(boxes.max(axis=1) / 256 - 0.5).astype(int)
    for number, (low, high) in enumerate(zip(first, last, strict=True)):
        mine = jobs[jobs[:, 0] == number]
        rows = [row for _, start, stop, _ in mine for row in range(start, stop + 1)]
        assert rows == list(range(low[1], high[1] + 1))
        width = max(high[0] - low[0] + 1, 1)
        assert all(
            (stop - start + 1) * width <= max(JOB_PIXELS, LANES * width)
            for _, start, stop, _ in mine
        )
