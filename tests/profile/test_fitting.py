"""Fits recover the costs of synthetic times and their intervals cover them; files of profiles."""

import json

import numpy as np
import pytest

from harness.errors import InputError
from harness.frame import make_bare_frame
from harness.measuring.timing import EMPTY, Times
from harness.profile import cost_terms, design, law, measured
from harness.profile.cost_terms import TERMS, count_draw
from harness.profile.law import COSTS, make_cost_rows
from harness.profile.measured import CONTROL
from harness.profile.placing import Draw
from harness.profile.profile import read_coefficients, select_draws_to_fit, write_profile
from scripts.studies.laws import Design, fit_device, make_design
from tests.paths import ROOT
from tests.profile.charging import STAGE_COSTS

TRUE_COSTS = np.array([8e-6, 4e-8, 1.0e-9, 1.0e-8, 0.0, 1e-10, 0.0, 1.2e-8, 2e-8])


@pytest.fixture(scope="module")
def criteria_costs() -> tuple[np.ndarray, np.ndarray]:
    """Return the features of a profile's draws that criteria use, and the groups of draws."""
    draws = design.make_draws()
    plain = [draws[index] for index in select_draws_to_fit(draws)[1]]
    groups = np.unique([draw.group for draw in plain], return_inverse=True)[1]
    return make_cost_rows([(draw.frame, draw.triangles) for draw in plain]), groups


def test_fit_is_robust_to_noise_and_outliers(criteria_costs):
    rows, groups = criteria_costs
    random = np.random.default_rng(0)
    seconds = rows @ TRUE_COSTS * np.exp(0.01 * random.standard_normal(len(rows)))
    seconds[random.random(len(rows)) < 0.03] *= 1.5
    costs = cost_terms.fit_coefficients(rows, seconds, groups)
    assert (costs >= 0).all()
    assert rows @ costs == pytest.approx(rows @ TRUE_COSTS, rel=0.04)


def test_common_errors_of_groups_affect_the_fit_little(criteria_costs):
    rows, groups = criteria_costs
    common = np.exp(0.2 * np.random.default_rng(0).standard_normal(groups.max() + 1))
    costs = cost_terms.fit_coefficients(rows, rows @ TRUE_COSTS * common[groups], groups)
    r2 = cost_terms.compute_r_squared_within(rows @ TRUE_COSTS, rows @ costs, groups)
    # With a weight of 1 for common errors instead of `BETWEEN_WEIGHT`, it is 0.9996.
    assert r2 > 0.9999


def test_scale_of_terms_does_not_matter():
    size = np.array([1e9, 1e-30])
    design = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 5.0]])
    costs = cost_terms.fit_coefficients(design * size, design @ [3.0, 2.0], [0, 0, 1, 1])
    assert costs * size == pytest.approx([3.0, 2.0], rel=1e-3)


def test_groups_are_weighted_by_their_draws():
    """Nine draws of a group, and one of another group that costs 2 % more."""
    columns, seconds = np.ones((10, 1)), np.r_[np.ones(9), 1.02]
    (cost,) = cost_terms.fit_coefficients(columns, seconds, [*[0] * 9, 1])
    assert cost == pytest.approx(1.002, abs=0.001)


def test_noise_does_not_bias_costs():
    """Errors relative to the measured times would bias costs by 0.3 %."""
    (cost,) = cost_terms.fit_coefficients(
        np.ones((40, 1)), np.tile([0.96, 1.04], 20), list(range(40))
    )
    assert cost == pytest.approx(1.0, abs=1e-3)


def test_fit_continues_after_some_draws_are_exact():
    """Draws of one term are exact, and one in five of the other term is disturbed."""
    design = np.repeat([[1.0, 0.0], [0.0, 1.0]], [5, 20], axis=0)
    seconds = design @ [3.0, 2.0]
    seconds[5:9] *= 5.0
    costs = cost_terms.fit_coefficients(design, seconds, list(range(25)))
    assert costs == pytest.approx([3.0, 2.0], rel=0.02)


def test_r2_is_the_explained_share_of_the_variance():
    measured, predicted = np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 4.0])
    assert cost_terms.compute_r_squared(measured, predicted) == pytest.approx(0.5)
    logs = np.array([0.0, 2.0, 10.0, 12.0]), np.array([0.0, 1.0, 5.0, 6.0])
    within = cost_terms.compute_r_squared_within(*np.exp(logs), ["a", "a", "b", "b"])
    assert within == pytest.approx(0.75)


CONTENT = {
    **json.loads((ROOT / "results/reference/profiles/opengl-llvmpipe.json").read_text()),
    "coefficients": dict.fromkeys(COSTS, 2e-9),
}


def test_refused_profile_does_not_replace_a_good_one(tmp_path):
    good = write_profile(CONTENT, tmp_path / "device.json")
    before = good.read_bytes()
    refused = write_profile({**CONTENT, "refused": True}, good)
    assert refused.name == "device.refused.json"
    assert good.read_bytes() == before
    with pytest.raises(InputError, match=r"refused.*repeat raster-harness profile"):
        read_coefficients(refused)


@pytest.mark.parametrize(
    "content", [None, "{}", "no JSON", json.dumps({"coefficients": {"draw": "x"}}), "[1]"]
)
def test_files_other_than_profiles_are_refused(tmp_path, content):
    file = tmp_path / "c.json"
    if content is not None:
        file.write_text(content)
    with pytest.raises(InputError, match="profile"):
        read_coefficients(file)


@pytest.fixture(scope="module")
def layout() -> Design:
    return make_design()


def test_intervals_cover_costs_without_false_ones(layout):
    """The full simulation is stored in results/reference/law-coverage.csv."""
    covered, not_significant = [], []
    for seed in range(4):
        truth, _, fitted = fit_device(layout, seed, budget_s=0.15)
        inside = (fitted.intervals[:, 0] <= truth) & (truth <= fitted.intervals[:, 1])
        covered += inside[truth > 0].tolist()
        not_significant += (~fitted.significant)[truth == 0].tolist()
        assert fitted.form == "sum"
        assert fitted.r2_over > 0.99
        assert fitted.r2_within > 0.98
        assert fitted.significant[0]
    assert np.mean(covered) >= 0.85
    assert np.mean(not_significant) >= 0.85


@pytest.mark.parametrize("form", law.FORMS)
def test_form_and_costs_of_a_device_are_found(layout, form):
    truth = np.array([STAGE_COSTS.get(name, 0.0) for name in TERMS])
    times = law.predict_times(layout.rows, truth, form)
    noise = np.exp(0.02 * np.random.default_rng(1).standard_normal(len(times)))
    fitted = law.fit_law(layout.rows, (times * noise)[None], layout.groups)
    assert fitted.form == form
    assert fitted.errors[form] == min(fitted.errors.values())
    stage_times = law.compute_stage_times(layout.rows, truth, form)
    assert (fitted.binding == stage_times.argmax(axis=1)).mean() > 0.95
    predicted = law.predict_times(layout.rows, fitted.costs, form)
    assert predicted == pytest.approx(times, rel=0.1)
    covered = (fitted.intervals[:, 0] <= truth) & (truth <= fitted.intervals[:, 1])
    assert covered.mean() > 0.9


def test_costs_that_no_draw_determines_are_unknown(layout):
    """The stage of vertices is never slowest, and each covering triangle overlaps one tile."""
    index = {name: number for number, name in enumerate(TERMS)}
    covering = layout.rows[:, index["covering"]]
    retained = covering > 0.3 * layout.rows[:, index["triangles"]]
    rows = layout.rows[retained]
    rows[:, index["tile_pairs"]] = covering[retained]
    truth = np.array([STAGE_COSTS.get(name, 0.0) for name in TERMS])
    truth[index["transformed_vertices"]] = 1e-13
    form = "maximum of three stages"
    times = law.predict_times(rows, truth, form)
    groups = np.array(layout.groups)[retained].tolist()
    fitted = law.fit_law(rows, times[None], groups, form)
    unknown = {"transformed_vertices", "vertex_batches", "tile_pairs", "covering"}
    assert {name for name in TERMS if not fitted.known[index[name]]} == unknown
    for name in unknown:
        column = rows[:, index[name]]
        bound = (times[column > 0] / column[column > 0]).min()
        assert fitted.intervals[index[name]] == pytest.approx([0.0, bound])
        assert not fitted.significant[index[name]]


def test_form_with_more_stages_must_predict_significantly_better():
    errors = np.array([0.10, 0.12, 0.08, 0.11, 0.09])
    noise = np.array([0.02, -0.02, 0.01, -0.01, 0.0])
    # The standard error of the mean of `noise` is 0.0071.
    assert law.choose_form({"sum": errors, "maximum": errors + noise - 0.007}) == "sum"
    assert law.choose_form({"sum": errors, "maximum": errors + noise - 0.0072}) == "maximum"
    for improvement, chosen in ((0.0105, "sum"), (0.0107, "maximum of four stages")):
        more = {"maximum of four stages": errors + noise - improvement}
        assert law.choose_form({"sum": errors, **more}) == chosen


def test_deviations_from_the_law_widen_intervals(layout):
    truth = np.zeros(len(TERMS))
    truth[:2] = 2e-5, 5e-8
    random = np.random.default_rng(0)
    widths = []
    for deviation in (0.0, 0.05):
        times = layout.rows @ truth * np.exp(deviation * random.standard_normal(len(layout.rows)))
        epochs = times * np.exp(0.005 * random.standard_normal((12, len(times))))
        fitted = law.fit_law(layout.rows, epochs, layout.groups)
        widths.append(np.ptp(fitted.intervals[0]) / truth[0])
    assert widths[1] > 3 * widths[0]


def simulate_rounds(*speeds: float, control_ratio: float = 1.0) -> measured.DrawTimes:
    """Return the times of three draws in epochs of two rounds with these speeds of the machine."""
    samples = {"0": 1e-3, "1": 2e-3, "2": 4e-3, EMPTY: 1e-5, CONTROL: 2e-3 * control_ratio}
    epochs = [2] * len(speeds)
    factors = np.repeat(speeds, 2)
    times = {name: Times(1, (s * factors).tolist(), epochs) for name, s in samples.items()}
    return measured.normalise_times(times, ["0", "1", "2"])


def test_drift_and_a_deviating_control_are_reported():
    drifting = simulate_rounds(1.0, 1.6, 1.2, 1.0)
    assert "speed changed by a factor of 1.60" in drifting.unreliable_reason
    deviating = simulate_rounds(1.0, 1.0, 1.0, 1.0, control_ratio=1.05)
    assert "differs by a factor of 1.050" in deviating.unreliable_reason
    assert simulate_rounds(1.0, 1.0, 1.0, 1.0, control_ratio=1.02).unreliable_reason == ""


def make_draw(points, size: int = 8) -> Draw:
    triangles = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    return Draw("", "", "", make_bare_frame(size, np.array(points, np.int32)), triangles)


def test_rows_counts_pixel_rows_with_centres_in_the_triangle():
    tall, flat = [[0, 128], [300, 130], [0, 640]], [[0, 129], [9, 383], [9, 200]]
    # One triangle spans the centres of rows 0 to 2, the other lies between those of rows 0 and 1.
    assert count_draw(make_draw(tall + flat))["rows"] == 3
    assert count_draw(make_draw(flat))["rows"] == 0


def test_features_of_criteria_are_in_pixels():
    draw = make_draw([[0, 0], [1024, 0], [0, 512]])
    (row,) = make_cost_rows([(draw.frame, draw.triangles)])
    features = dict(zip(COSTS, row, strict=True))
    names = ("draw", "triangles", "area", "half_perimeter", "bbox_area")
    assert [features[name] for name in names] == [1.0, 1.0, 4.0, 6.0, 8.0]


@pytest.mark.parametrize(("group_error", "draw_error"), [(0.02, 0.005), (0.01, 0.01), (0.0, 0.01)])
def test_covariance_of_a_mean_equals_one_way_analysis_of_variance(group_error, draw_error):
    """Groups have any size; if they differ less than draws do, the mean square is pooled."""
    random = np.random.default_rng(4)
    sizes = np.array([2, 9, 5, 4, 3, 7, 6, 4])
    labels, number = np.repeat(np.arange(8), sizes), sizes.sum()
    errors = random.normal(0, group_error, 8)[labels] + random.normal(0, draw_error, number)
    seconds = 3.0 * np.exp(errors)
    (free,), ((variance,),), _ = law._estimate_covariance(np.ones((number, 1)), seconds, labels)
    shares = seconds / seconds.mean()
    means = np.bincount(labels, shares) / sizes
    within = ((shares - means[labels]) ** 2).sum() / (number - 8)
    between = (sizes * (means - 1.0) ** 2).sum() / 7
    common = (between - within) / ((number - (sizes**2).sum() / number) / 7)
    assert (common < 0) == (group_error == 0)
    if common < 0:
        within, common = shares.var(ddof=1), 0.0
    assert free == pytest.approx(seconds.mean(), rel=1e-3)
    expected = within / number + common * (sizes**2).sum() / number**2
    assert variance / free**2 == pytest.approx(expected, rel=0.03)


def test_unconstrained_cost_may_be_negative():
    """Otherwise intervals would always end at 0."""
    rows = np.zeros((24, len(TERMS)))
    rows[:, 0], rows[:, 1] = 1.0, np.arange(24.0)
    seconds = rows[:, :2] @ [10.0, -0.1]
    groups = [str(k // 4) for k in range(24)]
    fitted = law.fit_law(rows, np.stack([seconds] * 3), groups, "sum")
    assert fitted.signed_costs[:2] == pytest.approx([10.0, -0.1], rel=1e-6)
    assert fitted.costs[1] == 0.0
    assert fitted.groups == 6


@pytest.mark.parametrize(
    ("shares", "known", "shown"),
    [
        ([[0.5, 0.0], [1e-5, 0.0]], True, True),  # a large share of a draw's time
        ([[1e-5, 0.0], [1e-5, 0.0]], True, False),
        ([[0.5, 0.0], [1e-5, 0.0]], False, False),
    ],
)
def test_significance_is_decided_by_the_draw_with_the_largest_share(shares, known, shown):
    costs, bounds = np.ones(2), np.full(2, 7.0)
    fitted = law.Law(
        *("sum", costs, costs, np.eye(2) * 1e-12, np.full(2, known), bounds, 40),
        *(np.zeros(2, int), np.array(shares), {}, 1.0, 1.0),
    )
    assert fitted.significant.tolist() == [shown, False]
    # Student's interval with 20 degrees of freedom, times `DEVIATION_FACTOR`.
    width = 1.7 * 2.086e-6 * np.array([[-1, 1]] * 2)
    expected = 1.0 + width if known else np.array([[0.0, 7.0]] * 2)
    assert fitted.intervals - 1.0 == pytest.approx(expected - 1.0, rel=1e-3)
