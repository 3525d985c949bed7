"""Inputs that are large in one way are read in time that grows with their size, not its square."""

from __future__ import annotations

import time

import pytest

from scenes import SceneError, load
from scripts.large_inputs import INPUTS

MOST_S = 30.0
"""Processor time of reading; it takes less than 3 s. What is quadratic took 90 s and more."""


@pytest.mark.parametrize("name", INPUTS)
def test_it_is_read_or_refused_soon(tmp_path, name):
    file = INPUTS[name](tmp_path)
    start = time.process_time()
    if "crossing" in name:
        with pytest.raises(SceneError, match="self-intersects"):
            load(str(file))
    else:
        assert len(load(str(file)).polygons) == 1
    assert time.process_time() - start < MOST_S
