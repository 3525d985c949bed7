"""Thirty random moments of a run at which its parent is killed."""

from __future__ import annotations

import random

from tests.measuring.killing import CASES, WHOLE, kill_and_resume, plan_of
from tests.measuring.test_run import measure


def test_thirty_random_kills_lose_nothing(block, tmp_path):
    expected = measure(plan_of(block), tmp_path / "whole").records
    moments = random.Random(0)
    finished = [
        kill_and_resume(
            WHOLE,
            block,
            tmp_path / str(n),
            moments.randrange(-1, CASES),
            moments.uniform(0, 0.05),
            expected,
        )
        for n in range(30)
    ]
    print(f"\ncases finished at the kill: {sorted(finished)} of {len(expected)}")
    assert len(set(finished)) > 5
