import re
from functools import partial
from importlib.metadata import EntryPoint

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

import triangulators
from tests.triangulators.cases import star
from triangulators import (
    ArgumentError,
    InvalidPolygonError,
    TriangulationError,
    UnknownNameError,
    criteria,
    full_name,
    triangulate,
    triangulate_many,
    vertices,
)
from triangulators.criteria.criterion import MIXED_WEIGHTS, read_weights, write_weights

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
        ("math:nothing", "nothing"),
    ],
)
def test_unknown_names_suggest_the_nearest(name, nearest):
    with pytest.raises(UnknownNameError, match=nearest):
        triangulate(SQUARE, name)


def test_vertices_are_rings_without_repeats():
    holed = shapely.Polygon([(0, 0), (8, 0), (8, 8)], [[(5, 1), (6, 1), (6, 2)]])
    assert vertices(holed).tolist() == [[0, 0], [8, 0], [8, 8], [5, 1], [6, 1], [6, 2]]


def test_user_triangles_become_counter_clockwise():
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
def test_invalid_polygons_raise_reason(polygon, message):
    for name in ("fan", "ear-clipping", "delaunay", "optimal"):
        with pytest.raises(InvalidPolygonError, match=message):
            triangulate(polygon, name)


def test_entry_point_registers_third_party_triangulator(monkeypatch):
    point = EntryPoint("theirs", f"{__name__}:clockwise_square", "raster_harness.triangulators")
    find_points = "triangulators.registry._find_third_party_entry_points"
    monkeypatch.setattr(find_points, lambda: {"theirs": point})
    assert "theirs" in triangulators.names(available_only=True)
    assert triangulators.full_name("theirs") == "theirs"
    assert triangulate(SQUARE, "theirs").tolist() == [[0, 1, 2], [0, 2, 3]]
    with pytest.raises(UnknownNameError, match="theirs"):
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
        ("refined", "refined:half-perimeter"),
        ("exhaustive:mixed=0/1/0", "exhaustive:mixed=0/1/0"),
    ],
)
def test_one_criterion_has_one_name(written, full):
    assert full_name(written) == full
    assert full_name(full) == full


@given(st.tuples(figures, figures, figures))
def test_weights_round_trip(weights):
    assume(any(weights))
    text = write_weights(weights)
    assert "," not in text
    assert tuple(read_weights(text).values()) == weights
    name = criteria.mixed(*weights).name
    assert criteria.find(name).weights == criteria.mixed(*weights).weights
    assert criteria.find(name).name == name


def test_the_name_gives_the_weights():
    polygon = star(24, spread=0.4)
    for end in ("optimal", "worst"):
        by_name = triangulate(polygon, f"{end}:mixed=1/0.25/0")
        by_argument = triangulate(polygon, end, criterion=criteria.mixed(1.0, 0.25, 0.0))
        assert np.array_equal(by_name, by_argument)


_WEIGHTS = "; give mixed=alpha/beta/gamma, 3 finite numbers, not negative and not all 0"


@pytest.mark.parametrize(
    ("weights", "problem"),
    [
        ("1/0.5", "'1/0.5' is not three numbers"),
        ("1/2/3/4", "'1/2/3/4' is not three numbers"),
        ("", "'' is not three numbers"),
        ("1/x/0", "'1/x/0' is not three numbers"),
        ("1/-2/0", "beta is negative"),
        ("1/nan/0", "beta is nan"),
        ("1e999/1/0", "alpha is inf"),
        ("1e300/0/0", "alpha is beyond 1e+200, where sums overflow"),
        ("0/0/-0", "all weights are 0"),
    ],
)
def test_invalid_weights_are_rejected_everywhere(weights, problem):
    message = re.escape(problem + _WEIGHTS)
    for refused in (full_name, lambda name: triangulate(star(8), name)):
        with pytest.raises(ArgumentError, match=message):
            refused(f"optimal:mixed={weights}")
    if "is not three" not in problem:
        by_name = dict(zip(MIXED_WEIGHTS, map(float, weights.split("/")), strict=True))
        for refused in (criteria.mixed, partial(criteria.find, "mixed")):
            with pytest.raises(ArgumentError, match=message):
                refused(**by_name)
        with pytest.raises(ArgumentError, match=message):
            triangulate(star(8), "optimal:mixed", **by_name)


def test_criterion_or_weights_given_twice_raise():
    mixture, many = criteria.mixed(1.0, 2.0, 0.0), partial(triangulate_many, [star(8)])
    calls = {
        "criterion given twice": [
            partial(triangulate, star(8), "optimal:half-perimeter", criterion="overdraw"),
            partial(triangulate, star(8), "optimal:overdraw", criterion=mixture),
            partial(many, "optimal:half-perimeter", criterion="overdraw"),
            partial(many, "flips:l1", criterion="delaunay"),
        ],
        "weights given twice": [partial(criteria.find, "mixed=1/2/0", alpha=3.0)],
        "takes no weights": [partial(triangulate, star(8), "optimal:overdraw=1")],
        "takes no parameters": [
            partial(criteria.find, mixture, alpha=3.0),
            partial(criteria.find, clockwise_square, alpha=3.0),
            partial(triangulate, star(8), "optimal:overdraw", alpha=3.0),
            partial(many, "refined:overdraw", seed=3),
            partial(many, "flips:half-perimeter", limit=3),
        ],
        "takes no criterion": [
            partial(full_name, "fan:overdraw"),
            partial(triangulate, star(8), "fan", criterion="overdraw"),
            partial(many, "fan", criterion="overdraw"),
        ],
    }
    for message, refused in calls.items():
        for call in refused:
            with pytest.raises(ArgumentError, match=message):
                call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (partial(triangulate, SQUARE, None), "triangulator: expected a name, got NoneType"),
        (partial(triangulate, SQUARE, "optimal", criterion=7), "criterion: expected .* got int"),
        (partial(triangulate_many, SQUARE), r"expected a sequence, got one Polygon; give \[poly"),
        (partial(criteria.Criterion, "x", "", weights=(float("nan"),)), "is not a number"),
        (partial(criteria.Criterion, "x", "", weights=(1e201,)), r"weight 1e\+201 is beyond 1e"),
    ],
)
def test_arguments_of_wrong_type_raise(call, message):
    with pytest.raises(ArgumentError, match=message):
        call()


def test_every_error_is_a_triangulation_error():
    kinds = [kind for kind in vars(triangulators.errors).values() if isinstance(kind, type)]
    raised = [kind for kind in kinds if issubclass(kind, Exception)]
    assert len(raised) > 5
    assert all(issubclass(kind, TriangulationError) for kind in raised)


def test_the_package_lists_its_public_names_only():
    assert dir(triangulators) == sorted([*triangulators.__all__, "__version__"])
    assert all(getattr(triangulators, name) is not None for name in dir(triangulators))
