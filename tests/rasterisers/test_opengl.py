"""OpenGL on llvmpipe against the reference: equal, integer for integer."""

import os

import numpy as np
import psutil
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness.errors import NoRasteriserError, UsageError
from harness.frame import make_bare_frame
from harness.rasterisers import Device, Options, get, opengl
from harness.rasterisers.base import split_batches
from harness.rasterisers.reference import SHADED, find_disagreements
from tests.rasterisers import pictures
from tests.rasterisers.conftest import loose_triangles, random_triangles

half_pixel = st.tuples(*[st.integers(2, 60).map(lambda v: v * 128)] * 2)
anywhere = st.tuples(*[st.integers(256, 31 * 256)] * 2)
any_corners = st.lists(half_pixel | anywhere, min_size=3, max_size=3)


@pytest.mark.parametrize("name", ["opengl", "bounding-box", "scanline"])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(any_corners)
def test_counters_of_any_triangle_equal_the_reference(opened, reference, name, corners):
    case = (*loose_triangles(corners, 32), Options())
    drawn, exact = (rasteriser.draw_and_count(*case) for rasteriser in (opened(name), reference))
    exact["hits"] = exact["fragments"]
    for counter in SHADED if name == "opengl" else ["hits"]:
        assert drawn[counter].tolist() == exact[counter].tolist()


def test_image_equals_the_reference(llvmpipe, reference):
    frame, triangles = random_triangles(seed=9, size=300, number=60, grid=64)
    for order in ("native", "shuffled", "morton", "walk"):
        options = Options(order=order, seed=2)
        drawn = pictures.read_image(llvmpipe, frame, triangles, options)
        assert np.array_equal(drawn, pictures.read_image(reference, frame, triangles, options))


def test_multisampling_counts_more_fragments_and_softens_edges(llvmpipe):
    frame, triangles = loose_triangles([[300, 300], [15000, 900], [2000, 14000]], 64)
    one = llvmpipe.draw_and_count(frame, triangles, Options())
    four = llvmpipe.draw_and_count(frame, triangles, Options(samples=4))
    assert four["fragments"][0] > one["fragments"][0]
    assert 4 * four["quads"][0] == four["fragments"][0] + four["helper_lanes"][0]
    area = pictures.read_image(llvmpipe, frame, triangles, Options(samples=4))[..., 3].sum() / 255
    assert area == pytest.approx(four["samples_passed"] / 4, rel=0.01)


def test_fragment_work_changes_no_pixel(llvmpipe):
    frame, triangles = random_triangles(seed=10, size=256, number=30, grid=64)
    images = []
    for work in (200, 0):
        images.append(pictures.read_image(llvmpipe, frame, triangles, Options(work=work)))
        with llvmpipe.prepare(frame, triangles, Options(work=work)) as drawing:
            drawing.sample(1)
            assert drawing.program["work"].value == work
    assert np.array_equal(*images)


def test_textured_pixels_are_as_bright_as_the_mean_of_the_texture(llvmpipe):
    frame, triangles = loose_triangles([[256, 256], [255 * 256, 256], [256, 255 * 256]], 256)
    plain = pictures.read_image(llvmpipe, frame, triangles, Options()).astype(float)
    covered = plain[..., 3] > 0
    for lookups in (1, 4):
        options = Options(texture=lookups)
        drawn = pictures.read_image(llvmpipe, frame, triangles, options).astype(float)
        assert np.array_equal(drawn[..., 3], plain[..., 3])
        bright = drawn[covered, :3] / plain[covered, :3]
        assert bright.mean() == pytest.approx((128 + 255) / 2 / 255, rel=0.02)
        assert bright.std() > 0.01  # of neighbouring pixels of one triangle
        with llvmpipe.prepare(frame, triangles, options) as drawing:
            drawing.sample(1)
            assert drawing.program["lookups"].value == lookups
        counted = (llvmpipe.draw_and_count(frame, triangles, each) for each in (Options(), options))
        assert find_disagreements(frame, *counted) == []


@pytest.mark.parametrize(("software", "calls"), [(True, [1] * 10), (False, [10])])
def test_every_repeat_is_drawn(llvmpipe, software, calls):
    """A CPU has a call for each repeat, a GPU instances of one call; llvmpipe can use both."""
    frame, triangles = loose_triangles([[256, 256], [255 * 256, 256], [256, 255 * 256]] * 3, 256)
    with llvmpipe.prepare(frame, triangles, Options()) as drawing:
        drawing.software = software
        drawn, draw = [], drawing.draw_rows
        drawing.draw_rows = lambda rows, n=1: [drawn.append(n), draw(rows, n)]
        assert drawing.sample(10).wall > 0
    assert drawn == calls


def test_two_rasterisers_share_a_process(opened, reference):
    """Each makes its own context current, also while the other's drawings are alive."""
    frame, triangles = random_triangles(seed=13, size=128, number=30, grid=1)
    exact = reference.draw_and_count(frame, triangles, Options())
    drawer, boxes = opened("opengl"), opened("bounding-box")
    case = (frame, triangles, Options())
    with drawer.prepare(*case) as drawn, boxes.prepare(*case) as walked:
        for _ in range(3):
            assert drawn.sample(1).wall > 0
            assert walked.sample(1).wall > 0
        counted, tested = drawer.draw_and_count(*case), boxes.draw_and_count(*case)
    assert np.array_equal(counted["fragments"], exact["fragments"])
    assert np.array_equal(tested["bbox_tests"], exact["bbox_tests"])


def test_driver_statistics_are_of_one_draw(llvmpipe, monkeypatch):
    angles = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    points = 8192 + 7000 * np.column_stack([np.cos(angles), np.sin(angles)])
    frame = make_bare_frame(64, points.astype("i4"))
    fan = np.array([(0, k, k + 1) for k in range(1, 99)], np.int32)
    whole = llvmpipe.draw_and_count(frame, fan, Options())
    assert whole["clipping_input_primitives"] == 98
    assert whole["clipping_output_primitives"] <= 98
    assert 100 <= whole["vertex_shader_invocations"] <= 3 * 98
    # Batches do not change what is counted.
    monkeypatch.setattr(opengl, "split_batches", lambda _, rows: np.split(rows, [7, 40]))
    parts = llvmpipe.draw_and_count(frame, fan, Options())
    for name in (*SHADED, "samples_passed", "clipping_input_primitives"):
        assert parts[name].tolist() == whole[name].tolist(), name
    monkeypatch.setattr(llvmpipe.context, "statistics", {})
    assert set(llvmpipe.draw_and_count(frame, fan, Options())) == {*SHADED, "samples_passed"}


def test_batches_cannot_overflow_32_bits():
    layer = [[256, 256], [16383 * 256, 256], [256, 16383 * 256]]
    frame, triangles = loose_triangles(layer * 40, 16384)
    parts = split_batches(frame, triangles)
    assert np.array_equal(np.concatenate(parts), triangles)
    assert max(len(part) for part in parts) * 16384**2 < 2**32
    assert len(parts) > 1


def test_too_many_samples_and_pixels_are_refused_with_the_maximum(llvmpipe):
    frame, triangles = random_triangles(seed=1, size=64, number=2, grid=1)
    with pytest.raises(UsageError, match="the maximum is 4"):
        llvmpipe.draw_and_count(frame, triangles, Options(samples=8))
    huge = type(frame)(**{**vars(frame), "width": 40000, "height": 40000})
    with pytest.raises(UsageError, match="40000x40000 px exceeds the device's maximum of"):
        llvmpipe.draw_and_count(huge, triangles, Options())


def test_unexpected_renderer_and_missing_environment_variables_are_refused(llvmpipe):
    details = llvmpipe.device.details
    with pytest.raises(NoRasteriserError, match="gpu0: OpenGL opened 'llvmpipe"):
        get("opengl")(Device("gpu0", software=False, environment={}, details=details))
    device = Device("llvmpipe", True, {"HARNESS_TEST_VARIABLE": "1"}, {"egl_index": 0})
    assert "HARNESS_TEST_VARIABLE" not in os.environ
    with pytest.raises(NoRasteriserError, match="HARNESS_TEST_VARIABLE=1 before the driver loads"):
        get("opengl")(device)


FRAMES = 1000
WARM_UP = 100
ALLOWED_BYTES = 20 * 2**20


@pytest.mark.parametrize("name", ["opengl", "bounding-box", "reference"])
def test_a_thousand_frames_leak_nothing(opened, reference, name):
    rasteriser = reference if name == "reference" else opened(name)
    process = psutil.Process()
    rng = np.random.default_rng(0)
    before = 0
    for number in range(FRAMES + WARM_UP):
        if number == WARM_UP:
            before = process.memory_info().rss
        # Sizes change, so that framebuffers are made and freed too.
        size = int(rng.integers(32, 128)) * 2
        frame, triangles = random_triangles(seed=number, size=size, number=20, grid=1)
        rasteriser.draw_and_count(frame, triangles, Options())
        pictures.read_image(rasteriser, frame, triangles, Options())
        with rasteriser.prepare(frame, triangles, Options()) as drawing:
            drawing.sample(2)
    grown = process.memory_info().rss - before
    assert grown < ALLOWED_BYTES, f"{grown / 2**20:.1f} MiB"
