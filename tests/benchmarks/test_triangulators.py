"""Speed of triangulators, as ratios of two functions timed alternately in one process.

Run with `python -m pytest tests/benchmarks/test_triangulators.py --benchmark-enable -s`.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import mapbox_earcut
import numba
import numpy as np
import pytest
import shapely

from scenes import load
from scripts.studies.expected_quads import BASE, OPTIMUM, REFINED, load_polygons, measure
from tests.paths import run_python
from tests.triangulators.cases import convex, glyphs, read_shared, smooth, snapped, star
from tests.triangulators.test_everywhere import LETTERS, check
from triangulators import PolygonArray, triangulate, triangulate_many, vertices
from triangulators.criteria import predict


def compare(
    benchmark: Any, tested: Callable[[], Any], baseline: Callable[[], Any], rounds: int
) -> float:
    """Return the ratio of the minimum times of two functions called alternately; print it."""
    tested(), baseline()
    times = np.empty((rounds, 2))
    for row in times:
        for column, function in enumerate((tested, baseline)):
            start = time.perf_counter()
            function()
            row[column] = time.perf_counter() - start
    tested_s, baseline_s = times.min(axis=0)
    ratio = tested_s / baseline_s
    benchmark.extra_info.update(ratio=ratio, ours_s=tested_s, theirs_s=baseline_s)
    benchmark.pedantic(tested, rounds=1)
    print(f"\n{benchmark.name}: {tested_s * 1e3:.2f} ms / {baseline_s * 1e3:.2f} ms = {ratio:.2f}")
    return ratio


@numba.njit
def run_min_plus(n: int) -> np.ndarray:
    cost = np.zeros((n, n))
    for span in range(2, n):
        for i in range(n - span):
            best = np.inf
            for k in range(i + 1, i + span):
                best = min(best, cost[i, k] + cost[k, i + span])
            cost[i, i + span] = best
    return cost


def test_convex_1024_against_the_bare_min_plus_loop(benchmark):
    optimum = partial(triangulate, convex(1024), "optimal:overdraw")
    assert compare(benchmark, optimum, lambda: run_min_plus(1024), rounds=3) <= 1.2


@pytest.mark.parametrize(
    ("make", "size", "rounds", "criterion", "max_ratio"),
    [
        (star, 1000, 60, "overdraw", 8.0),
        (star, 1000, 60, "half-perimeter", 4.0),
        (smooth, 10_000, 2, "overdraw", 30.0),
        (smooth, 10_000, 2, "half-perimeter", 30.0),
    ],
)
def test_optimum_against_delaunay(benchmark, make, size, rounds, criterion, max_ratio):
    polygon = make(size)
    optimum = partial(triangulate, polygon, f"optimal:{criterion}")
    delaunay = partial(shapely.constrained_delaunay_triangles, polygon)
    assert compare(benchmark, optimum, delaunay, rounds) <= max_ratio


def run_earcut_loop(polygons: PolygonArray) -> list[np.ndarray]:
    result = []
    for index in range(len(polygons)):
        points, ring_offsets = polygons.rings_of(index)
        ends = ring_offsets[1:].astype(np.uint32)
        result.append(mapbox_earcut.triangulate_float64(points, ends))
    return result


@pytest.mark.parametrize(
    ("name", "max_ratio"),
    [
        ("optimal:half-perimeter", 0.7),
        ("optimal:overdraw", 1.3),
        ("refined:half-perimeter", 1.3),
        ("refined:expected-quads", 2.0),
    ],
)
def test_batch_of_100000_footprints_against_earcut_in_a_loop(benchmark, name, max_ratio):
    arrays = PolygonArray.from_shapely(load("city", buildings=100_000).polygons)
    snapped_arrays = replace(arrays, coords=np.round((arrays.coords + 6000) * 256) / 256)
    batch = partial(triangulate_many, snapped_arrays, name)
    loop = partial(run_earcut_loop, snapped_arrays)
    assert compare(benchmark, batch, loop, rounds=9) <= max_ratio


@pytest.mark.parametrize(
    ("name", "max_ratio"), [("ear-clipping", 2.5), ("optimal:half-perimeter", 4.0), ("fan", 2.5)]
)
def test_one_call_on_15_vertices_against_earcut_with_coordinates_extracted(
    benchmark, name, max_ratio
):
    polygon = snapped(vertices(star(15, spread=0.1)) / 32)

    def earcut() -> np.ndarray:
        points = shapely.get_coordinates(polygon)[:-1]
        return mapbox_earcut.triangulate_float64(points, np.array([len(points)], np.uint32))

    ours = partial(triangulate, polygon, name)
    assert compare(benchmark, ours, earcut, rounds=3000) <= max_ratio


MAX_RATIOS = {  # of the optimum and of refined to ear clipping
    "city": (8.0, 2.5),
    "glyphs": (8.0, 2.5),
    "helsinki": (12.0, 2.5),
    "paper": (8.0, 2.5),
    "cad": (None, 3.5),
    "stress": (None, 2.5),
}
"""By scene. The optimum of `cad` needs linear programs, and a polygon of `stress` has 65 holes."""


@pytest.mark.parametrize("scene", MAX_RATIOS)
def test_expected_quads_against_ear_clipping(benchmark, scene):
    """CPU time of one call per polygon at 1024 px, and how far `refined` is from the optimum."""
    polygons = load_polygons(scene)
    max_optimal, max_refined = MAX_RATIOS[scene]
    names = (BASE, REFINED) if max_optimal is None else (BASE, REFINED, OPTIMUM)
    results = measure(polygons, names, 7)
    ratios = {name: results[name][0] / results[BASE][0] for name in names[1:]}
    benchmark.extra_info.update(ratios)
    benchmark.pedantic(lambda: measure(polygons, (REFINED,), 1), rounds=1)
    print(f"\n{scene}: {ratios}", end="")
    assert ratios[REFINED] <= max_refined
    if max_optimal is not None:
        excess = results[REFINED][1] / results[OPTIMUM][1] - 1.0
        print(f", quads of refined {excess:+.2%}")
        assert ratios[OPTIMUM] <= max_optimal
        assert 0.0 <= excess <= 0.01


def test_hundred_thousand_vertices_finish(benchmark):
    polygon = smooth(100_000)
    start = time.perf_counter()
    triangles = benchmark.pedantic(lambda: triangulate(polygon, "optimal:half-perimeter"), rounds=1)
    elapsed = time.perf_counter() - start
    points = vertices(polygon)
    cost = predict(points, triangles)["half_perimeter"]
    others = {
        name: predict(points, triangulate(polygon, name))["half_perimeter"] / cost
        for name in ("ear-clipping", "delaunay")
    }
    print(f"\n100,000 vertices: {elapsed:.1f} s; relative costs of peers: {others}")
    assert min(others.values()) >= 1.0


FIRST_CALLS = """
import time
start = time.perf_counter()
from tests.triangulators.cases import star
from triangulators import triangulate, triangulate_many
imported = time.perf_counter()
for polygon in (star(30), star(300)):
    for name in ("fan", "ear-clipping", "delaunay", "optimal", "optimal:half-perimeter"):
        try:
            triangulate(polygon, name)
        except Exception as reason:
            assert "fan" in str(reason)
print(imported - start, time.perf_counter() - imported)
"""


def test_first_calls_compile_in_under_20_seconds(tmp_path):
    for label in ("compiling", "from the cache"):
        process = run_python("-c", FIRST_CALLS, env={"NUMBA_CACHE_DIR": str(tmp_path)}, check=True)
        imported, called = map(float, process.stdout.split())
        print(f"\nfirst calls, {label}: import {imported:.1f} s, calls {called:.1f} s")
        assert imported + called < 20.0


def test_every_fixture_building_and_letter():
    counts = [check(polygon, letter) for letter, polygon in glyphs(LETTERS)]
    for name in ("earcut_fixtures.json", "poly2tri_testbed.json", "helsinki.json"):
        counts += [check(polygon, label) for label, polygon in read_shared(name)]
    counts += [check(polygon, index) for index, polygon in enumerate(load("city").polygons)]
    assert sum(count > 0 for count in counts) > 2000
