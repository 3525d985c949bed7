"""A thousand frames through one process."""

from __future__ import annotations

import numpy as np
import psutil
import pytest

from harness.rasterisers import Options
from tests.rasterisers import pictures

FRAMES = 1000
WARM_UP = 100
ALLOWED_BYTES = 20 * 2**20


@pytest.mark.parametrize("name", ["opengl", "bounding-box", "reference"])
def test_a_thousand_frames_leak_nothing(opened, reference, scattered, name):
    rasteriser = reference if name == "reference" else opened(name)
    process = psutil.Process()
    rng = np.random.default_rng(0)
    before = 0
    for number in range(FRAMES + WARM_UP):
        if number == WARM_UP:
            before = process.memory_info().rss
        # Sizes change, so that framebuffers are made and freed too.
        size = int(rng.integers(32, 128)) * 2
        frame, triangles = scattered(seed=number, size=size, number=20, grid=1)
        rasteriser.count(frame, triangles, Options())
        pictures.image_of(rasteriser, frame, triangles, Options())
        with rasteriser.prepare(frame, triangles, Options()) as drawing:
            drawing.sample(2)
    grown = process.memory_info().rss - before
    assert grown < ALLOWED_BYTES, f"{grown / 2**20:.1f} MiB"
