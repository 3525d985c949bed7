"""Names, errors and third parties."""

from importlib.metadata import EntryPoint

import numpy as np
import pytest
import shapely

import triangulators
from triangulators import InvalidPolygon, TriangulationError, UnknownName, triangulate, vertices

with np.errstate(invalid="ignore"):
    NOT_A_NUMBER = shapely.Polygon([(0, 0), (4, float("nan")), (4, 0)])
SQUARE = shapely.Polygon([(0, 0), (4, 0), (4, 4), (0, 4)])


def clockwise_square(polygon):
    return np.array([[0, 2, 1], [0, 3, 2]])


def no_triangles_at_all(polygon):
    return "nothing"


def test_full_names():
    assert triangulators.full_name("optimal") == "optimal:overdraw"
    assert triangulators.full_name("worst") == "worst:overdraw"
    assert triangulators.full_name("optimal:half-perimeter") == "optimal:half-perimeter"
    assert triangulators.full_name("fan") == "fan"


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


def test_every_entry_says_what_it_is():
    for name in triangulators.names():
        entry = triangulators.find(name)
        assert entry.description
        assert entry.available() is None or "install" in entry.available()


def test_warming_up_makes_the_next_call_quick():
    names = triangulators.names(available_only=True)
    triangulators.warm_up(names)
    assert triangulators.warm_up(names) < 5.0
