"""Regret in helper lanes: where none are needed there is nothing to be relative to."""

from __future__ import annotations

import pytest

from harness.figures.registry import LEAST, _regret


@pytest.mark.parametrize(("quads", "told"), [(1, False), (2, True)])
def test_there_is_none_where_no_helper_lane_is_needed(quads, told):
    least = {"polygons": 1, "quads": quads, "shaded": 4, "fragments": 4}
    record = {LEAST: least, "counters": {"quads": 2, "helper_lanes": 4, "fragments": 4}}
    assert (_regret(record) is not None) is told
