"""Kill -9 at any moment: every finished case is there, and the run can be completed."""

from __future__ import annotations

from tests.measuring.killing import ALONE, CASES, kill_and_resume, plan_of
from tests.measuring.test_run import measure


def test_a_killed_run_loses_nothing_and_can_be_resumed(block, tmp_path):
    expected = measure(plan_of(block), tmp_path / "whole").records
    assert len(expected) == CASES
    # `make bench` kills the whole command at 30 moments.
    finished = kill_and_resume(ALONE, block, tmp_path / "killed", 9, 0.01, expected)
    assert 9 <= finished < CASES
