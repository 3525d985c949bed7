"""A device that goes through triangles row by row is told from one that does not."""

from __future__ import annotations

import numpy as np
import pytest

from harness.frame import bare_frame
from harness.profile import design
from harness.profile.counted import counters, design_of
from harness.profile.design import Draw
from scripts.studies.rows import judged, rows_of


def test_rows_are_those_whose_centres_a_triangle_reaches():
    points = np.array([[0, 128], [300, 130], [0, 640], [0, 129], [9, 383], [9, 200]], np.int32)
    triangles = np.arange(6, dtype=np.int32).reshape(2, 3)
    # From the centre of row 0 to that of row 2; then between those of rows 0 and 1.
    assert rows_of(Draw("", "", "", bare_frame(8, points), triangles)) == 3
    assert rows_of(Draw("", "", "", bare_frame(8, points), triangles[1:])) == 0


@pytest.mark.parametrize("cost", [0.0, 5e-8])
def test_a_row_that_costs_something_is_missed(cost):
    draws = design.draws()
    counted = [counters(draw) for draw in draws]
    columns = design_of(counted)
    truth = np.zeros(columns.shape[1])
    truth[:2] = 2e-5, 2e-7
    seconds = columns @ truth + cost * np.array([rows_of(draw) for draw in draws])
    times = [
        {"kind": draw.kind, "name": draw.name, "counters": each, "epochs_s": [value] * 4}
        for draw, each, value in zip(draws, counted, seconds, strict=True)
    ]
    found = judged({"device": {"details": {}}, "seed": 0, "times": times, "empty_s": 2e-5})
    assert found["row_s"] == pytest.approx(cost, abs=1e-12)
    assert found["with_rows_within"] > 0.999
    if cost:
        assert found["r2_within"] < 0.98
        assert found["steep_64"] > 2.0
    else:
        assert found["r2_within"] > 0.999
        assert found["steep_64"] == pytest.approx(1.0)
