"""The self-test of a device: are its results the CPU's, and is it faster?"""

import time
from collections.abc import Callable

import numpy as np

from triangulators.batch.ragged import Ragged
from triangulators.batch.triangulate_many import triangulate_many
from triangulators.devices import CPU, check_name
from triangulators.errors import UnknownName
from triangulators.gpu.engine import describe
from triangulators.gpu.known_devices import Measured, Pace, recall, remember

COMPARED = 60
FIRST_FOOTPRINTS, MOST_FOOTPRINTS = 2_000, 128_000
LARGE_CORNERS, FIRST_LARGE, MOST_LARGE = 256, 2, 128
ENOUGH_S = 0.05
"""A batch that takes the device that long is large enough to tell its pace."""

ROUNDS = 3


def measure_device(name: str, *, again: bool = False) -> Measured:
    """Return what a device is worth on this machine, measured once and then remembered.

    From then on `triangulate_many` uses it unasked where it was the faster one. again: measure even
    if it was measured before. Takes some seconds. Raises `UnknownName`, and
    `gpu.context.DeviceFailed` if the device cannot be opened.

        >>> measure_device("abacus")
        Traceback (most recent call last):
        triangulators.errors.UnknownName: unknown device 'abacus' (known: gpu0, gpu1, llvmpipe, cpu)
    """
    check_name(name)
    if name == CPU:
        raise UnknownName(f"{CPU!r} is what devices are measured against")
    renderer, version = describe(name)
    known = recall().get(name)
    if known is not None and not again and (known.renderer, known.version) == (renderer, version):
        return known
    random = np.random.default_rng(1)
    equal = _equal(stars(random.integers(4, 140, COMPARED)), name)

    def footprints(count: int) -> Ragged:
        return stars(random.integers(4, 25, count))

    def rings(count: int) -> Ragged:
        return stars(np.full(count, LARGE_CORNERS))

    small = _pace(name, footprints, 1.0, FIRST_FOOTPRINTS, MOST_FOOTPRINTS)
    large = _pace(name, rings, LARGE_CORNERS**3 / 6.0, FIRST_LARGE, MOST_LARGE)
    found = Measured(renderer, version, equal, small, large)
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
    found, expected = (triangulate_many(arrays, device=device) for device in (name, CPU))
    return np.array_equal(found.triangles, expected.triangles) and np.array_equal(
        found.starts, expected.starts
    )


def _pace(name: str, make: Callable[[int], Ragged], units: float, count: int, most: int) -> Pace:
    """Measure batches of `count` to `most` polygons that have so many `units` each."""
    once = _least(name, make(1))
    while True:
        arrays = make(count)
        whole = _least(name, arrays)
        if whole >= ENOUGH_S or count >= most:
            break
        count = min(8 * count, most)
    # What is spent once is in both, so that a device is rather not chosen than chosen wrongly.
    per_unit = 1.0 / (count * units)
    return Pace(once, whole * per_unit, _least(CPU, arrays) * per_unit)


def _least(device: str, arrays: Ragged) -> float:
    """Return the least seconds of some calls, after one that loads and compiles."""
    triangulate_many(arrays, device=device)
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        triangulate_many(arrays, device=device)
        times.append(time.perf_counter() - start)
    return min(times)
