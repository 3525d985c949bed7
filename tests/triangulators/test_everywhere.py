"""Every triangulator on hard polygons: valid, or reported by the verifier, or a clear error."""

import pytest
from hypothesis import HealthCheck, given, settings

from scenes import load
from tests.triangulators.cases import glyphs, hard_polygons, shared
from triangulators import InvalidPolygon, Skipped, criteria, names, triangulate, vertices
from triangulators.registry import find
from triangulators.verify import verify

OURS = [
    "fan",
    "strip",
    "max-area",
    "greedy",
    "random",
    "optimal",
    "worst",
    "optimal:half-perimeter",
]
LIBRARIES = [
    name for name in ("ear-clipping", "delaunay", "sweep", "manifold") if not find(name).available()
]
CODES = [*range(33, 127), *range(0xA1, 0x180), *range(0x391, 0x3CA), *range(0x400, 0x460)]
LETTERS = "".join(letter for letter in map(chr, CODES) if letter.isprintable())


def check(polygon, label):
    """Run every triangulator on one polygon; return how many gave a triangulation."""
    if not polygon.is_valid or polygon.is_empty:
        for name in names(available_only=True):
            with pytest.raises(InvalidPolygon):
                triangulate(polygon, name)
        return 0
    points = vertices(polygon)
    found = {}
    for name in OURS + LIBRARIES:
        try:
            triangles = triangulate(polygon, name)
        except Skipped:
            assert name in ("fan", "strip") or polygon.interiors or len(points) > 1500
            continue
        result = verify(polygon, triangles)
        assert result.ok, (label, name, result.problems)
        assert abs(result.area_error) <= 1e-9 * polygon.area, (label, name)
        if not result.conforming:
            assert name in LIBRARIES, (label, name, result)
            assert result.t_junctions
            triangles = triangulate(polygon, name, repair=True)
            assert verify(polygon, triangles).conforming, (label, name)
        found[name] = triangles
    if not polygon.interiors and len(points) <= 2000:
        for best, criterion in (("optimal", "overdraw"), ("optimal:half-perimeter", None)):
            cost = criteria.find(criterion or best.partition(":")[2])
            least = cost.total(points, found[best])
            for name, triangles in found.items():
                assert cost.total(points, triangles) >= least * (1 - 1e-9) - 1e-9, (label, name)
    return len(found)


@pytest.mark.parametrize("name", ["earcut_fixtures.json", "poly2tri_testbed.json"])
def test_hostile_fixtures(name):
    done = [
        check(polygon, label) for label, polygon in shared(name) if len(vertices(polygon)) < 4000
    ]
    assert sum(count > 0 for count in done) >= 19


def test_a_city():
    done = [check(polygon, index) for index, polygon in enumerate(load("city").polygons[::2])]
    assert len(done) == 250
    assert min(done) >= 6


def test_real_buildings():
    done = [check(polygon, label) for label, polygon in shared("helsinki.json")[::4]]
    assert sum(done) > 8 * 240


def test_letters():
    done = [check(polygon, label) for label, polygon in glyphs(LETTERS[::4])]
    assert len(done) > 100
    assert all(done)


@settings(max_examples=2000, deadline=None, suppress_health_check=list(HealthCheck))
@given(hard_polygons())
def test_collinear_runs_repeated_coordinates_and_slivers(polygon):
    assert check(polygon, polygon.wkt) > 0
