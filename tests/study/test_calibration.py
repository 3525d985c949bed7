"""The fit of a device's cost model finds what made-up times were made of."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import box

from harness.errors import INCONCLUSIVE, UsageError
from harness.measuring.processes import Bench
from harness.study import cost_model
from harness.study.calibration_draws import (
    Validation,
    design_of,
    designed_draws,
    read_coefficients,
    write,
)
from harness.study.model_terms import Model
from tests.measuring.test_run import inline

TRUE = np.array([8e-6, 4e-8, 1.0e-9, 1.0e-8, 0.0, 1e-10, 0.0, 1.2e-8, 2e-8])


MODEL = Model(("area", "half_perimeter"), {}, 0.9, -35.0, 0.01, 0.005, 0.015, 0.0)


def designed(seed: int) -> tuple[np.ndarray, list[int]]:
    """Return a design with smaller crowds, which are made sooner."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(cost_model, "CROWD", (100, 400))
        draws, sets = designed_draws(Bench(inline, 60), 256, seed)
    return design_of(draws), sets


@pytest.fixture(scope="module")
def designed_draws_0() -> tuple[np.ndarray, list[int]]:
    return designed(seed=0)


def test_designed_polygons_are_inside_the_viewport_and_valid():
    for polygons in cost_model.designed_polygons(256, seed=1):
        assert all(polygon.is_valid for polygon in polygons)
        assert all(box(0, 0, 256, 256).contains(polygon) for polygon in polygons)
        assert len(shapely.STRtree(polygons).query(polygons, "overlaps")[0]) == 0
        assert len({polygon.wkb for polygon in polygons}) == len(polygons)


def test_strokes_lie_around_the_place_that_they_are_given():
    """Off it, one would leave its room in the row, and the viewport where that is small."""
    for seed in range(40):
        xy = cost_model._stroke(np.random.default_rng(seed), 12)
        assert xy.min(axis=0) + xy.max(axis=0) == pytest.approx(0.0, abs=1e-12)
        assert np.hypot(*xy.T).max() == pytest.approx(1.0)


def test_the_design_tells_the_terms_apart(designed_draws_0):
    design, _ = designed_draws_0
    relative = design / design.max(axis=0)
    assert np.linalg.matrix_rank(relative) == len(cost_model.TERMS)
    correlation = np.corrcoef(np.log(design[:, 1:5]).T)
    assert np.abs(correlation - np.eye(4)).max() < 0.98
    # Q and P are nearly sums of T, S and H, except for slivers: enough of these must be there.
    weight = 1 / (design @ TRUE)
    known = design[:, :5] * weight[:, None]
    for column in (design[:, 5:] * weight[:, None]).T:
        left = column - known @ np.linalg.lstsq(known, column, rcond=None)[0]
        assert np.linalg.norm(left) > 0.03 * np.linalg.norm(column)


def test_known_coefficients_are_found_in_spite_of_noise_and_outliers(designed_draws_0):
    design, sets = designed_draws_0
    random = np.random.default_rng(0)
    seconds = design @ TRUE * np.exp(0.01 * random.standard_normal(len(design)))
    disturbed = random.random(len(seconds)) < 0.03
    seconds[disturbed] *= 1.5
    fit = cost_model.fit(design, seconds, sets, resamples=40)
    found = np.array([fit.coefficients[name] for name in cost_model.TERMS])
    assert found[[0, 3]] == pytest.approx(TRUE[[0, 3]], rel=0.1)
    assert (found >= 0).all()
    assert found[4] < 1e-10
    others, _ = designed(seed=1)
    assert others @ found == pytest.approx(others @ TRUE, rel=0.03)
    low, high = fit.intervals["half_perimeter"]
    assert low <= found[3] <= high
    assert fit.r2 > 0.98


def test_what_a_set_of_polygons_has_in_common_bends_the_fit_little(designed_draws_0):
    design, sets = designed_draws_0
    common = np.exp(0.2 * np.random.default_rng(3).standard_normal(max(sets) + 1))
    fit = cost_model.fit(design, design @ TRUE * common[sets], sets, resamples=2)
    found = np.array([fit.coefficients[name] for name in cost_model.TERMS])
    logs = [np.log(design @ coefficients) for coefficients in (TRUE, found)]
    r2 = cost_model.r_squared_within(np.exp(logs[0]), np.exp(logs[1]), sets)
    # With the weight of what is shared at 1 instead of `BETWEEN`, it is 0.9935.
    assert r2 > 0.9975


def test_r2_within_polygons_is_blind_to_their_size():
    sizes = np.repeat([1.0, 10.0, 100.0], 50)
    choice = np.random.default_rng(1).uniform(0.9, 1.1, 150)
    polygons = np.repeat([0, 1, 2], 50).tolist()
    assert cost_model.r_squared_within(sizes * choice, 7 * sizes * choice, polygons) > 0.999
    assert cost_model.r_squared(np.log(sizes * choice), np.log(sizes)) > 0.99
    assert cost_model.r_squared_within(sizes * choice, sizes, polygons) < 0.01


def test_a_model_of_fewer_terms_gives_the_others_nothing(designed_draws_0):
    design, sets = designed_draws_0
    terms = ("triangles", "half_perimeter")
    fit = cost_model.fit(design, design @ TRUE, sets, resamples=3, terms=terms)
    assert {name for name, value in fit.coefficients.items() if value > 0} <= {"draw", *terms}
    assert fit.coefficients["half_perimeter"] > 0
    assert fit.intervals["area"] == (0.0, 0.0)


def test_a_calibration_is_written_and_read_back(tmp_path, designed_draws_0):
    design, sets = designed_draws_0
    fit = cost_model.fit(design, design @ TRUE, sets, resamples=5)
    file = tmp_path / "made" / "device.json"
    assert write(fit, Validation(0.99, 0.95, 24, 384), {"name": "made"}, file) == file
    assert read_coefficients(file) == pytest.approx(fit.coefficients)


@pytest.mark.parametrize(("over", "within"), [(0.99, -35.0), (0.7, 0.9), (0.99, float("nan"))])
def test_a_poor_fit_is_refused_and_leaves_the_good_one(tmp_path, designed_draws_0, over, within):
    design, sets = designed_draws_0
    fit = cost_model.fit(design, design @ TRUE, sets, resamples=5)
    good = write(fit, Validation(0.99, 0.95, 24, 384), {}, tmp_path / "device.json")
    before = good.read_bytes()
    refused = write(fit, Validation(over, within, 24, 384), {}, good)
    assert refused.name == "device.refused.json"
    assert good.read_bytes() == before
    with pytest.raises(UsageError, match=r"refused.*repeat raster-harness calibrate"):
        read_coefficients(refused)


def test_the_command_refuses_a_poor_fit(harness, block, tmp_path, monkeypatch, designed_draws_0):
    design, sets = designed_draws_0
    fit = cost_model.fit(design, design @ TRUE, sets, resamples=5)

    def measured(backend, bench, *_):
        bench.open(backend)
        return fit, Validation(0.9, -35.0, 24, 384), [MODEL]

    monkeypatch.setattr("harness.study.calibration_draws.calibrate", measured)
    file = tmp_path / "device.json"
    code, out, err = harness("calibrate", "--scene", str(block), "--out", str(file))
    assert code == INCONCLUSIVE
    assert "-35.0000 within" in out
    assert "S + H" in out
    assert "--terms S,H" in " ".join(out.split())
    assert "--budget 0.8" in " ".join(err.split())
    assert not file.exists()


@pytest.mark.parametrize("content", [None, "{}", "no JSON", '{"coefficients": {"draw": "x"}}'])
def test_what_is_no_calibration_is_refused(tmp_path, content):
    file = tmp_path / "c.json"
    if content is not None:
        file.write_text(content)
    with pytest.raises(UsageError, match="calibration"):
        read_coefficients(file)


def test_stars_go_round_once_whatever_their_radii():
    """Each corner is further round than the one before: no edge crosses another."""
    for seed in range(50):
        random = np.random.default_rng(seed)
        xy = cost_model._star(random, 48, 0.35, 1.0)
        turns = np.diff(np.unwrap(np.arctan2(xy[:, 1], xy[:, 0])))
        assert (turns > 0).all()
        assert turns.sum() < 2 * np.pi
        radii = np.hypot(xy[:, 0], xy[:, 1])
        assert 0.35 <= radii.min() < radii.max() <= 1


def test_small_polygons_fill_the_viewport_in_its_middle():
    """Squares of 8 px with 2 px between them: eight and margins of 2 px are 84 px."""
    places = cost_model._places(84, 8.0, 1000.0)
    assert len(places) == 64
    assert places.min(axis=0).tolist() == [7, 7]
    assert places.max(axis=0).tolist() == [77, 77]
    assert len(cost_model._places(84, 8.0, 10.4)) == 10
    assert len(cost_model._places(84, 200.0, 0.1)) == 1
