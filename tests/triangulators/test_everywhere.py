"""Every registered triangulator on hard polygons: valid, reported as invalid, or a clear error."""

from functools import cache

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings

from scenes import load
from tests.triangulators.cases import glyphs, hard_polygons, read_shared, star
from triangulators import InvalidPolygonError, SkippedError, criteria, names, triangulate, vertices
from triangulators.polygon import boundary
from triangulators.registry import BUILTIN, Entry, find
from triangulators.verify import verify_boundary

MAX_LISTED_VERTICES = {"exhaustive": 9, "listed": 9, "pareto": 14}
"""Maximum number of vertices for triangulators that list all triangulations or a Pareto front."""

SKIPPING = ("fan", "strip")
"""Triangulators that skip some polygons without holes."""

NONCONFORMING = ("ear-clipping", "earcut-refine", "flips", "listed")
NONCONFORMING += ("delaunay", "sweep", "manifold")
"""Triangulators of libraries, whose unchanged results may have T-junctions."""

CODES = [*range(33, 127), *range(0xA1, 0x180), *range(0x391, 0x3CA), *range(0x400, 0x460)]
LETTERS = "".join(letter for letter in map(chr, CODES) if letter.isprintable())


@cache
def list_usable(_registered: tuple[str, ...]) -> list[str]:
    return [name for name in names(available_only=True) if find(name).builtin]


def names_for(polygon) -> list[str]:
    """Return the triangulators to try, with three criteria for each that accepts a criterion."""
    count, usable = len(vertices(polygon)), list_usable(tuple(BUILTIN))
    candidates = [name for name in usable if count <= MAX_LISTED_VERTICES.get(name, count)]
    steered = [f"{n}:{c}" for n in candidates for c in CRITERIA if find(n).criteria]
    return [n for n in candidates if not find(n).criteria] + steered


CRITERIA = ("overdraw", "half-perimeter", "expected-quads")


def check(polygon, label):
    """Run every triangulator on one polygon; return the number of triangulations."""
    if not polygon.is_valid or polygon.is_empty:
        for name in list_usable(tuple(BUILTIN)):
            with pytest.raises(InvalidPolygonError):
                triangulate(polygon, name)
        return 0
    outline = boundary(polygon)
    points = outline.points
    results = {}
    for name in names_for(polygon):
        entry = find(name.partition(":")[0])
        try:
            triangles = triangulate(polygon, name)
        except SkippedError:
            holed = polygon.interiors and not entry.handles_holes
            assert name in SKIPPING or holed or len(points) > 1500, (label, name)
            continue
        result = verify_boundary(outline, triangles)
        assert result.ok, (label, name, result.problems)
        assert abs(result.area_error) <= 1e-9 * polygon.area, (label, name)
        if not result.conforming:
            assert name.partition(":")[0] in NONCONFORMING, (label, name, result)
            assert result.t_junctions
            triangles = triangulate(polygon, name, repair=True)
            assert verify_boundary(outline, triangles).conforming, (label, name)
        results[name] = triangles
    if not polygon.interiors and len(points) <= 2000:
        for criterion in CRITERIA:
            cost = criteria.find(criterion)
            limit = cost.total(points, results[f"optimal:{criterion}"]) * (1 - 1e-9) - 1e-9
            for name, triangles in results.items():
                assert cost.total(points, triangles) >= limit, (label, name)
    return len(results)


def twice_the_first(outline):
    """Return a triangulation with one triangle too many."""
    good = BUILTIN["optimal"].load()(outline)
    return np.concatenate((good, good[:1]))


def never(outline):
    """Skip every polygon."""
    raise SkippedError("never: no polygon is good enough")


@pytest.mark.parametrize("wrong", [twice_the_first, never])
def test_registered_triangulator_is_included(monkeypatch, wrong):
    polygon = load("city").polygons[0]
    assert check(polygon, "city 0") > 0
    entry = Entry("new", "a faulty one", f"{__name__}:{wrong.__name__}")
    monkeypatch.setitem(BUILTIN, "new", entry)
    with pytest.raises(AssertionError, match="new"):
        check(polygon, "city 0")


@pytest.mark.parametrize("name", ["earcut_fixtures.json", "poly2tri_testbed.json"])
def test_hostile_fixtures(name):
    small = [item for item in read_shared(name) if len(vertices(item[1])) < 4000]
    assert sum(check(polygon, label) > 0 for label, polygon in small) >= 19


SCENES = ("city:buildings=250", "cad:parts=5,segments=12", "paper")


@pytest.mark.parametrize("scene", [*SCENES, "stress:vertices=24", "meshes:limit=40"])
def test_scenes(scene):
    assert all(check(polygon, scene) > 5 for polygon in load(scene).polygons)


def test_real_buildings():
    done = [check(polygon, label) for label, polygon in read_shared("helsinki.json")[::4]]
    assert sum(done) > 8 * 240


def test_letters():
    done = [check(polygon, label) for label, polygon in glyphs(LETTERS[::4])]
    assert len(done) > 100
    assert all(done)


@pytest.mark.parametrize("count", [8, 20, 45])
@pytest.mark.parametrize("turned", [False, True])
def test_hole_that_shares_a_vertex_with_the_exterior(count, turned):
    shell = vertices(star(count, seed=count, spread=0.1))
    vertex, centre = shell[0], np.array((512.0, 512.0))
    hole = [vertex, (vertex + centre) / 2 + (0.0, 3.0), centre, (vertex + centre) / 2 - (0.0, 3.0)]
    polygon = shapely.Polygon(shell, [hole])
    assert check(polygon.reverse() if turned else polygon, count) > 10


@settings(max_examples=1000, deadline=None, suppress_health_check=list(HealthCheck))
@given(hard_polygons())
def test_collinear_runs_repeated_coordinates_and_slivers(polygon):
    assert check(polygon, polygon.wkt) > 0
