"""The fit of a device's cost model finds what made-up times were made of."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import box

from harness.errors import INCONCLUSIVE, UsageError
from harness.measuring.processes import Bench
from harness.study import calibration_draws, cost_model
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
    assert others @ found == pytest.approx(others @ TRUE, rel=0.04)
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
    assert len(cost_model._places(84, 200.0, 9.0)) == 1
    assert len(cost_model._places(90, 8.0, 1000.0)) == 64
    assert len(cost_model._places(84, 8.0, 0.1)) == 1


def test_a_crowd_has_as_many_triangles_as_it_may(monkeypatch):
    """120 triangles are 30 hexagons; a large polygon is alone."""
    monkeypatch.setattr(cost_model, "CROWD", (120, 120))
    draws = cost_model.designed_polygons(1024)
    for vertices in cost_model.VERTICES:
        own = [each for each in draws if len(each[0].exterior.coords) - 1 == vertices]
        counts = [len(polygons) for polygons in own]
        assert (min(counts), max(counts)) == (1, round(120 / (vertices - 2)))


def test_a_polygon_alone_lies_anywhere_in_the_viewport():
    random = np.random.default_rng(2)
    centres = np.vstack([cost_model._anywhere(random, 100, 16.0) for _ in range(5000)])
    assert centres.min(axis=0) == pytest.approx([10, 10], abs=0.2)
    assert centres.max(axis=0) == pytest.approx([90, 90], abs=0.2)
    assert np.median(centres, axis=0) == pytest.approx([50, 50], abs=2)


def test_polygons_are_turned_any_way_and_moved_off_the_grid_by_half_a_pixel():
    """The first corner of a round star is on its right, before it is turned."""
    size, place = 64.0, np.array([200.0, 300.0])
    angles, moved = [], []
    for seed in range(2000):
        random = np.random.default_rng(seed)
        polygon = cost_model._polygon(random, (1.0, 1.0), 48, size, place)
        corners = shapely.get_coordinates(polygon)[:-1]
        # Of corners on a circle, the middle of which is what they are all as far from.
        off = corners - place
        squares = (off**2).sum(axis=1) - (size / 2) ** 2
        moved.append(np.linalg.lstsq(2 * off, squares, rcond=None)[0])
        middle = place + moved[-1]
        angles.append(np.arctan2(*(corners[0] - middle)[::-1]) % (2 * np.pi))
        star = shapely.Polygon(cost_model._star(np.random.default_rng(seed), 48, 1.0, 1.0))
        assert polygon.area == pytest.approx(star.area * (size / 2) ** 2, rel=1e-3)
    counts = np.histogram(angles, 12, (0, 2 * np.pi))[0]
    assert counts.min() > 125
    assert counts.max() < 210
    assert np.min(moved, axis=0) == pytest.approx([-0.5, -0.5], abs=0.02)
    assert np.max(moved, axis=0) == pytest.approx([0.5, 0.5], abs=0.02)


def test_a_squeezed_star_is_as_wide_and_less_high():
    round_, squeezed = (
        cost_model._star(np.random.default_rng(1), 24, 0.35, share) for share in (1.0, 0.05)
    )
    assert squeezed == pytest.approx(round_ * [1.0, 0.05])


def test_corners_of_stars_stray_by_up_to_three_tenths_of_a_step():
    steps = []
    for seed in range(200):
        xy = cost_model._star(np.random.default_rng(seed), 48, 0.35, 1.0)
        steps.append(np.unwrap(np.arctan2(xy[:, 1], xy[:, 0])) * 48 / (2 * np.pi) - np.arange(48))
    assert (np.min(steps), np.max(steps)) == pytest.approx((-0.3, 0.3), abs=0.01)


def test_strokes_are_bows_of_some_length_and_width():
    """The angle from the first to the last corner of the outer side, and inner over outer sides."""
    lengths, widths = [], []
    for seed in range(1000):
        xy = cost_model._stroke(np.random.default_rng(seed), 12)
        assert xy.shape == (12, 2)
        steps = np.diff(xy, axis=0)
        turned = np.unwrap(np.arctan2(steps[:5, 1], steps[:5, 0]))
        lengths.append((turned[-1] - turned[0]) * 5 / 4)
        widths.append(np.hypot(*steps[-1]) / np.hypot(*steps[0]))
        assert shapely.Polygon(xy).is_valid
    assert (min(lengths), max(lengths)) == pytest.approx((0.5, 5.0), abs=0.05)
    assert (min(widths), max(widths)) == pytest.approx((0.3, 0.8), abs=0.01)


def test_the_draw_itself_is_there_once(designed_draws_0):
    assert (designed_draws_0[0][:, 0] == 1).all()


def one_term(rates: np.ndarray, ways: int = 3) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Return a design of triangles alone, each set of polygons at its own rate."""
    design = np.zeros((ways * len(rates), len(cost_model.TERMS)))
    design[:, 1] = np.tile(np.linspace(100.0, 200.0, ways), len(rates))
    design[:, 0] = 1e-6
    groups = np.repeat(np.arange(len(rates)), ways)
    return design, design[:, 1] * rates[groups], groups.tolist()


@pytest.mark.parametrize("odd", [0, 7])
def test_an_interval_knows_how_sets_of_polygons_differ(odd):
    """One set of eight costs a tenth more: a third of the resamples have it not, some thrice."""
    rates = np.ones(8)
    rates[odd] = 1.1
    design, seconds, groups = one_term(rates)
    fit = cost_model.fit(design, seconds, groups, resamples=60, terms=("triangles",))
    low, high = fit.intervals["triangles"]
    assert low == pytest.approx(1.0, abs=0.003)
    assert 1.015 < high < 1.08


def test_a_fit_tells_its_residuals_and_what_it_is_valid_for(designed_draws_0):
    design, sets = designed_draws_0
    noise = np.exp(0.1 * np.random.default_rng(5).standard_normal(len(design)))
    seconds = design @ TRUE * noise
    fit = cost_model.fit(design, seconds, sets, resamples=2)
    fitted = cost_model.predict(fit.coefficients, design)
    left = (seconds - fitted) / seconds
    quartiles = tuple(np.quantile(left, share) for share in (0.25, 0.5, 0.75))
    assert fit.relative_residuals == pytest.approx(quartiles)
    for number, name in enumerate(cost_model.TERMS):
        assert fit.valid[name] == (design[:, number].min(), design[:, number].max())


def test_a_set_of_polygons_counts_by_its_draws():
    """Nine draws of one set, and one of another that costs two per cent more."""
    columns, seconds = np.ones((10, 1)), np.r_[np.ones(9), 1.02]
    (found,) = cost_model.solve(columns, seconds, [*[0] * 9, 1])
    assert found == pytest.approx(1.002, abs=0.001)


def test_draws_that_another_program_disturbed_hardly_count():
    columns, seconds = np.ones((50, 1)), np.ones(50)
    seconds[:10] = 5.0
    (found,) = cost_model.solve(columns, seconds, list(range(50)))
    assert found == pytest.approx(1.0, abs=0.02)


def test_the_interval_of_a_coefficient_leaves_out_a_fortieth_at_each_end(
    designed_draws_0, monkeypatch
):
    """The fit itself finds 1; resamples find 0, 1, 2, ... up to 400."""
    found = iter([1.0, *map(float, range(401))])
    monkeypatch.setattr(
        cost_model, "solve", lambda design, *_, **__: np.full(design.shape[1], next(found))
    )
    design, labels = designed_draws_0
    made = cost_model.fit(design, design.sum(axis=1), labels, resamples=401)
    assert set(made.intervals.values()) == {(10.0, 390.0)}


def test_a_draw_may_have_nothing_of_a_term():
    design = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 5.0]])
    found = cost_model.solve(design, design @ [3.0, 2.0], [0, 0, 1, 1])
    assert found == pytest.approx([3.0, 2.0], rel=1e-3)


@pytest.mark.parametrize("signed", [False, True])
def test_terms_may_be_of_any_size(signed):
    size = np.array([1e9, 1e-30])
    design = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 5.0]])
    found = cost_model.solve(design * size, design @ [3.0, 2.0], [0, 0, 1, 1], signed=signed)
    assert found * size == pytest.approx([3.0, 2.0], rel=1e-3)


def test_what_is_known_at_once_does_not_end_the_search_for_the_rest():
    """Draws of one term are exact, one in five of another was disturbed."""
    design = np.repeat([[1.0, 0.0], [0.0, 1.0]], [5, 20], axis=0)
    seconds = design @ [3.0, 2.0]
    seconds[5:9] *= 5.0
    found = cost_model.solve(design, seconds, list(range(25)))
    assert found == pytest.approx([3.0, 2.0], rel=0.02)


def test_r2_is_the_share_of_the_variance_that_is_explained():
    measured, predicted = np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 4.0])
    assert cost_model.r_squared(measured, predicted) == pytest.approx(0.5)
    logs = np.array([0.0, 2.0, 10.0, 12.0]), np.array([0.0, 1.0, 5.0, 6.0])
    within = cost_model.r_squared_within(*np.exp(logs), ["a", "a", "b", "b"])
    assert within == pytest.approx(0.75)


def test_draws_that_are_compared_share_their_rounds():
    names = [f"polygon {number % 7}" for number in range(7 * 10)] + ["large"] * 40
    groups = list(calibration_draws._groups(names))
    assert sorted(place for group in groups for place in group) == list(range(len(names)))
    for name in set(names):
        assert sum(any(names[place] == name for place in group) for group in groups) == 1
    sizes = {len(group) for group in groups if "large" not in {names[place] for place in group}}
    assert max(sizes) == 20
    alone = calibration_draws._groups([str(number) for number in range(50)])
    assert [len(group) for group in alone] == [24, 24, 2]


def test_halves_are_of_other_epochs():
    rounds = np.array([1.0, 1.0, 1.0, 4.0, 4.0, 2.0, 2.0, 2.0])
    assert calibration_draws._halves(rounds, [3, 2, 3]) == [1.5, 4.0]
    # Rounds that are not of these epochs: every other one.
    assert calibration_draws._halves(rounds, [3, 2]) == [1.5, 2.0]
    assert calibration_draws._halves(np.array([1.0, 9.0, 1.0, 9.0]), [4]) == [1.0, 9.0]
