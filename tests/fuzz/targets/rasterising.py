"""Counters of random triangles: per pixel, by the exact reference, and on devices."""

import atexit
from functools import cache
from typing import Any

import numpy as np
from hypothesis import strategies as st

from harness.measuring import tasks
from harness.rasterisers import Device, Options, find_device
from harness.rasterisers.reference import SHADED, count_per_triangle
from harness.worker import Worker
from tests.fuzz.target import target
from tests.rasterisers.conftest import loose_triangles
from tests.rasterisers.pictures import SIZE, require_exact_counts

corner = st.tuples(*[st.integers(0, SIZE * 256)] * 2)
half_pixel = st.tuples(*[st.integers(0, SIZE * 2).map(lambda v: v * 128)] * 2)


@target("spans", st.lists(corner | half_pixel, min_size=3, max_size=3))
def check_spans(value: list[list[int]]) -> None:
    """Compare the reference with an evaluation of every pixel."""
    require_exact_counts(value)


@st.composite
def draw_triangles(draw: st.DrawFn) -> dict[str, Any]:
    """Draw triangles in a frame with vertices at any position or at half pixels."""
    size = draw(st.integers(8, 256))
    any_position = st.tuples(*[st.integers(256, (size - 1) * 256)] * 2)
    halves = st.tuples(*[st.integers(2, 2 * size - 2).map(lambda v: v * 128)] * 2)
    triangle = st.tuples(*[any_position | halves] * 3)
    return {"size": size, "triangles": draw(st.lists(triangle, min_size=1, max_size=12))}


@cache
def open_llvmpipe() -> tuple[Worker, Device]:
    """Return a worker process that opens each rasteriser of the device once, and the device."""
    device = find_device("opengl", "llvmpipe")
    worker = Worker("llvmpipe", device.environment)
    atexit.register(worker.close)
    return worker, device


@target("counters", draw_triangles())
def check_counters(value: dict[str, Any]) -> None:
    """Compare OpenGL and both compute rasterisers on llvmpipe with the reference, by triangle."""
    frame, triangles = loose_triangles(np.array(value["triangles"]), value["size"])
    exact = count_per_triangle(frame.points, triangles)
    worker, device = open_llvmpipe()

    def count(name: str) -> dict[str, np.ndarray]:
        return worker.call(
            tasks.draw_and_count, name, device, frame, triangles, Options(), timeout_s=60.0
        )

    opengl = count("opengl")
    for name in SHADED:
        assert opengl[name].tolist() == exact[name].tolist(), name
    boxes = count("bounding-box")
    assert boxes["bbox_tests"].tolist() == exact["bbox_tests"].tolist()
    for hits in (boxes["hits"], count("scanline")["hits"]):
        assert hits.tolist() == exact["fragments"].tolist()
