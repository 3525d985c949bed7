"""Counters and pictures of each device, in separate processes, compared with the reference."""

import numpy as np

from harness.measuring import tasks
from harness.rasterisers import Options, get, names
from harness.rasterisers.reference import SHADED, find_disagreements
from tests.rasterisers import pictures
from tests.rasterisers.conftest import (
    loose_triangles,
    open_on,
    random_triangles,
    require_reference_counts,
)


def test_counters_and_pixels_equal_the_reference_for_every_polygon(on_device, reference):
    for size in (64, 250, 1024):
        for grid in (1, 128):
            case = random_triangles(seed=size + grid, size=size, number=150, grid=grid)
            require_reference_counts(on_device, reference, *case)
            drawn = on_device[1](pictures.draw_image, *case, Options())
            expected = pictures.read_image(reference, *case, Options())
            assert np.array_equal(drawn[..., 3] > 0, expected[..., 3] > 0)
    layer = [[256, 256], [255 * 256, 256], [256, 255 * 256]]  # hidden layers are counted, too
    require_reference_counts(on_device, reference, *loose_triangles(layer * 20, 256))


def test_no_triangles_count_and_draw_nothing(on_device, reference):
    frame, _ = loose_triangles([[256, 256], [2560, 512], [768, 2048]], 16)
    case = (frame, np.empty((0, 3), np.int32), Options())
    _, call = on_device
    for counters in (call(tasks.draw_and_count, *case), reference.draw_and_count(*case)):
        assert not any(np.any(values) for values in counters.values())
    assert not call(pictures.draw_image, *case).any()
    assert not pictures.read_image(reference, *case).any()


def test_rasterisers_that_count_quads_count_partial_quads():
    of_quads = [name for name in names() if "quads" in get(name).counters]
    assert {"opengl", "osmesa", "webgpu", "reference"} <= set(of_quads)
    assert all(set(get(name).counters) >= set(SHADED) for name in of_quads)


def test_softpipe_counts_the_quads_of_its_own_pictures():
    frame, triangles = random_triangles(seed=7, size=64, number=12, grid=1)
    with open_on("opengl", "softpipe") as call:
        for number, triangle in enumerate(triangles):
            case = (frame, triangle[None], Options())
            drawn = call(tasks.draw_and_count, *case)
            picture = call(pictures.draw_image, *case)[::-1, :, 3] > 0
            lanes = picture.reshape(32, 2, 32, 2).sum(axis=(1, 3))
            counted = [drawn[name][number] for name in SHADED]
            quads, partial = (lanes > 0).sum(), ((lanes > 0) & (lanes < 4)).sum()
            assert counted == [lanes.sum(), quads, 4 * quads - lanes.sum(), partial, quads > 0]


def test_disagreements_name_counter_and_polygon():
    frame, _ = loose_triangles([[0, 0], [512, 0], [0, 512]] * 3, 8)
    expected = {"fragments": np.array([1, 2, 3]), "blocks": np.array([1, 1, 1])}
    drawn = {"fragments": np.array([1, 5, 4]), "samples_passed": np.array(10)}
    (sentence,) = find_disagreements(frame, drawn, expected)
    assert sentence == "fragments differ in 2 of 3 polygons; polygon 1: 5 instead of 2"
