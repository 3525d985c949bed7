"""The optimum in compute shaders: on llvmpipe it is the CPU's, triangle for triangle."""

import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.frame import View, make_frame
from scenes import load
from tests.triangulators.cases import convex, hard_polygons, random_simple, shared, star, with_hole
from triangulators import UnknownName, triangulate_many, vertices
from triangulators.batch.ragged import ragged
from triangulators.gpu import engine
from triangulators.gpu.device_context import open_context
from triangulators.gpu.large import LargeRings, batches
from triangulators.gpu.rings import LARGE, MOST, ON_CPU, Rings, prepare
from triangulators.optimum.edge_table import (
    _NONE,
    _spread,
    _trace_lists,
    _trace_table,
    fill_lists,
    fill_table,
    most_squares,
    weights_of_pairs,
)
from triangulators.polygon import boundary
from triangulators.starting.starts import cycle_of
from triangulators.verify import verify

NAME = "optimal:half-perimeter"
WORST = "worst:half-perimeter"


@pytest.fixture(scope="module", autouse=True)
def _closed_in_the_end():
    yield
    engine.close_all()


@pytest.fixture
def done(monkeypatch):
    """How many polygons the device did, batch by batch."""
    counts = []
    attempt = engine.attempt

    def counted(name, task, threads):
        attempt(name, task, threads)
        counts.append(int(task.batch.done.sum()))

    monkeypatch.setattr(engine, "attempt", counted)
    return counts


def assert_same(polygons, name=NAME, **parameters):
    """The device gives what the CPU gives; returns it."""
    found, expected = (
        triangulate_many(polygons, name, device=device, **parameters)
        for device in ("llvmpipe", "cpu")
    )
    assert found.failed == expected.failed
    assert np.array_equal(found.starts, expected.starts)
    for number, (ours, theirs) in enumerate(zip(found, expected, strict=True)):
        assert np.array_equal(ours, theirs), number
    return found


def on_grid(points, step=1 / 256):
    return shapely.Polygon(np.round(np.asarray(points) / step) * step)


def comb(n):
    """A ring of n corners on a small grid: teeth, between whose tips all diagonals are ties."""
    teeth = (n - 2) // 4
    rows = []
    for tooth in range(teeth):
        rows += [(2 * tooth, 0), (2 * tooth, 3), (2 * tooth + 1, 3), (2 * tooth + 1, 0)]
    rest = n - len(rows)
    rows += [(2 * teeth + 1, -1 - k) for k in range(rest - 1)] + [(-2, -1 - rest)]
    return shapely.Polygon(rows)


def rectangle(across, up):
    """A rectangle with a corner at each whole step of its sides: nothing but ties."""
    bottom = [(x, 0) for x in range(across)]
    right = [(across, y) for y in range(up)]
    top = [(x, up) for x in range(across, 0, -1)]
    left = [(0, y) for y in range(up, 0, -1)]
    return shapely.Polygon(bottom + right + top + left)


@pytest.mark.parametrize("name", [NAME, WORST])
def test_small_rings_of_every_size(name, done):
    rng = np.random.default_rng(5)
    polygons = [random_simple(rng, n, 40) for n in range(3, 24)]
    polygons += [star(n, seed=n) for n in (15, 16, 17, 31, 32, 33, 48, 62, 63, 64)]
    polygons += [on_grid(vertices(convex(n))) for n in (3, 4, 16, 17, 63, 64)]
    polygons += [rectangle(*sides) for sides in ((1, 1), (2, 1), (4, 4), (8, 8), (16, 15), (31, 1))]
    polygons += [shapely.reverse(polygon) for polygon in polygons]
    assert_same(polygons, name)
    assert done == [len(polygons)]


@pytest.mark.parametrize("name", [NAME, WORST])
def test_large_rings_at_the_borders_of_tiles(name, done):
    polygons = [star(n, seed=n) for n in (65, 95, 96, 97, 128, 129, 192, 193, 225)]
    polygons += [on_grid(vertices(convex(n))) for n in (65, 96, 192, 193)]
    polygons += [rectangle(20, 13), rectangle(60, 38), comb(129), comb(200)]
    polygons += [shapely.reverse(polygon) for polygon in polygons[::3]]
    assert_same(polygons, name)
    assert done == [len(polygons)]


def both_ways(polygon):
    """Triangles (n - 2, 3) of a ring by the table and by lists of visible pairs, and squares."""
    ring = cycle_of(boundary(polygon), "test")
    n = len(ring.cycle)
    weight = weights_of_pairs(ring.points, ring.start, ring.target, np.array([1.0, 0.0, 0.0]))
    none = _NONE[weight.dtype]
    table = _spread(n, ring.start, ring.target, weight, none)
    fill_table(table, none)
    filled = fill_lists(n, ring.start, ring.target, weight, none)
    lists = _trace_lists(n, ring.start, ring.target, filled, none)
    seen = np.bincount(ring.target, minlength=n)
    return _trace_table(table, none), lists, int(np.dot(seen, seen))


@pytest.mark.parametrize(
    ("make", "by_table"), [(lambda: rectangle(60, 38), True), (lambda: comb(200), False)]
)
def test_ties_of_large_rings_are_broken_as_the_way_that_is_taken_has_it(make, by_table, done):
    polygon = make()
    table, lists, squares = both_ways(polygon)
    assert not np.array_equal(table, lists)
    assert (squares > most_squares(len(vertices(polygon)))) == by_table
    assert_same([polygon])
    assert done == [1]


def frame_of(scene, size=512):
    return make_frame(load(scene).polygons, View(size)).polygons


@pytest.mark.parametrize("scene", ["city:buildings=400", "stress", "paper"])
def test_scenes_in_pixels(scene, done):
    polygons = frame_of(scene)
    assert_same(polygons)
    rings = [
        polygon for polygon in polygons if not polygon.interiors and len(vertices(polygon)) <= MOST
    ]
    assert done[0] >= 0.95 * len(rings)


def test_real_buildings(done):
    polygons = [polygon for _, polygon in shared("helsinki.json")][:300]
    moved = [shapely.transform(p, lambda points: np.round(points * 4) / 4) for p in polygons]
    assert_same(moved)
    assert done[0] > 200


@settings(max_examples=40, deadline=None)
@given(
    polygons=st.lists(hard_polygons(), min_size=1, max_size=6), name=st.sampled_from([NAME, WORST])
)
def test_collinear_corners_slivers_and_repeated_ones(polygons, name):
    assert_same(polygons, name)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), corners=st.integers(65, 110))
def test_large_rings_at_random(seed, corners):
    rng = np.random.default_rng(seed)
    radius = rng.integers(3, 9, corners)
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    polygon = on_grid(np.column_stack((radius * np.cos(angle), radius * np.sin(angle))), 1 / 8)
    assert_same([polygon, shapely.reverse(polygon)])


def tall(corners, span):
    """A ring of whole numbers, `span` high and 2 wide: its zigzag turns by next to nothing."""
    half = corners // 2
    up = np.linspace(0, span, half).astype(int)
    down = np.linspace(span, 0, corners - half).astype(int)
    right = np.column_stack((np.full(half, 2), up))
    left = np.column_stack((np.zeros(corners - half, int), down))
    left[1:-1:2, 0] += 1
    return shapely.Polygon(np.concatenate((right, left)))


@pytest.mark.parametrize("corners", [8, 40, 66])
def test_spans_on_both_sides_of_what_32_bits_orient(corners, done):
    spans = [2**15 - 1, 2**15, 2**15 + 1, 2**20, 2**23]
    polygons = [tall(corners, span) for span in spans]
    assert_same(polygons)
    assert done == [len(polygons)]


def prepared(polygons):
    arrays = ragged(polygons)
    begins = np.r_[0, arrays.ring_ends]
    rings = Rings.of(begins)
    prepare(0, len(polygons), arrays.coordinates, np.ones(len(polygons), bool), MOST, rings)
    return rings


def test_the_guard_of_int32():
    corners = 100
    longest = (2**30 - 1) // corners
    below, above = tall(corners, longest - 2), tall(corners, longest - 1)
    rings = prepared([below, above])
    assert rings.kind.tolist() == [LARGE + 1, ON_CPU]
    assert corners * int(rings.longest[0]) < 2**30 <= corners * (longest + 1)
    assert_same([below, above], WORST)


def test_what_is_not_for_a_device(done):
    rng = np.random.default_rng(3)
    thirds = shapely.transform(star(20), lambda points: points / 3)
    twice = shapely.Polygon([(0, 0), (0, 0), (4, 0), (4, 4), (0, 4)])
    closing = shapely.Polygon([(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (0, 0)])
    bow_tie = shapely.Polygon([(0, 0), (4, 4), (4, 0), (0, 4)])
    long_tie = shapely.Polygon([*vertices(star(70))[:-1], (512, 512), (90, 80)])
    assert not long_tie.is_valid
    polygons = [star(9), thirds, twice, with_hole(rng, 10, 4), bow_tie, shapely.Polygon()]
    polygons += [closing, long_tie, star(65)]
    found = assert_same(polygons)
    assert sorted(found.failed) == [4, 5, 7]
    assert done == [2]
    # Arrays are taken to be valid, but not for what large rings are done by.
    rings = [p for p in polygons if not p.is_empty]
    assert_same(ragged(rings))
    assert done[1] == 2
    for number in (0, 1, 2, 3, 6, 8):
        assert verify(polygons[number], found[number]).conforming


def test_no_polygons_at_all():
    assert_same([])
    assert_same([shapely.Polygon()])


def test_limits(done, caplog):
    engine.close_all()
    assert_same([star(20), star(100)], limit=50)
    assert done == [1]
    assert [record.message for record in caplog.records] == [
        "llvmpipe: 1 polygons have over 50 vertices; the CPU does them"
    ]
    large = star(MOST + 1, spread=0.02)
    assert_same([star(20), large], limit=4000)
    assert done == [1, 1]
    assert "1 polygons have over 2,048 vertices" in caplog.records[-1].message


def test_other_criteria_never_come_near_a_device(done):
    for name in ("optimal:overdraw", "optimal:edge-length", "refined", "fan"):
        assert_same([star(9), star(20)], name)
    assert done == []


def test_several_chunks_and_any_number_of_threads(done, monkeypatch):
    monkeypatch.setattr(engine, "chunk_bounds", partial(engine.chunk_bounds, corners=1000))
    shapes = [star(n, seed=n) for n in (5, 9, 30, 3, 40)]
    arrays = ragged([star(70), *shapes * 60, star(80), *shapes])
    assert len(engine.chunk_bounds(np.r_[0, arrays.ring_ends])) - 1 >= 5
    expected = triangulate_many(arrays, device="cpu")
    for threads in (1, 3):
        found = triangulate_many(arrays, device="llvmpipe", threads=threads)
        assert np.array_equal(found.triangles, expected.triangles)
    assert done == [len(expected)] * 2


def test_chunks_hold_every_polygon_once():
    begins = np.cumsum([0, 5, 0, 0, 7, 30, 3, 0, 4, 0])
    assert engine.chunk_bounds(begins, corners=100) == [0, 9]
    assert engine.chunk_bounds(begins, corners=12) == [0, 4, 5, 8, 9]
    assert engine.chunk_bounds(begins, corners=1)[-1] == 9


def test_callers_in_several_threads_share_the_device():
    polygons = [star(n) for n in (5, 20, 70)]
    expected = triangulate_many(polygons, device="cpu")
    found = []

    def call():
        found.append(triangulate_many(polygons, device="llvmpipe"))

    threads = [threading.Thread(target=call) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    assert all(np.array_equal(each.triangles, expected.triangles) for each in found)


def test_large_rings_are_split_into_batches_that_fit():
    rings = prepared([star(n) for n in (100, 70, 250, 96, 65)])
    area = {0: 128**2, 1: 96**2, 2: 256**2, 3: 96**2, 4: 96**2}
    found = [each.tolist() for each in batches(rings, np.arange(5), 256**2)]
    assert sorted(number for each in found for number in each) == [0, 1, 2, 3, 4]
    assert all(sum(area[number] for number in each) <= 256**2 for each in found)
    assert len(found) == 2
    with pytest.raises(Exception, match="250 corners"):
        list(batches(rings, np.arange(5), 256**2 - 1))


@pytest.fixture
def at_once():
    """A thread to open a context in: the tests' own stays without one."""
    with ThreadPoolExecutor(1) as pool:
        yield lambda function: pool.submit(function).result()


def test_the_longest_chain_is_traced_to_its_end(at_once):
    """llvmpipe ends loops after 65,535 rounds; 2,048 corners in a chain make the most of them."""
    n = MOST
    table = np.ones((n, n), np.int32)
    table[0] = 0
    table[np.arange(n - 1), np.arange(1, n)] = 0

    def trace():
        compute = open_context("llvmpipe")
        rings = LargeRings(compute)
        rings.corners.write(np.zeros((n, 2), np.int32))
        rings.jobs.write(np.array([0, n, 0, 0, n, 0, 0, 0], np.int32))
        rings.table.write(table)
        rings.seen.write(np.zeros(n, np.uint32))
        rings.bases.write(np.zeros(n, np.uint32))
        rings.bind()
        rings.trace(1)
        bases = np.empty(n, np.uint32)
        rings.bases.read_into(bases)
        compute.close()
        return bases

    bases = at_once(trace)
    apexes = np.arange(1, n - 1)
    assert np.array_equal(bases[1:-1], (apexes + 1) << 16)


@pytest.mark.parametrize("make", [comb, convex, star])
def test_what_a_corner_of_the_largest_rings_sees(at_once, make):
    polygon = on_grid(vertices(make(MOST)))
    ring = cycle_of(boundary(polygon), "test")
    rings = prepared([polygon])
    assert rings.kind[0] >= LARGE
    rows = 3

    def look():
        compute = open_context("llvmpipe")
        device = LargeRings(compute)
        device.upload(rings, np.array([0]))
        device.look(rows, 1, wide=True, worst=False)
        table = np.empty((rows, MOST), np.int32)
        device.table.read_into(table)
        compute.close()
        return table

    for i, row in enumerate(at_once(look)):
        expected = ring.target[ring.start[i] : ring.start[i + 1]]
        assert np.array_equal(np.flatnonzero(row < engine.NONE), expected), i


def test_unknown_devices():
    for name in ("cuda", "gpu", "gpu-1", "softpipe"):
        with pytest.raises(UnknownName, match="unknown device"):
            triangulate_many([star(9)], device=name)
