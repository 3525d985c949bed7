"""Kill -9 at any moment: every finished case is there, and the run can be completed."""

from __future__ import annotations

import random

from tests.measuring.killing import kill_and_resume, whole_run


def test_a_killed_run_loses_nothing_and_can_be_resumed(block, tmp_path):
    expected = whole_run(block, tmp_path / "whole")
    assert len(expected) == 24
    # `make bench` tries 30 moments.
    moments = random.Random(5)
    for number, cases in enumerate((3, 14)):
        later = moments.uniform(0, 0.02)
        finished = kill_and_resume(block, tmp_path / str(number), cases, later, expected)
        assert cases <= finished < 24
