"""The optimum in compute shaders: llvmpipe's triangles equal the CPU's."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.frame import View, make_frame
from scenes import load
from tests.triangulators.cases import (
    convex,
    hard_polygons,
    random_simple,
    read_shared,
    snapped,
    star,
    with_hole,
)
from triangulators import UnknownNameError, criteria, triangulate_many, vertices
from triangulators.gpu import engine
from triangulators.gpu.rings import KINDS, MAX_VERTICES, ON_CPU, Rings, prepare_rings
from triangulators.methods.exhaustive import enumerate_triangulations
from triangulators.polygon_arrays import PolygonArray
from triangulators.verify import verify

NAME = "optimal:half-perimeter"
WORST = "worst:half-perimeter"
QUADS = "optimal:expected-quads"
NAMES = (NAME, WORST, QUADS, "worst:expected-quads")


@pytest.fixture(scope="module", autouse=True)
def _closed_in_the_end():
    yield
    engine.close_all()


def assert_same(polygons, name=NAME, on="llvmpipe", **parameters):
    by_device, expected = (
        triangulate_many(polygons, name, device=device, **parameters) for device in (on, "cpu")
    )
    assert by_device.failed == expected.failed
    assert np.array_equal(by_device.triangle_offsets, expected.triangle_offsets)
    for number, (ours, theirs) in enumerate(zip(by_device, expected, strict=True)):
        assert np.array_equal(ours, theirs), number
    return by_device


def rectangle(across, up):
    """A rectangle with a vertex at each integer step of its sides: only ties."""
    bottom = [(x, 0) for x in range(across)]
    right = [(across, y) for y in range(up)]
    top = [(x, up) for x in range(across, 0, -1)]
    left = [(0, y) for y in range(up, 0, -1)]
    return shapely.Polygon(bottom + right + top + left)


@pytest.mark.parametrize("name", NAMES)
def test_small_rings_of_every_size(name, device_counts):
    rng = np.random.default_rng(5)
    polygons = [random_simple(rng, n, 40) for n in range(3, 24)]
    polygons += [star(n, seed=n) for n in (15, 16, 17, 31, 32, 33, 48, 62, 63, 64)]
    polygons += [snapped(vertices(convex(n))) for n in (3, 4, 16, 17, 63, 64)]
    polygons += [rectangle(*sides) for sides in ((1, 1), (2, 1), (4, 4), (8, 8), (16, 15), (31, 1))]
    polygons += [shapely.reverse(polygon) for polygon in polygons]
    assert_same(polygons, name)
    assert device_counts == [len(polygons)]


@pytest.mark.parametrize(
    ("source", "name"),
    [(source, NAME) for source in ("city:buildings=400", "stress", "paper", "helsinki.json")]
    + [("city:buildings=400", QUADS), ("glyphs", QUADS)],
)
def test_scenes_in_pixels_and_real_buildings(source, name, device_counts):
    if source == "helsinki.json":
        real = [polygon for _, polygon in read_shared(source)][:300]
        polygons = [shapely.transform(p, lambda xy: np.round(xy * 4) / 4) for p in real]
    else:
        polygons = make_frame(load(source).polygons, View(512)).polygons
    rings = [p for p in polygons if p.is_valid and not p.interiors]
    rings = [p for p in rings if len(vertices(p)) <= MAX_VERTICES]
    assert_same(rings if name == QUADS else polygons, name)
    assert device_counts[0] >= 0.95 * len(rings)


@settings(max_examples=40, deadline=None)
@given(polygons=st.lists(hard_polygons(), min_size=1, max_size=6), name=st.sampled_from(NAMES))
def test_collinear_corners_slivers_and_repeated_ones(polygons, name):
    assert_same(polygons, name)


@pytest.mark.parametrize("step", [1 / 256, 1 / 4, 1, 32])
def test_expected_quads_equal_best_of_all_triangulations(step, device_counts):
    rng, criterion = np.random.default_rng(6), criteria.find("expected-quads")
    polygons = [random_simple(rng, n, 40) for n in (3, 4, 5, 6, 7, 8, 9) for _ in range(6)]
    polygons = [shapely.transform(polygon, lambda xy: xy * step) for polygon in polygons]
    for name, extreme in ((QUADS, min), ("worst:expected-quads", max)):
        results = triangulate_many(polygons, name, device="llvmpipe")
        for polygon, triangles in zip(polygons, results, strict=True):
            points = vertices(polygon)
            assert verify(polygon, triangles).conforming
            totals = [criterion.total(points, t) for t in enumerate_triangulations(polygon)]
            assert criterion.total(points, triangles) == pytest.approx(extreme(totals), rel=1e-12)
    assert device_counts == [len(polygons)] * 2


def tall(corners, span):
    """An integer zigzag ring, `span` high and 2 wide, with minimal turns."""
    half = corners // 2
    up = np.linspace(0, span, half).astype(int)
    down = np.linspace(span, 0, corners - half).astype(int)
    right = np.column_stack((np.full(half, 2), up))
    left = np.column_stack((np.zeros(corners - half, int), down))
    left[1:-1:2, 0] += 1
    return shapely.Polygon(np.concatenate((right, left)))


@pytest.mark.parametrize("name", [NAME, QUADS])
@pytest.mark.parametrize("corners", [8, 40, 64])
def test_spans_around_int32_orientation_limit(corners, name, device_counts):
    spans = [2**15 - 1, 2**15, 2**15 + 1, 2**20, 2**23]
    polygons = [tall(corners, span) for span in spans]
    assert_same(polygons, name)
    assert device_counts == [len(polygons)]


def prepared(polygons):
    arrays = PolygonArray.from_shapely(polygons)
    rings = Rings.allocate(arrays.vertex_offsets)
    prepare_rings(arrays.coords, np.ones(len(polygons), bool), MAX_VERTICES, rings)
    return rings


def test_int32_limit():
    """60 vertices of a square ring may have sums beyond 2^30 on a grid of 2^24."""
    corners, high = 60, 2**23
    widest = (2**30 - 1) // corners - high
    below, above = (
        shapely.transform(tall(corners, high), lambda xy, w=w: np.where(xy == [2, -1], w, xy))
        for w in (widest, widest + 1)
    )
    rings = prepared([below, above])
    assert rings.kind.tolist() == [KINDS - 1, ON_CPU]
    assert corners * int(rings.longest[0]) < 2**30 <= corners * (int(rings.longest[0]) + 1)
    assert_same([below, above], WORST)


@pytest.mark.parametrize("name", [NAME, QUADS])
def test_unsupported_polygons_equal_cpu(name, device_counts):
    rng = np.random.default_rng(3)
    thirds = shapely.transform(star(20), lambda points: points / 3)
    twice = shapely.Polygon([(0, 0), (0, 0), (4, 0), (4, 4), (0, 4)])
    closing = shapely.Polygon([(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (0, 0)])
    bow_tie = shapely.Polygon([(0, 0), (4, 4), (4, 0), (0, 4)])
    polygons = [star(9), thirds, twice, with_hole(rng, 10, 4), bow_tie, shapely.Polygon()]
    polygons += [closing, star(65)]
    by_device = assert_same(polygons, name)
    assert sorted(by_device.failed) == [4, 5]
    assert device_counts == [1]
    # Arrays are taken to be valid.
    rings = [p for p in polygons if not p.is_empty]
    assert_same(PolygonArray.from_shapely(rings), name)
    assert device_counts[1] == 1
    for number in (0, 1, 2, 3, 6, 7):
        assert verify(polygons[number], by_device[number]).conforming


def test_limits(device_counts):
    assert_same([])
    assert_same([star(20), star(60)], limit=50)
    assert_same([star(20), star(MAX_VERTICES), star(MAX_VERTICES + 1)])
    assert device_counts == [0, 1, 2]


def test_other_criteria_do_not_open_device(device_counts):
    others = ("optimal:overdraw", "optimal:edge-length", "optimal:expected-blocks")
    for name in (*others, "refined:expected-quads", "fan"):
        assert_same([star(9), star(20)], name)
    assert device_counts == []


def test_chunks_and_threads_do_not_change_results(device_counts, monkeypatch):
    find_bounds = partial(engine.find_chunk_bounds, corners=1000)
    monkeypatch.setattr(engine, "find_chunk_bounds", find_bounds)
    shapes = [star(n, seed=n) for n in (5, 9, 30, 3, 40)]
    arrays = PolygonArray.from_shapely([star(60), *shapes * 60, star(50), *shapes])
    assert len(engine.find_chunk_bounds(arrays.vertex_offsets)) - 1 >= 5
    expected = triangulate_many(arrays, device="cpu")
    for threads in (1, 3):
        batch = triangulate_many(arrays, device="llvmpipe", threads=threads)
        assert np.array_equal(batch.triangles, expected.triangles)
    assert device_counts == [len(expected)] * 2


def test_units_beyond_a_float_are_left_to_the_cpu(device_counts):
    units = (2.0**64, 2.0**65, 2.0**-64, 2.0**-65)
    polygons = [shapely.box(0, 0, 3 * unit, unit) for unit in units]
    assert prepared(polygons).kind.tolist() == [0, ON_CPU, 0, ON_CPU]
    assert_same(polygons)
    assert_same(polygons, QUADS)
    assert device_counts == [2, 2]


def test_chunks_partition_polygons():
    offsets = np.cumsum([0, 5, 0, 0, 7, 30, 3, 0, 4, 0])
    assert engine.find_chunk_bounds(offsets, corners=100) == [0, 9]
    assert engine.find_chunk_bounds(offsets, corners=12) == [0, 4, 5, 8, 9]
    assert engine.find_chunk_bounds(offsets, corners=1)[-1] == 9


def test_threads_share_device():
    polygons = [star(n) for n in (5, 20, 60)]
    expected = triangulate_many(polygons, device="cpu")
    with ThreadPoolExecutor(4) as pool:
        running = [pool.submit(triangulate_many, polygons, device="llvmpipe") for _ in range(4)]
    for task in running:
        assert np.array_equal(task.result().triangles, expected.triangles)


def test_unknown_devices():
    for name in ("cuda", "gpu", "gpu-1", "softpipe"):
        with pytest.raises(UnknownNameError, match="unknown device"):
            triangulate_many([star(9)], device=name)
