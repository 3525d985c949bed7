"""Ratios of draw times within a process; they need a quiet machine."""

import pytest

from harness.rasterisers import Options
from harness.rasterisers.base import Drawing
from tests.rasterisers.conftest import loose_triangles, random_triangles

END = 511 * 256
SLIVER = [[256, 256], [END, END], [END - 256, END]]


def measure_seconds(drawing: Drawing, repeats: int, tries: int = 5) -> float:
    """Return the minimum time of `repeats` draws after a warm-up draw."""
    drawing.sample(1)
    return min(drawing.sample(repeats).wall for _ in range(tries))


@pytest.mark.parametrize("name", ["reference", "opengl", "bounding-box"])
def test_time_grows_with_repeats_despite_hidden_draws(opened, reference, name):
    rasteriser = reference if name == "reference" else opened(name)
    frame, triangles = random_triangles(seed=11, size=512, number=100, grid=1)
    with rasteriser.prepare(frame, triangles, Options()) as drawing:
        assert measure_seconds(drawing, 10) > 5 * measure_seconds(drawing, 1)


def test_fragment_work_costs_time(llvmpipe):
    frame, triangles = random_triangles(seed=10, size=256, number=30, grid=64)
    with (
        llvmpipe.prepare(frame, triangles, Options()) as light,
        llvmpipe.prepare(frame, triangles, Options(work=200)) as heavy,
    ):
        assert measure_seconds(heavy, 2) > 2 * measure_seconds(light, 2)


def test_instances_take_proportional_time(llvmpipe):
    """Use the instanced draws of GPUs on llvmpipe."""
    frame, triangles = loose_triangles([[256, 256], [255 * 256, 256], [256, 255 * 256]] * 30, 256)
    with llvmpipe.prepare(frame, triangles, Options()) as drawing:
        drawing.software = False
        assert measure_seconds(drawing, 10) > 4 * measure_seconds(drawing, 1)


def test_bounding_box_time_depends_on_the_box_and_not_the_area(opened):
    """Both triangles have the same box; one covers half of it, the other almost nothing."""
    triangle, triangles = loose_triangles([[256, 256], [END, 256], [256, END]], 512)
    sliver, _ = loose_triangles(SLIVER, 512)
    rasteriser = opened("bounding-box")
    with (
        rasteriser.prepare(triangle, triangles, Options()) as full,
        rasteriser.prepare(sliver, triangles, Options()) as thin,
    ):
        assert 0.5 < measure_seconds(full, 2) / measure_seconds(thin, 2) < 2.5


def test_scanline_is_much_faster_on_a_large_empty_box(opened):
    frame, triangles = loose_triangles(SLIVER, 512)
    with (
        opened("bounding-box").prepare(frame, triangles, Options()) as box,
        opened("scanline").prepare(frame, triangles, Options()) as scanline,
    ):
        assert measure_seconds(scanline, 2) < 0.5 * measure_seconds(box, 2)
