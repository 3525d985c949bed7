"""Skybox's raster slice against the CPU reference: every count of every triangle."""

import numpy as np
import pytest

from harness.errors import HarnessError, UsageError
from harness.frame import WHOLE, View, bare_frame, frame_of
from harness.rasterisers import Options, get
from harness.rasterisers.reference import colours, count_tiles, predict, predict_tiles
from harness.rasterisers.simulated.skybox import edge_functions, run, work
from scenes import load
from tests.rasterisers import pictures
from tests.simulated.conftest import triangles_of
from tests.simulated.descent import descent
from triangulators import triangulate

BUILDS = ("skybox", "skybox:output_quads=1,tile=64", "skybox:output_quads=2,tile=16,block=8")
"""Each value of each parameter that is built in, once at least; `make endurance` has all."""

DRAWN = ("", "bins=exact", "shader=3", "shader=0.5,fetch=40")
"""Parameters of a run, for a build."""

EXACT = ("fragments", "quads", "helper_lanes", "partial_quads")


def with_parameters(device: str, more: str) -> str:
    return f"{device}{',' if ':' in device else ':'}{more}" if more else device


def assert_exact(drawn, frame, triangles, device):
    expected = predict(frame.points, triangles, frame.window)
    tile = next((size for size in ("16", "64") if f"tile={size}" in device), "32")
    tiles = predict_tiles(frame.points, triangles, frame.window)
    expected["tiles"] = tiles[f"tiles_{tile}{'_exact' if 'exact' in device else ''}"]
    for name in (*EXACT, "tiles"):
        np.testing.assert_array_equal(drawn[name], expected[name], f"{device}: {name}")


@pytest.mark.parametrize(("size", "number"), [(64, 300), (256, 600), (1024, 100)])
def test_every_count_of_every_kind_of_triangle_is_the_references(opened, size, number):
    frame, triangles = triangles_of(size, number, seed=1)
    assert_exact(opened("skybox").count(frame, triangles, Options()), frame, triangles, "skybox")


@pytest.mark.parametrize("build", BUILDS)
@pytest.mark.parametrize("more", DRAWN)
def test_no_parameter_changes_what_is_covered(opened, build, more):
    device = with_parameters(build, more)
    frame, triangles = triangles_of(64, 40, seed=2)
    assert_exact(opened(device).count(frame, triangles, Options()), frame, triangles, device)


@pytest.mark.parametrize("scene", ["city", "glyphs", "stress"])
def test_every_polygon_of_a_scene_is_counted_as_by_the_reference(opened, scene):
    frame = frame_of(load(scene), View(256))
    parts = [triangulate(polygon, "ear-clipping") for polygon in frame.polygons]
    triangles = frame.join(parts)
    drawn = opened("skybox").count(frame, triangles, Options())
    expected = get("reference")().count(frame, triangles, Options())
    for name in EXACT:
        np.testing.assert_array_equal(drawn[name], expected[name])


def test_the_pixels_that_are_covered_are_the_references(opened):
    frame, triangles = triangles_of(64, 20, seed=3)
    whole = np.array([0, 0, 63, 63], np.int64)
    todo = work(frame.points, triangles, [slice(0, len(triangles))], whole, 32, exact=False)
    expected = pictures.image_of(get("reference")(), frame, triangles, Options())
    for device in ("skybox", "skybox:output_quads=1,shader=3"):
        design = opened(device)._design
        shader = design.details["design"]["shader"]
        _, _, quads = run(design._program, todo, whole, shader, keep_quads=True)
        owner, place = quads.T
        picture = np.zeros((64, 64), np.uint32)
        for bit in range(4):
            covered = place >> bit & 1 == 1
            x = (place[covered] >> 4 & 0x3FFF) * 2 + bit % 2
            y = (place[covered] >> 18) * 2 + bit // 2
            picture[63 - y, x] = colours(frame.owner(triangles))[owner[covered]]
        np.testing.assert_array_equal(picture, expected.view(np.uint32)[..., 0])


def test_a_triangle_that_32_bits_do_not_hold_is_refused_in_a_line(opened):
    largest = np.array([[0, 0], [1024, 0], [1024, 1024], [0, 1024]], np.int32) * 256
    both = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    drawn = opened("skybox").count(bare_frame(1024, largest), both, Options())
    assert drawn["fragments"].sum() == 1024**2
    with pytest.raises(UsageError, match=r"32 bits, too few for a triangle of 4096 px: choose"):
        opened("skybox").count(bare_frame(4096, largest * 4), both, Options())


def test_an_edge_function_is_the_same_test_with_eight_bits_less():
    frame, triangles = triangles_of(64, 10, seed=4)
    edges = edge_functions(frame.points, triangles)
    x, y = np.meshgrid(np.arange(64), np.arange(64))
    values = edges[..., 0, None, None] * x + edges[..., 1, None, None] * y
    inside = (values + edges[..., 2, None, None] >= 0).all(axis=1)
    expected = predict(frame.points, triangles)["fragments"]
    corners = frame.points[triangles].astype(np.int64)
    first, second = (corners[:, k] - corners[:, 0] for k in (1, 2))
    flat = first[:, 0] * second[:, 1] == first[:, 1] * second[:, 0]
    np.testing.assert_array_equal(inside.sum(axis=(1, 2))[~flat], expected[~flat])


def test_cycles_are_the_same_at_every_run_and_grow_with_the_shader(opened):
    frame, triangles = triangles_of(128, 30, 5, ("any",))

    def cycles(device):
        return int(opened(device).count(frame, triangles, Options())["cycles"])

    assert cycles("skybox") == cycles("skybox")
    quads = int(predict(frame.points, triangles)["quads"].sum())
    slow = cycles("skybox:shader=16")
    assert 16 * quads <= slow < 16 * quads * 1.02 + 100
    assert cycles("skybox") <= cycles("skybox:output_quads=1") < slow
    tiles = int(predict_tiles(frame.points, triangles)["tiles_32"].sum())
    assert 500 * (tiles - 1) < cycles("skybox:fetch=500") < 500 * tiles + 200


def test_a_draw_lasts_until_its_last_quad_is_shaded(opened):
    """One pixel: up to its quad's coming out nothing depends on the shader."""
    points = np.array([[10, 10], [200, 10], [10, 500]], np.int32)
    one = np.array([[0, 1, 2]], np.int32)

    def cycles(device):
        return int(opened(device).count(bare_frame(8, points), one, Options())["cycles"])

    assert cycles("skybox:shader=100") - cycles("skybox:shader=50") == 50
    assert cycles("skybox") < 40


DRAIN = 5
"""Most cycles from a draw's last square to the end of what follows, where nothing holds it up."""


@pytest.mark.parametrize(
    ("device", "tile", "block"), [*zip(BUILDS, (32, 64, 16), (4, 4, 8), strict=True)]
)
def test_the_descent_tests_the_squares_that_the_slice_tests(opened, device, tile, block):
    frame, triangles = triangles_of(128, 30, seed=6)
    drawn = opened(device).count(frame, triangles, Options())
    counts = descent(frame, triangles, tile, block)
    np.testing.assert_array_equal(counts[:, 0], drawn["nodes"])
    np.testing.assert_array_equal(counts[:, 1], drawn["tested_blocks"])


@pytest.mark.parametrize("scene", ["city:buildings=60", "glyphs:limit=20"])
@pytest.mark.parametrize("size", [256, 1024])
@pytest.mark.parametrize("name", ["ear-clipping", "optimal:half-perimeter"])
def test_squares_predict_the_cycles_of_a_scene_but_for_what_follows_the_last(
    opened, scene, size, name
):
    frame = frame_of(load(scene), View(size))
    base, _, criterion = name.partition(":")
    chosen = {"criterion": criterion} if criterion else {}
    triangles = frame.join([triangulate(p, base, **chosen) for p in frame.polygons])
    drawn = opened("skybox").count(frame, triangles, Options())
    assert 0 <= int(drawn["cycles"]) - descent(frame, triangles, 32, 4)[:, 2].sum() <= DRAIN


@pytest.mark.parametrize("side", [2, 4, 8, 16, 32])
def test_the_mean_number_of_squares_follows_half_perimeter_and_area(side):
    """Monte Carlo over positions: 1 + H / s + S / s^2, to three standard errors."""
    rng = np.random.default_rng(7)
    for _ in range(8):
        shape = rng.integers(-60 * 256, 60 * 256, (3, 2))
        (ax, ay), (bx, by) = shape[1] - shape[0], shape[2] - shape[0]
        doubled = int(ax * by - ay * bx)
        shape = shape if doubled > 0 else shape[::-1]
        moves = rng.integers(128 * 256, 256 * 256, (4000, 1, 2))
        points = (shape + moves).reshape(-1, 2).astype(np.int32)
        rows = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
        found = count_tiles(points, rows, side * 256, WHOLE)[:, 1]
        area = np.float64(abs(doubled) / 2 / 256**2)
        half_perimeter = np.float64(np.ptp(shape, axis=0).sum() / 256)
        mean = 1 + half_perimeter / side + area / side**2
        error = found.std() / np.sqrt(len(found))
        assert abs(found.mean() - mean) < 3.5 * error + 1e-9


def test_a_program_that_fails_is_told_in_a_line(tmp_path):
    frame, triangles = triangles_of(64, 1, seed=8)
    whole = np.array([0, 0, 63, 63], np.int64)
    todo = work(frame.points, triangles, [slice(0, len(triangles))], whole, 32, exact=False)
    (tmp_path / "stuck").write_text("#!/bin/sh\ncat > /dev/null; echo stuck >&2; exit 3\n")
    (tmp_path / "stuck").chmod(0o755)
    with pytest.raises(HarnessError, match=r"^stuck$"):
        run(tmp_path / "stuck", todo, whole)
