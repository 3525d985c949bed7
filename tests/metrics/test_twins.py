"""Two names for one triangulation are one; what damage took away is not guessed."""

from harness.metrics.groups import SAME, without_twins


def test_twins_are_one_and_what_lacks_a_criterion_is_none():
    whole = {"predicted": dict.fromkeys(SAME, 1.0)}
    twin = {"predicted": dict.fromkeys(SAME, 1.0 + 1e-9)}
    other = {"predicted": {**dict.fromkeys(SAME, 1.0), "shape": 1.1}}
    damaged = {"predicted": {"shape": 1.0}}
    assert without_twins([whole, damaged, twin, other]) == [whole, other]
