"""What drawing costs in seconds, as ratios within one process: needs a quiet machine."""

import pytest

from harness.rasterisers import Options
from harness.rasterisers.base import Drawing
from tests.rasterisers.conftest import loose_triangles, random_triangles


def seconds(drawing: Drawing, repeats: int, tries: int = 5) -> float:
    """Return the least time of `repeats` draws, a first one left out."""
    drawing.sample(1)
    return min(drawing.sample(repeats).wall for _ in range(tries))


@pytest.mark.parametrize("name", ["reference", "opengl", "bounding-box"])
def test_time_grows_with_repeats_though_each_draw_hides_the_last(opened, reference, name):
    rasteriser = reference if name == "reference" else opened(name)
    frame, triangles = random_triangles(seed=11, size=512, number=100, grid=1)
    with rasteriser.prepare(frame, triangles, Options()) as drawing:
        assert seconds(drawing, 10) > 5 * seconds(drawing, 1)


def test_fragment_work_costs_time(llvmpipe):
    frame, triangles = random_triangles(seed=10, size=256, number=30, grid=64)
    with (
        llvmpipe.prepare(frame, triangles, Options()) as light,
        llvmpipe.prepare(frame, triangles, Options(work=200)) as heavy,
    ):
        assert seconds(heavy, 2) > 2 * seconds(light, 2)


def test_a_gpu_draws_its_repeats_as_instances(llvmpipe):
    """What only a GPU does, on llvmpipe: instances take their share of time."""
    frame, triangles = loose_triangles([[256, 256], [255 * 256, 256], [256, 255 * 256]] * 30, 256)
    with llvmpipe.prepare(frame, triangles, Options()) as drawing:
        drawing.software = False
        assert seconds(drawing, 10) > 4 * seconds(drawing, 1)


def test_a_walkers_time_follows_the_bounding_box_and_not_the_area(opened):
    """Both triangles have the same box; one covers half of it, the other next to nothing."""
    size, far = 512, 511 * 256
    half, _ = loose_triangles([[256, 256], [far, 256], [256, far]], size)
    sliver, triangles = loose_triangles([[256, 256], [far, far], [far - 256, far]], size)
    walker = opened("bounding-box")
    with (
        walker.prepare(half, triangles, Options()) as full,
        walker.prepare(sliver, triangles, Options()) as thin,
    ):
        assert 0.5 < seconds(full, 2) / seconds(thin, 2) < 2.5


def test_scanline_is_much_faster_on_a_large_empty_box(opened):
    frame, triangles = loose_triangles(
        [[256, 256], [511 * 256, 511 * 256], [510 * 256, 511 * 256]], 512
    )
    taken = {}
    for name in ("bounding-box", "scanline"):
        with opened(name).prepare(frame, triangles, Options()) as drawing:
            taken[name] = seconds(drawing, 2)
    assert taken["scanline"] < 0.5 * taken["bounding-box"]
