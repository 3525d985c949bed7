"""Terms that a law may lack: rows of pixels, and the tiles that a device fetches."""

from __future__ import annotations

import numpy as np
import pytest

from harness.frame import bare_frame
from harness.profile import design
from harness.profile.counted import TERMS, counters, design_of
from harness.profile.design import Draw
from scripts.studies.missing_terms import TILE, fetched, judged


def drawn(points, size: int = 8) -> Draw:
    triangles = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    return Draw("", "", "", bare_frame(size, np.array(points, np.int32)), triangles)


def test_rows_are_those_whose_centres_a_triangle_reaches():
    tall, flat = [[0, 128], [300, 130], [0, 640]], [[0, 129], [9, 383], [9, 200]]
    # From the centre of row 0 to that of row 2; then between those of rows 0 and 1.
    assert counters(drawn(tall + flat))["rows"] == 3
    assert counters(drawn(flat))["rows"] == 0


def test_a_tile_is_fetched_when_another_has_taken_its_place():
    def at(x: int, y: int) -> list[list[int]]:
        left, bottom = x * TILE * 256, y * TILE * 256
        return [[left, bottom], [left + 256, bottom], [left, bottom + 256]]

    assert fetched(drawn(at(0, 0) + at(1, 0) + at(0, 0), 1024)) == 2
    # Ten tiles up is the same place; five to the right of one above is not.
    assert fetched(drawn(at(0, 0) + at(0, 10) + at(0, 0), 1024)) == 3
    assert fetched(drawn(at(5, 0) + at(0, 1) + at(5, 0), 1024)) == 3
    assert fetched(drawn(at(4, 0) + at(0, 1) + at(4, 0), 1024)) == 2
    across = [[0, 0], [2 * TILE * 256, 256], [0, 256]]
    assert fetched(drawn(across, 1024)) == 2


@pytest.mark.parametrize("missing", ["rows", "tiles"])
def test_what_costs_something_and_is_left_out_is_missed(missing):
    draws = design.draws()
    counted = [counters(draw) for draw in draws]
    truth = dict.fromkeys(TERMS, 0.0) | {"draw": 2e-5, "triangles": 2e-7}
    seconds = design_of(counted) @ np.array(list(truth.values()))
    more = [each["rows"] if missing == "rows" else 0 for each in counted]
    if missing == "tiles":
        more = [100 * fetched(draw) for draw in draws]
    seconds += 5e-8 * np.array(more)
    times = [
        {"kind": draw.kind, "name": draw.name, "epochs": [value] * 4}
        for draw, value in zip(draws, seconds, strict=True)
    ]
    found = judged({"device": {"details": {}}, "seed": 0, "times": times, "empty": 2e-5})
    assert found["tiles_within"] > 0.999
    if missing == "rows":
        assert found["r2_within"] > 0.999
        assert found["no_rows_within"] < 0.98
        assert found["steep_64"] > 2.0
    else:
        assert found["r2_within"] < 0.98
