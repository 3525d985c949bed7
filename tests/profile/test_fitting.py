"""Fits find what made-up times were made of, and profiles are written and read back."""

from __future__ import annotations

import json

import numpy as np
import pytest

from harness.errors import UsageError
from harness.profile import design, law
from harness.profile.law import COSTS, costs_of
from harness.profile.profile import fitted_of, keep, read_coefficients

TRUE = np.array([8e-6, 4e-8, 1.0e-9, 1.0e-8, 0.0, 1e-10, 0.0, 1.2e-8, 2e-8])


@pytest.fixture(scope="module")
def designed() -> tuple[np.ndarray, np.ndarray]:
    """What criteria weigh of a profile's draws, and their groups."""
    draws = design.draws()
    plain = [draws[place] for place in fitted_of(draws)[1]]
    groups = np.unique([draw.group for draw in plain], return_inverse=True)[1]
    return costs_of([(draw.frame, draw.triangles) for draw in plain]), groups


def test_times_are_predicted_in_spite_of_noise_and_outliers(designed):
    rows, groups = designed
    random = np.random.default_rng(0)
    seconds = rows @ TRUE * np.exp(0.01 * random.standard_normal(len(rows)))
    seconds[random.random(len(rows)) < 0.03] *= 1.5
    found = law.solve(rows, seconds, groups)
    assert (found >= 0).all()
    assert rows @ found == pytest.approx(rows @ TRUE, rel=0.04)


def test_what_a_group_has_in_common_bends_the_fit_little(designed):
    rows, groups = designed
    common = np.exp(0.2 * np.random.default_rng(0).standard_normal(groups.max() + 1))
    found = law.solve(rows, rows @ TRUE * common[groups], groups)
    r2 = law.r_squared_within(rows @ TRUE, rows @ found, groups)
    # With the weight of what is shared at 1 instead of `BETWEEN`, it is 0.9996.
    assert r2 > 0.9999


@pytest.mark.parametrize("signed", [False, True])
def test_terms_may_be_of_any_size(signed):
    size = np.array([1e9, 1e-30])
    design = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 5.0]])
    found = law.solve(design * size, design @ [3.0, 2.0], [0, 0, 1, 1], signed=signed)
    assert found * size == pytest.approx([3.0, 2.0], rel=1e-3)


def test_r2_within_polygons_is_blind_to_their_size():
    sizes = np.repeat([1.0, 10.0, 100.0], 50)
    choice = np.random.default_rng(1).uniform(0.9, 1.1, 150)
    polygons = np.repeat([0, 1, 2], 50).tolist()
    assert law.r_squared_within(sizes * choice, 7 * sizes * choice, polygons) > 0.999
    assert law.r_squared(np.log(sizes * choice), np.log(sizes)) > 0.99
    assert law.r_squared_within(sizes * choice, sizes, polygons) < 0.01


def test_a_set_of_polygons_counts_by_its_draws():
    """Nine draws of one set, and one of another that costs two per cent more."""
    columns, seconds = np.ones((10, 1)), np.r_[np.ones(9), 1.02]
    (found,) = law.solve(columns, seconds, [*[0] * 9, 1])
    assert found == pytest.approx(1.002, abs=0.001)


def test_draws_that_another_program_disturbed_hardly_count():
    columns, seconds = np.ones((50, 1)), np.ones(50)
    seconds[:10] = 5.0
    (found,) = law.solve(columns, seconds, list(range(50)))
    assert found == pytest.approx(1.0, abs=0.02)


def test_a_draw_may_have_nothing_of_a_term():
    design = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 5.0]])
    found = law.solve(design, design @ [3.0, 2.0], [0, 0, 1, 1])
    assert found == pytest.approx([3.0, 2.0], rel=1e-3)


def test_what_is_known_at_once_does_not_end_the_search_for_the_rest():
    """Draws of one term are exact, one in five of another was disturbed."""
    design = np.repeat([[1.0, 0.0], [0.0, 1.0]], [5, 20], axis=0)
    seconds = design @ [3.0, 2.0]
    seconds[5:9] *= 5.0
    found = law.solve(design, seconds, list(range(25)))
    assert found == pytest.approx([3.0, 2.0], rel=0.02)


def test_r2_is_the_share_of_the_variance_that_is_explained():
    measured, predicted = np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 4.0])
    assert law.r_squared(measured, predicted) == pytest.approx(0.5)
    logs = np.array([0.0, 2.0, 10.0, 12.0]), np.array([0.0, 1.0, 5.0, 6.0])
    within = law.r_squared_within(*np.exp(logs), ["a", "a", "b", "b"])
    assert within == pytest.approx(0.75)


CONTENT = {"refused": False, "coefficients": dict.fromkeys(COSTS, 2.0)}


def test_a_profile_is_written_and_read_back(tmp_path):
    file = tmp_path / "made" / "device.json"
    assert keep(CONTENT, file) == file
    assert read_coefficients(file) == CONTENT["coefficients"]


def test_a_refused_profile_leaves_the_good_one(tmp_path):
    good = keep(CONTENT, tmp_path / "device.json")
    before = good.read_bytes()
    refused = keep({**CONTENT, "refused": True}, good)
    assert refused.name == "device.refused.json"
    assert good.read_bytes() == before
    with pytest.raises(UsageError, match=r"refused.*repeat raster-harness profile"):
        read_coefficients(refused)


@pytest.mark.parametrize(
    "content", [None, "{}", "no JSON", json.dumps({"coefficients": {"draw": "x"}}), "[1]"]
)
def test_what_is_no_profile_is_refused(tmp_path, content):
    file = tmp_path / "c.json"
    if content is not None:
        file.write_text(content)
    with pytest.raises(UsageError, match="profile"):
        read_coefficients(file)
