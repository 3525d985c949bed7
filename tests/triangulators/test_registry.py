"""Names and the weights in them, errors and third parties."""

from importlib.metadata import EntryPoint

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import triangulators
from tests.triangulators.cases import star
from triangulators import (
    InvalidPolygon,
    TriangulationError,
    UnknownName,
    criteria,
    full_name,
    triangulate,
    vertices,
)
from triangulators.criteria import read_weights, write_weights

with np.errstate(invalid="ignore"):
    NOT_A_NUMBER = shapely.Polygon([(0, 0), (4, float("nan")), (4, 0)])
SQUARE = shapely.Polygon([(0, 0), (4, 0), (4, 4), (0, 4)])


def clockwise_square(polygon):
    return np.array([[0, 2, 1], [0, 3, 2]])


def no_triangles_at_all(polygon):
    return "nothing"


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("optimum", "optimal"),
        ("delauney", "delaunay"),
        ("optimal:overdrow", "overdraw"),
        ("earclipping:x", "ear-clipping"),
        ("fan:overdraw", "takes no criterion"),
        ("math:nothing", "nothing"),
    ],
)
def test_unknown_names_suggest_the_nearest(name, nearest):
    with pytest.raises(UnknownName, match=nearest):
        triangulate(SQUARE, name)


def test_vertices_are_rings_without_repeats():
    holed = shapely.Polygon([(0, 0), (8, 0), (8, 8)], [[(5, 1), (6, 1), (6, 2)]])
    assert vertices(holed).tolist() == [[0, 0], [8, 0], [8, 8], [5, 1], [6, 1], [6, 2]]


def test_a_users_function_is_wound_counter_clockwise():
    triangles = triangulate(SQUARE, f"{__name__}:clockwise_square")
    assert triangles.dtype == np.int32
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    with pytest.raises(TriangulationError, match="expected \\(m, 3\\)"):
        triangulate(SQUARE, f"{__name__}:no_triangles_at_all")


@pytest.mark.parametrize(
    ("polygon", "message"),
    [
        (shapely.Polygon(), "empty"),
        (shapely.Polygon([(0, 0), (4, 4), (4, 0), (0, 4)]), "Self-intersection"),
        (NOT_A_NUMBER, "NaN"),
        (shapely.Point(0, 0), "Point"),
        (shapely.Polygon([(0, 0), (1, 1), (2, 2)]), "not valid"),
    ],
)
def test_bad_polygons_say_what_is_wrong(polygon, message):
    for name in ("fan", "ear-clipping", "delaunay", "optimal"):
        with pytest.raises(InvalidPolygon, match=message):
            triangulate(polygon, name)


def test_a_third_party_adds_its_own_by_an_entry_point(monkeypatch):
    point = EntryPoint("theirs", f"{__name__}:clockwise_square", "raster_harness.triangulators")
    monkeypatch.setattr(triangulators.registry, "_third_party", lambda: {"theirs": point})
    assert "theirs" in triangulators.names(available_only=True)
    assert triangulators.full_name("theirs") == "theirs"
    assert triangulate(SQUARE, "theirs").tolist() == [[0, 1, 2], [0, 2, 3]]
    with pytest.raises(UnknownName, match="theirs"):
        triangulate(SQUARE, "their")


figures = st.floats(0, 1e12, allow_nan=False)


@pytest.mark.parametrize(
    ("written", "full"),
    [
        ("optimal:mixed=1.0/.50/0", "optimal:mixed=1/0.5/0"),
        ("worst:mixed=1/0.5/-0", "worst:mixed=1/0.5/0"),
        ("optimal:mixed=1/1.0/1e0", "optimal:mixed"),
        ("optimal:mixed", "optimal:mixed"),
        *(("optimal", "optimal:overdraw"), ("worst", "worst:overdraw"), ("fan", "fan")),
        ("exhaustive:mixed=0/1/0", "exhaustive:mixed=0/1/0"),
    ],
)
def test_one_criterion_has_one_name(written, full):
    assert full_name(written) == full
    assert full_name(full) == full


@settings(deadline=None)
@given(st.tuples(figures, figures, figures))
def test_what_is_written_is_read_as_it_was(weights):
    assume(any(weights))
    text = write_weights(weights)
    assert "," not in text
    assert tuple(read_weights("mixed", text, ("a", "b", "c")).values()) == weights
    name = criteria.mixed(*weights).name
    assert criteria.find(name).weights == criteria.mixed(*weights).weights
    assert criteria.find(name).name == name


def test_the_name_gives_the_weights():
    polygon = star(24, spread=0.4)
    points = vertices(polygon)
    for end in ("optimal", "worst"):
        by_name = triangulate(polygon, f"{end}:mixed=1/0.25/0")
        apart = triangulate(polygon, end, criterion=criteria.mixed(1.0, 0.25, 0.0))
        assert np.array_equal(by_name, apart)
    found = criteria.find("mixed=2/3/5")
    same = criteria.find("mixed", alpha=2, beta=3, gamma=5)
    assert found.total(points, by_name) == same.total(points, by_name)


_WEIGHTS = "give mixed=alpha/beta/gamma, 3 finite numbers, none negative and one above zero"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mixed=1/0.5", _WEIGHTS),
        ("mixed=1/2/3/4", _WEIGHTS),
        ("mixed=", _WEIGHTS),
        ("mixed=1/x/0", _WEIGHTS),
        ("mixed=1/-2/0", _WEIGHTS),
        ("mixed=1/nan/0", _WEIGHTS),
        ("mixed=1e999/1/0", _WEIGHTS),
        ("mixed=0/0/0", _WEIGHTS),
        ("overdraw=1", "'overdraw' takes no weights"),
        ("mixd=1/2/3", "did you mean 'mixed'"),
    ],
)
def test_weights_that_cannot_be_used_are_refused(name, message):
    with pytest.raises(UnknownName, match=message):
        triangulate(star(8), f"optimal:{name}")
    with pytest.raises(UnknownName, match=message):
        full_name(f"worst:{name}")


def test_weights_are_given_once():
    with pytest.raises(TypeError, match="has its weights already"):
        criteria.find("mixed=1/2/0", alpha=3.0)
