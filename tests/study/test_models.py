"""Choosing the terms of a device's cost model, on made-up times whose terms are known."""

from __future__ import annotations

import numpy as np
import pytest

from harness.errors import UsageError
from harness.study import model_terms
from harness.study.cost_model import TERMS
from harness.study.model_terms import HeldOut, alternatives, fewest, named

POLYGONS, WAYS = 30, 8
TRUE = {"draw": 8e-6, "triangles": 5e-8, "area": 1e-10, "half_perimeter": 8e-9}


def made(seed: int, groups: int, ways: int, shape: float = 0.0):
    """Return designs (k, 9) whose times have noise of 1 %, their seconds, halves and groups.

    shape : seconds that a degree of D takes; D says nothing of the other terms
    """
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(groups), ways)
    triangles = np.exp(rng.uniform(2, 6, groups))[group]
    area = np.exp(rng.uniform(5, 12, groups))[group]
    spread = rng.uniform(1.0, 2.0, len(group))
    half_perimeter = triangles * np.sqrt(area / triangles) * 2 * spread
    columns = dict.fromkeys(TERMS, np.zeros(len(group))) | {
        "draw": np.ones(len(group)),
        "triangles": triangles,
        "area": area,
        "half_perimeter": half_perimeter,
        "bbox_area": area * rng.uniform(1.0, 3.0, len(group)),
        "shape": triangles * rng.uniform(20, 200, len(group)),
        "expected_quads": area / 4 + half_perimeter * rng.uniform(0.2, 0.3, len(group)),
        "expected_blocks": area / 16 + half_perimeter * rng.uniform(0.05, 0.07, len(group)),
        "expected_setups": triangles * rng.uniform(0.7, 1.0, len(group)),
    }
    design = np.column_stack([columns[name] for name in TERMS])
    seconds = sum(rate * columns[name] for name, rate in TRUE.items()) + shape * columns["shape"]
    halves = seconds[:, None] * np.exp(0.003 * rng.standard_normal((len(group), 2)))
    return design, seconds, halves, group.tolist()


def chosen_of(shape: float = 0.0) -> tuple[list[model_terms.Model], model_terms.Model]:
    design, seconds, _, groups = made(0, 60, 4, shape)
    held_design, held_seconds, halves, polygons = made(1, POLYGONS, WAYS, shape)
    held_out = HeldOut(held_design, held_seconds, halves, [f"city {k}" for k in polygons])
    found = alternatives(design, seconds, groups, *held_out.split())
    return found, fewest(found)


@pytest.fixture(scope="module")
def three_terms():
    return chosen_of()


def test_the_terms_that_made_the_times_are_chosen(three_terms):
    found, chosen = three_terms
    assert chosen.terms == ("triangles", "area", "half_perimeter")
    assert chosen.written == "T + S + H"
    assert chosen.r2_over > 0.999
    for name, rate in TRUE.items():
        assert chosen.coefficients[name] == pytest.approx(rate, rel=0.05)
    assert [len(model.terms) for model in found] == list(range(1, len(TERMS)))


def test_fewer_terms_do_worse_and_more_hardly_better(three_terms):
    found, chosen = three_terms
    assert all(model.distance > 1 for model in found[:2])
    assert all(abs(model.r2_over - chosen.r2_over) < 1e-3 for model in found[3:])
    assert chosen.regret < 0.003


def test_a_term_that_costs_something_is_not_left_out():
    _, chosen = chosen_of(shape=4e-9)
    assert "shape" in chosen.terms


def test_regret_is_what_the_choice_costs_more():
    held_out = HeldOut(
        np.zeros((4, len(TERMS))),
        np.array([1.0, 2.0, 3.0, 1.0]),
        np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0], [1.0, 1.0]]),
        ["a", "a", "b", "b"],
    )
    right, wrong = np.array([1.0, 2.0, 2.0, 1.0]), np.array([2.0, 1.0, 1.0, 2.0])
    assert model_terms._regrets(held_out, right).tolist() == [[0.0, 0.0]] * 2
    assert np.allclose(model_terms._regrets(held_out, wrong), [[1.0, 2.0]] * 2)


def test_noise_alone_makes_no_regret():
    rng = np.random.default_rng(5)
    polygons = [f"p {k // 10}" for k in range(2000)]
    halves = np.exp(0.05 * rng.standard_normal((2000, 2)))
    held_out = HeldOut(np.zeros((2000, len(TERMS))), np.ones(2000), halves, polygons)
    below, above = model_terms._regrets(held_out, rng.uniform(1, 2, 2000))
    assert below.mean() < 0.01 < above.mean()


def test_what_is_told_is_of_polygons_that_chose_nothing():
    """The polygons by which sets are chosen may be anything: they decide no figure."""
    design, seconds, _, groups = made(0, 60, 4)
    held_design, held_seconds, halves, polygons = made(1, 12, WAYS)
    held_out = HeldOut(held_design, held_seconds, halves, [f"city {k}" for k in polygons])
    choosing, telling = held_out.split()
    assert not set(choosing.polygons) & set(telling.polygons)
    assert {*choosing.polygons, *telling.polygons} == set(held_out.polygons)
    terms = ("triangles", "area")
    other = HeldOut(choosing.design, choosing.seconds * 7, choosing.halves * 7, choosing.polygons)
    told = [
        alternatives(design, seconds, groups, each, telling, terms)[-1]
        for each in (choosing, other)
    ]
    assert told[0].r2_over == told[1].r2_over
    assert told[0].regret == told[1].regret


def test_terms_are_named_by_letters():
    assert named(["H", "T", "w*h"]) == ("triangles", "half_perimeter", "bbox_area")
    assert named([]) == ()
    with pytest.raises(UsageError, match="unknown term 'X'"):
        named(["T", "X"])
