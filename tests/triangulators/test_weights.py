"""Weights in a criterion's name: one way to write each, the same optimum, clear refusals."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.triangulators.cases import star
from triangulators import UnknownName, criteria, full_name, triangulate, vertices
from triangulators.criteria.weights import read_weights, write_weights

figures = st.floats(0, 1e12, allow_nan=False)


@pytest.mark.parametrize(
    ("written", "full"),
    [
        ("optimal:mixed=1.0/.50/0", "optimal:mixed=1/0.5/0"),
        ("worst:mixed=1/0.5/-0", "worst:mixed=1/0.5/0"),
        ("optimal:mixed=1/1.0/1e0", "optimal:mixed"),
        ("optimal:mixed", "optimal:mixed"),
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


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mixed=1/0.5", "give 3 weights, mixed=alpha/beta/gamma, not 2"),
        ("mixed=1/2/3/4", "not 4"),
        ("mixed=", "not 1"),
        ("mixed=1/x/0", "are numbers"),
        ("mixed=1/-2/0", "not negative"),
        ("mixed=1/nan/0", "finite"),
        ("mixed=1e999/1/0", "finite"),
        ("mixed=0/0/0", "above zero"),
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
