"""The law of a device whose costs are known: found, with intervals that hold them."""

from __future__ import annotations

import numpy as np
import pytest

from harness.figures.intervals import Ratio
from harness.measuring.timing import EMPTY, Times
from harness.profile import law, measured
from harness.profile.counted import TERMS
from harness.profile.measured import CONTROL
from scripts.studies.laws import Design, designed, go


@pytest.fixture(scope="module")
def of() -> Design:
    return designed()


def test_costs_are_within_their_intervals_and_what_costs_nothing_is_nothing(of):
    """The long simulation is kept in results/reference/law-coverage.csv."""
    held, nothing, costs, none = 0, 0, 0, 0
    for seed in range(4):
        truth, found = go(of, seed, budget_s=0.15)
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


@pytest.mark.parametrize(("of_a_group", "of_a_draw"), [(0.02, 0.005), (0.01, 0.01), (0.0, 0.01)])
def test_the_covariance_of_a_mean_is_that_of_a_one_way_analysis_of_variance(of_a_group, of_a_draw):
    """Of draws in equal groups: the mean square between groups, or the pooled one if it is less."""
    random = np.random.default_rng(3)
    groups, draws = 8, 5
    errors = np.repeat(random.normal(0, of_a_group, groups), draws)
    seconds = 3.0 * np.exp(errors + random.normal(0, of_a_draw, groups * draws))
    labels = np.repeat(np.arange(groups), draws)
    (free,), ((variance,),) = law._covariance(np.ones((groups * draws, 1)), seconds, labels)
    table = (seconds / seconds.mean()).reshape(groups, draws)
    between = draws * table.mean(axis=1).var(ddof=1)
    within = ((table - table.mean(axis=1)[:, None]) ** 2).sum() / (groups * (draws - 1))
    pooled = table.var(ddof=1)
    expected = between if between > within else pooled
    assert free == pytest.approx(seconds.mean(), rel=1e-3)
    assert variance / free**2 == pytest.approx(expected / (groups * draws), rel=0.02)


def test_a_cost_may_be_negative_where_it_is_free():
    """Or intervals would end at 0 whatever the draws tell."""
    rows = np.column_stack([np.ones(24), np.arange(24.0)])
    seconds = rows @ [10.0, -0.1]
    found = law.fit(rows, np.stack([seconds] * 3), [str(k // 4) for k in range(24)])
    assert found.free == pytest.approx([10.0, -0.1], rel=1e-6)
    assert found.costs[1] == 0.0


@pytest.mark.parametrize(
    ("shares", "weights", "shown"),
    [
        ([[0.5, 0.0], [1e-5, 0.0]], [1, 0], True),  # much of one draw's time
        ([[1e-5, 0.0], [1e-5, 0.0]], [1, 0], False),
        ([[0.5, 1e-5], [1e-5, 0.5]], [1, 1], False),  # a draw has as many of both as of the rarer
        ([[0.5, 0.4], [0.0, 0.0]], [1, 1], True),
    ],
)
def test_a_cost_is_shown_by_the_draw_that_has_most_of_it(shares, weights, shown):
    costs = np.ones(2)
    found = law.Law(costs, costs, np.eye(2) * 1e-12, 40, 1.0, 1.0, np.array(shares))
    assert found.is_shown(np.array(weights, float)) == shown
