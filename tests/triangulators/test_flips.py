from fractions import Fraction

import mapbox_earcut
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.paths import run_python
from tests.ports.polygons import earcut_rings
from tests.triangulators.cases import hard_polygons, random_simple, star, with_hole
from tests.triangulators.test_geometry import exact_sign
from tests.triangulators.test_optimal import squared_height
from triangulators import UnknownNameError, criteria, flip, triangulate, triangulate_many, vertices
from triangulators.criteria import CRITERIA
from triangulators.verify import verify

FLIP_TESTS = ("l1", "euclidean", "delaunay", "overdraw", "beauty", "mixed")


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(hard_polygons(), st.sampled_from(FLIP_TESTS))
def test_flips_preserve_validity(polygon, by):
    points = vertices(polygon)
    start = triangulate(polygon, "ear-clipping", repair=True)
    flipped = flip(points, start, by)
    assert (flipped.dtype, flipped.shape) == (np.int32, start.shape)
    assert verify(polygon, flipped).conforming, polygon.wkt
    assert np.array_equal(np.unique(flipped), np.unique(start))


@pytest.mark.parametrize(
    ("name", "by", "criterion"),
    [
        ("flips", "l1", "half-perimeter"),
        ("flips", "euclidean", "edge-length"),
        ("flips", "overdraw", "overdraw"),
        ("flips", "expected-quads", "expected-quads"),
        ("flips", "beauty", "beauty"),
        *(("refined", each, each) for each in CRITERIA if each != "complexity"),
        *(("refined", each, each) for each in ("mixed=1/0.5/0", squared_height)),
    ],
)
def test_result_has_no_gaining_flip(name, by, criterion):
    rng = np.random.default_rng(6)
    resolved = criteria.find(criterion)
    for polygon in [random_simple(rng, 15) for _ in range(20)] + [with_hole(rng, 12, 5), star(90)]:
        triangles = triangulate(polygon, name, criterion=by)
        assert name == "flips" or verify(polygon, triangles).conforming
        if resolved.normalise is None:  # else two triangles have other weights than the polygon
            assert count_gains(polygon, triangles, resolved) == 0


def test_beauty_increases_and_is_invariant_to_motion():
    rng = np.random.default_rng(4)
    total = criteria.find("beauty").total
    gained = 0
    for polygon in [random_simple(rng, 15) for _ in range(20)] + [star(90, spread=0.4)]:
        points, start = vertices(polygon), triangulate(polygon, "ear-clipping", repair=True)
        flipped = flip(points, start, "beauty")
        assert total(points, flipped) <= total(points, start)
        gained += total(points, flipped) < total(points, start)
        for moved in (points @ [[0.0, 8.0], [-8.0, 0.0]], points * 8.0 + 64.0):
            assert np.array_equal(flip(moved, start, "beauty"), flipped)
    assert gained > 10


def test_length_tests_equal_their_criteria():
    polygon = star(120, spread=0.4)
    start = triangulate(polygon, "ear-clipping")
    for by, criterion in (("l1", "half-perimeter"), ("euclidean", "edge-length")):
        same = flip(vertices(polygon), start, criterion)
        assert np.array_equal(flip(vertices(polygon), start, by), same)
        assert not np.array_equal(same, start)


def test_pairs_of_flips_continue_where_no_single_flip_gains():
    """From each of a pentagon's five triangulations, one or two flips lead to any other."""
    rng, cost = np.random.default_rng(3), criteria.find("expected-quads")
    starts = stuck = minima = 0
    for _ in range(60):
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 5))
        points = np.column_stack((60.0 * np.cos(angles), rng.uniform(2.0, 60.0) * np.sin(angles)))
        fans = (np.arange(5)[:, None, None] + np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4)])) % 5
        quads = np.array([cost.total(points, fan) for fan in fans])
        for number, fan in enumerate(fans):
            flipped = cost.total(points, flip(points, fan, "expected-quads"))
            assert flipped <= quads[number]
            starts += 1
            minima += flipped <= quads.min() * (1 + 1e-9)
            neighbours = quads[[(number + 2) % 5, (number + 3) % 5]]  # after one flip
            if quads.min() < quads[number] * (1 - 1e-9) and quads[number] <= neighbours.min():
                stuck += 1
                assert flipped < quads[number]
    assert stuck > 5
    assert minima > 0.9 * starts


def test_scale_is_pixels_per_unit():
    polygon = star(120, spread=0.4)
    points, start = vertices(polygon), triangulate(polygon, "ear-clipping")
    results = []
    for scale in (1 / 64, 1.0, 16.0):
        results.append(flip(points, start, "expected-quads", scale=scale))
        assert np.array_equal(results[-1], flip(points * scale, start, "expected-quads"))
    assert not np.array_equal(results[0], results[2])
    shorter = flip(points, start, "l1")
    assert np.array_equal(flip(points, start, "l1", scale=16.0), shorter)
    for scale in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(ValueError, match="scale must be a positive number"):
            flip(points, start, "expected-quads", scale=scale)


@pytest.mark.parametrize("size", [1, 5000, 2**25])
def test_integer_coordinates_reach_exact_delaunay(size):
    """No vertex is inside a neighbour's circumcircle; tile corners cause many ties."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        outline = random_simple(rng, 16, 9)
        points = vertices(outline) * (size // 8 or 1)
        points += np.rint(rng.uniform(-size / 64, size / 64, points.shape)) * (size > 2**20)
        if not type(outline)(points).is_valid:
            continue
        raw = mapbox_earcut.triangulate_float64(points, np.array([16], np.uint32))
        flipped = flip(points, raw, "delaunay")
        across = {(t[k], t[k - 2]): t[k - 1] for t in flipped.tolist() for k in range(3)}
        for (a, b), c in across.items():
            d = across.get((b, a))
            if d is not None:
                assert is_in_circle(points, a, b, c, d) <= 0 or not is_convex(points[[a, d, b, c]])


def is_in_circle(points, a, b, c, d):
    a, b, c, d = ([Fraction(float(value)) for value in points[row]] for row in (a, b, c, d))
    (p, q), (r, s), (t, u) = [(x - d[0], y - d[1]) for x, y in (a, b, c)]
    one, two, three = p * p + q * q, r * r + s * s, t * t + u * u
    return one * (r * u - s * t) + two * (t * q - u * p) + three * (p * s - q * r)


def is_convex(corners):
    return all(exact_sign(*corners[[k - 2, k - 1, k]].ravel()) > 0 for k in range(4))


def test_clockwise_triangles_are_flipped():
    polygon = star(60, spread=0.4)
    points, start = vertices(polygon), triangulate(polygon, "ear-clipping")
    mirrored = points * (1.0, -1.0)
    for by in FLIP_TESTS[:3]:
        assert np.array_equal(flip(mirrored, start, by), flip(points, start, by))
        assert not np.array_equal(flip(points, start, by), start)


def test_extreme_and_nan_coordinates_terminate_and_stay_valid():
    polygon = star(40, spread=0.4)
    points, start = vertices(polygon), triangulate(polygon, "ear-clipping")
    border = get_boundary(start)
    for factor in (1e-320, 1e-155, 1e-100, 1e70, 1e150, 1e308, np.nan):
        for by in FLIP_TESTS[:3]:
            with np.errstate(over="ignore", invalid="ignore"):
                flipped = flip(points * factor, start, by)
            assert get_boundary(flipped) == border


def get_boundary(triangles):
    sides = {(t[k], t[k - 2]) for t in triangles.tolist() for k in range(3)}
    return {(a, b) for a, b in sides if (b, a) not in sides}


@pytest.mark.parametrize(
    ("points", "triangles", "by", "message"),
    [
        ([(0, 0), (1, 0), (0, 1)], [(0, 1, 3)], "l1", "outside 0..2"),
        ([(0, 0), (1, 0), (0, 1)], [(0, 1, -1)], "l1", "outside 0..2"),
        ([(0, 0), (1, 0), (0, 1)], [0, 1], "l1", r"shape \(2,\), expected \(m, 3\)"),
        ([(0, 0), (1, 0), (0, 1)], [(0.5, 1, 2)], "l1", "float64, expected integer indices"),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], "l1", r"expected \(n, 2\)"),
    ],
)
def test_invalid_arrays_raise_errors(points, triangles, by, message):
    with pytest.raises(ValueError, match=message):
        flip(np.array(points), np.array(triangles), by)


def test_unknown_flip_test_lists_choices():
    choices = r"unknown criterion 'l2'; .*l1, euclidean, delaunay"
    with pytest.raises(UnknownNameError, match=choices):
        flip(np.zeros((3, 2)), np.array([(0, 1, 2)]), "l2")


@pytest.mark.parametrize(
    "name",
    [
        *("earcut-refine", "flips", "flips:euclidean", "flips:delaunay", "flips:shape"),
        *("flips:mixed", "flips:expected-quads", "refined", "refined:edge-length", "refined:shape"),
        *("delaunay", "optimal:shape"),
    ],
)
def test_batch_equals_single_calls(name):
    rng = np.random.default_rng(9)
    polygons = [random_simple(rng, int(rng.integers(3, 30)), 40) for _ in range(60)]
    polygons += [with_hole(rng, 10, 4) for _ in range(10)] + [star(250)]
    result = triangulate_many(polygons, name, threads=3)
    assert not result.failed
    changed = 0
    for polygon, triangles in zip(polygons, result, strict=True):
        assert np.array_equal(triangles, triangulate(polygon, name))
        raw = mapbox_earcut.triangulate_float64(*earcut_rings(polygon)).reshape(-1, 3)
        changed += not np.array_equal(raw, triangles)
    assert changed > 20


def test_dropin_imports_only_flip_modules():
    heavy = "[m for m in ('highspy', 'pandas', 'matplotlib', 'shapely') if m in sys.modules]"
    code = f"import sys, triangulators.dropin; sys.exit(str({heavy}) if {heavy} else 0)"
    done = run_python("-c", code)
    assert done.returncode == 0, done.stderr


def count_gains(polygon, triangles, criterion):
    """Count the pairs of triangles whose flip would decrease a criterion."""
    points, gaining = vertices(polygon), 0
    across = {}
    for row, corners in enumerate(triangles.tolist()):
        for k in range(3):
            across[corners[k], corners[k - 2]] = (row, corners[k - 1])
    for (a, b), (row, c) in across.items():
        if (b, a) not in across or a > b:
            continue
        other, d = across[b, a]
        new = np.array([(a, d, c), (d, b, c)])
        u, v = points[new[:, 1]] - points[new[:, 0]], points[new[:, 2]] - points[new[:, 0]]
        if (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > 1e-9).all():
            old = criterion.total(points, triangles[[row, other]])
            gaining += criterion.total(points, new) < old - 1e-9 * (1.0 + abs(old))
    return gaining


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(hard_polygons())
def test_refined_is_valid_and_never_worse_than_ear_clipping(polygon):
    points = vertices(polygon)
    ears = triangulate(polygon, "ear-clipping", repair=True)
    for name in ("half-perimeter", "edge-length", "overdraw"):
        criterion = criteria.find(name)
        triangles = triangulate(polygon, f"refined:{name}")
        assert verify(polygon, triangles).conforming, polygon.wkt
        cost, start = criterion.total(points, triangles), criterion.total(points, ears)
        best = criterion.total(points, triangulate(polygon, f"optimal:{name}"))
        assert best * (1 - 1e-9) - 1e-9 <= cost <= start * (1 + 1e-9) + 1e-9, polygon.wkt
