"""Fits find what made-up times were made of, with intervals that hold it; profiles are kept."""

import json

import numpy as np
import pytest

from harness.errors import InputError
from harness.frame import bare_frame
from harness.measuring.timing import EMPTY, Times
from harness.profile import design, law, measured
from harness.profile.counted import TERMS, counters
from harness.profile.design import Draw
from harness.profile.law import COSTS, costs_of
from harness.profile.measured import CONTROL
from harness.profile.profile import fitted_of, read_coefficients, write_profile
from harness.stats.intervals import Ratio
from scripts.studies.laws import Design, fit_device, make_design
from tests.paths import ROOT

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


def test_terms_may_be_of_any_size():
    size = np.array([1e9, 1e-30])
    design = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 5.0]])
    found = law.solve(design * size, design @ [3.0, 2.0], [0, 0, 1, 1])
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


def test_noise_makes_no_cost_smaller():
    """As errors relative to the measured times would, by 0.3 %."""
    (found,) = law.solve(np.ones((40, 1)), np.tile([0.96, 1.04], 20), list(range(40)))
    assert found == pytest.approx(1.0, abs=1e-3)


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


CONTENT = {
    **json.loads((ROOT / "results/reference/profiles/opengl-llvmpipe.json").read_text()),
    "coefficients": dict.fromkeys(COSTS, 2.0),
}


def test_a_profile_is_written_and_read_back(tmp_path):
    file = tmp_path / "made" / "device.json"
    assert write_profile(CONTENT, file) == file
    assert read_coefficients(file) == CONTENT["coefficients"]


def test_a_refused_profile_leaves_the_good_one(tmp_path):
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
def test_what_is_no_profile_is_refused(tmp_path, content):
    file = tmp_path / "c.json"
    if content is not None:
        file.write_text(content)
    with pytest.raises(InputError, match="profile"):
        read_coefficients(file)


@pytest.fixture(scope="module")
def of() -> Design:
    return make_design()


def test_costs_are_within_their_intervals_and_what_costs_nothing_is_nothing(of):
    """The long simulation is kept in results/reference/law-coverage.csv."""
    held, nothing, costs, none = 0, 0, 0, 0
    for seed in range(4):
        truth, found = fit_device(of, seed, budget_s=0.15)
        inside = (found.intervals[:, 0] <= truth) & (truth <= found.intervals[:, 1])
        held, costs = held + int(inside[truth > 0].sum()), costs + int((truth > 0).sum())
        nothing += int((~found.shown)[truth == 0].sum())
        none += int((truth == 0).sum())
        assert found.r2_over > 0.99
        assert found.r2_within > 0.98
        assert found.shown[0]
    assert held >= 0.85 * costs
    assert nothing >= 0.85 * none


def test_the_fewest_terms_are_those_that_cost_something(of):
    truth = np.zeros(len(TERMS))
    places = {"draw": 2e-5, "triangles": 5e-8, "half_perimeter": 7e-9, "work": 3e-10}
    for name, cost in places.items():
        truth[list(TERMS).index(name)] = cost
    extra = []
    for seed in range(4):
        noise = np.exp(0.005 * np.random.default_rng(seed).standard_normal(len(of.rows)))
        found = set(law.fewest(of.rows, of.rows @ truth * noise, of.groups))
        assert found >= set(places)
        extra += found - set(places)
    assert len(extra) <= 1, "noise lets a term in now and then"
    assert law.fewest(of.rows, 2e-5 * of.rows[:, 0], of.groups) == ("draw",)


def test_a_draw_that_misses_the_law_widens_the_intervals(of):
    truth = np.zeros(len(TERMS))
    truth[:2] = 2e-5, 5e-8
    random = np.random.default_rng(0)
    widths = []
    for missed in (0.0, 0.05):
        times = of.rows @ truth * np.exp(missed * random.standard_normal(len(of.rows)))
        epochs = times * np.exp(0.005 * random.standard_normal((12, len(times))))
        found = law.fit(of.rows, epochs, of.groups)
        widths.append(np.ptp(found.intervals[0]) / truth[0])
    assert widths[1] > 3 * widths[0]


def rounds(*speeds: float, apart: float = 1.0) -> measured.Measured:
    """Return three draws' times in epochs of two rounds, the machine at these speeds."""
    samples = {"0": 1e-3, "1": 2e-3, "2": 4e-3, EMPTY: 1e-5, CONTROL: 2e-3 * apart}
    epochs = [2] * len(speeds)
    each = np.repeat(speeds, 2)
    times = {name: Times(1, (s * each).tolist(), epochs) for name, s in samples.items()}
    return measured.of_times(times, ["0", "1", "2"])


def test_a_machines_speed_does_not_change_what_draws_take():
    found = rounds(1.0, 1.1, 1.0 / 1.1, 1.0)
    assert found.times == pytest.approx([1e-3, 2e-3, 4e-3])
    assert np.ptp(found.epochs, axis=0) == pytest.approx(0.0, abs=1e-12)
    assert found.drift == pytest.approx(1.21)
    assert found.trouble == ""


def test_a_machine_that_slows_down_and_a_control_apart_are_told():
    assert "speed changed by a factor of 1.60" in rounds(1.0, 1.6, 1.2, 1.0).trouble
    assert "1.050 times its own time" in rounds(1.0, 1.0, 1.0, 1.0, apart=1.05).trouble
    found = rounds(1.0, 1.0, 1.0, 1.0, apart=1.02)
    assert isinstance(found.control, Ratio)
    assert found.trouble == ""


def drawn(points, size: int = 8) -> Draw:
    triangles = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    return Draw("", "", "", bare_frame(size, np.array(points, np.int32)), triangles)


def test_rows_are_those_whose_centres_a_triangle_reaches():
    tall, flat = [[0, 128], [300, 130], [0, 640]], [[0, 129], [9, 383], [9, 200]]
    # From the centre of row 0 to that of row 2; then between those of rows 0 and 1.
    assert counters(drawn(tall + flat))["rows"] == 3
    assert counters(drawn(flat))["rows"] == 0


def test_what_criteria_weigh_is_in_pixels():
    draw = drawn([[0, 0], [1024, 0], [0, 512]])
    (row,) = costs_of([(draw.frame, draw.triangles)])
    found = dict(zip(COSTS, row, strict=True))
    names = ("draw", "triangles", "area", "half_perimeter", "bbox_area")
    assert [found[name] for name in names] == [1.0, 1.0, 4.0, 6.0, 8.0]


@pytest.mark.parametrize(("of_a_group", "of_a_draw"), [(0.02, 0.005), (0.01, 0.01), (0.0, 0.01)])
def test_the_covariance_of_a_mean_is_that_of_a_one_way_analysis_of_variance(of_a_group, of_a_draw):
    """Of groups of any size; where groups differ less than draws do, the pooled mean square."""
    random = np.random.default_rng(4)
    sizes = np.array([2, 9, 5, 4, 3, 7, 6, 4])
    labels, number = np.repeat(np.arange(8), sizes), sizes.sum()
    errors = random.normal(0, of_a_group, 8)[labels] + random.normal(0, of_a_draw, number)
    seconds = 3.0 * np.exp(errors)
    (free,), ((variance,),) = law._covariance(np.ones((number, 1)), seconds, labels)
    shares = seconds / seconds.mean()
    means = np.bincount(labels, shares) / sizes
    own = ((shares - means[labels]) ** 2).sum() / (number - 8)
    between = (sizes * (means - 1.0) ** 2).sum() / 7
    common = (between - own) / ((number - (sizes**2).sum() / number) / 7)
    assert (common < 0) == (of_a_group == 0)
    if common < 0:
        own, common = shares.var(ddof=1), 0.0
    assert free == pytest.approx(seconds.mean(), rel=1e-3)
    expected = own / number + common * (sizes**2).sum() / number**2
    assert variance / free**2 == pytest.approx(expected, rel=0.03)


def test_a_cost_may_be_negative_where_it_is_free():
    """Or intervals would end at 0 whatever the draws tell."""
    rows = np.column_stack([np.ones(24), np.arange(24.0)])
    seconds = rows @ [10.0, -0.1]
    found = law.fit(rows, np.stack([seconds] * 3), [str(k // 4) for k in range(24)])
    assert found.free == pytest.approx([10.0, -0.1], rel=1e-6)
    assert found.costs[1] == 0.0
    assert found.groups == 6


@pytest.mark.parametrize(
    ("shares", "weights", "shown"),
    [
        ([[0.5, 0.0], [1e-5, 0.0]], [1, 0], True),  # much of one draw's time
        ([[1e-5, 0.0], [1e-5, 0.0]], [1, 0], False),
        ([[0.5, 1e-5], [1e-5, 0.5]], [1, 1], False),  # a draw has as many of both as of the rarer
        ([[0.5, 0.4], [0.0, 0.0]], [1, 1], True),
        ([[0.5, 1e-3], [0.0, 0.0]], [1, 3], False),  # three of the rarer go with one
    ],
)
def test_a_cost_is_shown_by_the_draw_that_has_most_of_it(shares, weights, shown):
    costs = np.ones(2)
    found = law.Law(costs, costs, np.eye(2) * 1e-12, 40, 1.0, 1.0, np.array(shares))
    assert found.is_shown(np.array(weights, float)) == shown
    # Student's interval with 20 degrees of freedom.
    assert found.intervals - 1.0 == pytest.approx(2.086e-6 * np.array([[-1, 1]] * 2), rel=1e-3)
