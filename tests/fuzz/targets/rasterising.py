"""Counters, on random triangles: pixel by pixel, in integers row by row, and on real devices."""

import atexit
from functools import cache
from typing import Any

import numpy as np
from hypothesis import strategies as st

from harness.measuring import tasks
from harness.rasterisers import Device, Options, find_device
from harness.rasterisers.reference import SHADED, predict
from harness.workers.worker import Worker
from tests.fuzz.target import target
from tests.rasterisers.conftest import loose_triangles
from tests.rasterisers.pictures import SIZE, require_exact_counts

corner = st.tuples(*[st.integers(0, SIZE * 256)] * 2)
half_pixel = st.tuples(*[st.integers(0, SIZE * 2).map(lambda v: v * 128)] * 2)


@target("spans", st.lists(corner | half_pixel, min_size=3, max_size=3))
def check_spans(value: list[list[int]]) -> None:
    """The reference against an evaluation of every pixel."""
    require_exact_counts(value)


@st.composite
def scattered(draw: st.DrawFn) -> dict[str, Any]:
    """Draw triangles inside a frame, their corners anywhere or on halves of a pixel."""
    size = draw(st.integers(8, 256))
    anywhere = st.tuples(*[st.integers(256, (size - 1) * 256)] * 2)
    halves = st.tuples(*[st.integers(2, 2 * size - 2).map(lambda v: v * 128)] * 2)
    triangle = st.tuples(*[anywhere | halves] * 3)
    return {"size": size, "triangles": draw(st.lists(triangle, min_size=1, max_size=12))}


@cache
def llvmpipe() -> tuple[Worker, Device]:
    """A process in which every rasteriser of the device is opened once."""
    device = find_device("opengl", "llvmpipe")
    worker = Worker("llvmpipe", device.environment)
    atexit.register(worker.close)
    return worker, device


@target("counters", scattered())
def check_counters(value: dict[str, Any]) -> None:
    """OpenGL and both walkers on llvmpipe against the reference, triangle by triangle."""
    frame, triangles = loose_triangles(np.array(value["triangles"]), value["size"])
    exact = predict(frame.points, triangles)
    worker, device = llvmpipe()

    def counted(name: str) -> dict[str, np.ndarray]:
        return worker.call(tasks.count, name, device, frame, triangles, Options(), timeout_s=60.0)

    drawn = counted("opengl")
    for name in SHADED:
        assert drawn[name].tolist() == exact[name].tolist(), name
    walked = counted("bounding-box")
    assert walked["bbox_tests"].tolist() == exact["bbox_tests"].tolist()
    for hits in (walked["hits"], counted("scanline")["hits"]):
        assert hits.tolist() == exact["fragments"].tolist()
