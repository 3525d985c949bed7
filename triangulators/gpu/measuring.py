"""The self-test of a device: are its results the CPU's, and is it faster?"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from triangulators.batch import Ragged, Triangulations, triangulate_many
from triangulators.gpu.engine import describe
from triangulators.gpu.remembered import Measured, Pace, recall, remember

FOOTPRINTS = 20_000
LARGE_CORNERS, LARGE_COUNT = 512, 4
ROUNDS = 3


def measure_device(name: str, *, again: bool = False) -> Measured:
    """Return what a device is worth on this machine, measured once and then remembered.

    From then on `triangulate_many` uses it unasked where it was the faster one. again: measure even
    if it was measured before. Takes a second or so. Raises `UnknownName`, and
    `gpu.context.DeviceFailed` if the device cannot be opened.
    """
    renderer, version = describe(name)
    known = recall().get(name)
    if known is not None and not again and (known.renderer, known.version) == (renderer, version):
        return known
    small = stars(np.random.default_rng(1).integers(4, 25, FOOTPRINTS))
    large = stars(np.full(LARGE_COUNT, LARGE_CORNERS))
    one, other = stars(np.array([8])), stars(np.array([80]))
    mixed = stars(np.random.default_rng(2).integers(4, 300, 200))
    equal = all(_equal(each, name) for each in (small, large, mixed))
    triples = LARGE_COUNT * LARGE_CORNERS**3 / 6.0
    found = Measured(
        renderer,
        version,
        equal,
        _pace(name, small, one, FOOTPRINTS),
        _pace(name, large, other, triples),
    )
    remember(name, found)
    return found


def stars(corners: np.ndarray) -> Ragged:
    """Return a star for each of (p,) numbers of corners, 200 px wide on the grid of 1/256 px."""
    ends = np.cumsum(corners)
    owner = np.repeat(np.arange(len(corners)), corners)
    number = np.arange(ends[-1]) - (ends - corners)[owner]
    angle = number * (2.0 * np.pi) / corners[owner]
    radius = np.random.default_rng(3).uniform(60.0, 100.0, ends[-1])
    points = np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))
    return Ragged(np.round(points * 256.0) / 256.0, ends, np.arange(1, len(corners) + 1))


def _equal(arrays: Ragged, name: str) -> bool:
    found, expected = (triangulate_many(arrays, device=device) for device in (name, "cpu"))
    return np.array_equal(found.triangles, expected.triangles) and np.array_equal(
        found.starts, expected.starts
    )


def _pace(name: str, many: Ragged, one: Ragged, units: float) -> Pace:
    def on(device: str, arrays: Ragged) -> Callable[[], Triangulations]:
        return lambda: triangulate_many(arrays, device=device)

    once = _least(on(name, one))
    each = max(_least(on(name, many)) - once, 0.0) / units
    return Pace(once, each, _least(on("cpu", many)) / units)


def _least(call: Callable[[], Any]) -> float:
    """Return the least seconds of some calls, after one that loads and compiles."""
    call()
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)
