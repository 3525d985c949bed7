"""Skybox's raster slice against the CPU reference: every count of every triangle."""

import shutil

import numpy as np
import pytest

from harness.errors import HarnessError, UsageError
from harness.frame import WHOLE, View, bare_frame, frame_of
from harness.rasterisers import Options, get
from harness.rasterisers.reference import colours, count_tiles, predict, predict_tiles
from harness.rasterisers.simulated import skybox
from harness.rasterisers.simulated.skybox import edge_functions, run, work
from scenes import load
from scripts.studies.skybox import descent
from tests.simulated.conftest import BESIDE, triangles_of
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
    expected = get("reference")().image(frame, triangles, Options())
    for device in ("skybox", "skybox:output_quads=1,shader=3"):
        design = opened(device)._design
        shader = design.details["design"]["shader"]
        owner, place = run(design._program, todo, whole, shader, keep_quads=True).quads.T
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


MUTANTS = (
    "an edge's extent is forgotten",
    "a queue is popped while its evaluator is stalled",
    "a block does not wait for its other quads",
    "a block does not wait for a full queue",
    "a quad's pixels are transposed",
)

MISTAKES = {
    "VX_raster_te.sv": {
        "(tile_extents[i] >> tile_level)": {1: "((i == 2) ? 0 : (tile_extents[i] >> tile_level))"},
        "fifo_arb_onehot[i] && ~output_stall": {2: "fifo_arb_onehot[i]"},
    },
    "VX_raster_be.sv": {
        "fifo_valid_in && (~fifo_ready_in || ~batch_sent_all)": {
            3: "fifo_valid_in && ~fifo_ready_in",
            4: "fifo_valid_in && fifo_ready_in && ~batch_sent_all",
        },
    },
    "VX_raster_qe.sv": {
        "i * edges_in[q][k][0] + j * edges_in[q][k][1]": {
            5: "j * edges_in[q][k][0] + i * edges_in[q][k][1]"
        },
    },
}
"""File -> what stands there -> what stands there in a mutant, by its number."""

COUNTED = ("fragments", "quads", "partial_quads")

CHOICE = 'int mutant; initial if (!$value$plusargs("mutant=%d", mutant)) mutant = 0;\n'


def all_in_one(folder):
    """Write sources that are the mutant whose number the program is told, or none of them."""
    shutil.copytree(BESIDE / "hw" / "rtl", folder)
    for name, mistakes in MISTAKES.items():
        file = folder / "raster" / name
        text = file.read_text()
        for right, others in mistakes.items():
            assert text.count(right) == 1, right
            chosen = right
            for number, wrong in others.items():
                chosen = f"((mutant == {number}) ? ({wrong}) : ({chosen}))"
            text = text.replace(right, chosen)
        body = text.index(");", text.index("module VX_raster")) + 3
        file.write_text(text[:body] + CHOICE + text[body:])
    return folder


def test_five_mutants_are_seen_and_three_of_them_by_back_pressure_alone(buildable, tmp_path):
    parameters = {"TILE_LOGSIZE": 5, "BLOCK_LOGSIZE": 2}
    rtl = all_in_one(tmp_path / "rtl")
    frame, triangles = triangles_of(128, 30, seed=8)
    whole = np.array([0, 0, 127, 127], np.int64)
    todo = work(frame.points, triangles, [slice(0, len(triangles))], whole, 32, exact=False)
    expected = predict(frame.points, triangles)

    def seen(output_quads: int, shader: float) -> list[int]:
        file, _ = skybox.program(rtl, {**parameters, "OUTPUT_QUADS": output_quads})
        found, sound = [], None
        for number in range(len(MUTANTS) + 1):
            script = tmp_path / f"mutant-{number}"
            script.write_text(f"#!/bin/sh\nexec timeout 60 {file} +mutant={number}\n")
            script.chmod(0o755)
            try:
                drawn = skybox.run(script, todo, whole, shader, keep_quads=True)
            except HarnessError:
                found.append(number)
                continue
            columns = dict(zip(skybox.COUNTS, drawn.counts.T, strict=True))
            right = all((columns[name] == expected[name]).all() for name in COUNTED)
            quads = drawn.quads.tolist()  # where and with which mask: counts miss a transposition
            sound = quads if number == 0 else sound
            if not right or quads != sound:
                found.append(number)
        return found

    assert seen(1, shader=3) == [1, 2, 3, 4, 5]
    assert seen(4, shader=0) == [1, 5]
