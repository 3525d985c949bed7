"""Tasks of the workers: opening a device, counting, timing, and lower bounds of quads.

The fork server imports this module, which then loads compiled code once for all workers.
"""

import contextlib
import gc
import os
import signal
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import rasterisers
from harness.frame import Frame, make_bare_frame
from harness.grid import SUBPIXEL
from harness.machine import system
from harness.measuring.timing import (
    EMPTY,
    REFERENCE,
    TimerTest,
    Times,
    select_timer,
    time_together,
)
from harness.rasterisers.base import Counters, Device, Drawing, Options, Rasteriser, Triangles
from harness.rasterisers.reference import count_outline_quads, count_quads
from harness.serving import MARK
from harness.settings import DEFAULT_TRIANGULATORS, TimingSettings
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons, warm_up

Candidate = tuple[Frame, Triangles, Options]  # frame, triangles (m, 3), and options of drawing

SELF_TEST_PX = 1024
SELF_TEST_LAYERS = 256
SELF_TEST_S = 10e-3
"""Viewport, maximum number of viewport-filling layers, and minimum seconds of the draw by which
timers are compared."""


EXACT_QUADS = parse("optimal:exact-quads")

MAX_SEARCH_S = 2.0  # time budget per frame for minimum quad counts, by `estimate_search_seconds`

ROW_S = 6e-9
"""Seconds to count the quads of a triangle, per row of pixels (measured: 2 to 6 ns). The dynamic
program over n vertices counts n^3 / 6 triangles, on average half as high as the polygon."""

HOLES_S = 2e-7
"""Seconds to solve a polygon with holes by a linear program, divided by the cube of the vertex
count (measured: 10 to 450 ns; the largest polygons have the largest quotients)."""


@dataclass(frozen=True)
class OpenedDevice:
    """Details of an open device, as reported by the driver; timer : None if draws are not timed."""

    details: dict[str, Any]
    timer: TimerTest | None
    draws_indexed: bool


Supported = tuple[tuple[Options, ...], tuple[Device, ...], tuple[str, ...]]
"""For a plan and a rasteriser: the supported options; the requested devices that are supported, or
if there are none, the best device; and the names of these requested devices."""


def find_supported(name: str, options: Sequence[Options], devices: Sequence[str]) -> Supported:
    """Return the options and devices of a plan that a rasteriser supports, as `Supported`."""
    kind = rasterisers.get(name)
    names = tuple(device for device in devices if kind.is_device_name(device))
    available = tuple(rasterisers.find_device(name, device) for device in names or (None,))
    return tuple(filter(kind.supports, options)), available, names


_rasterisers: dict[tuple[str, str], Rasteriser] = {}


def open_device(name: str, device: Device) -> OpenedDevice:
    """Open `device` with the rasteriser `name`, and select the timer if draws can be timed."""
    rasteriser = _get_rasteriser(name, device)
    timer = select_device_timer(rasteriser) if rasteriser.timed else None
    return OpenedDevice(dict(rasteriser.device.details), timer, rasteriser.draws_indexed)


def draw_and_count(
    name: str, device: Device, frame: Frame, triangles: Triangles, options: Options
) -> Counters:
    """Draw `triangles` (m, 3) on the device, and return the rasteriser's exact counters."""
    return _get_rasteriser(name, device).draw_and_count(frame, triangles, options)


def time_group(
    name: str,
    device: Device,
    candidates: Mapping[str, Candidate],
    settings: TimingSettings,
    test: TimerTest,
    seed: int,
) -> dict[str, Times]:
    """Time the candidates, whose frames have the same size, in the same rounds.

    The result also has the times of EMPTY (no triangle) and REFERENCE (a triangle that covers half
    of the viewport), drawn with the first candidate's options.
    """
    rasteriser = _get_rasteriser(name, device)
    frame, _, options = next(iter(candidates.values()))
    far_corner = frame.width * SUBPIXEL
    corner = make_bare_frame(
        frame.width, np.array([[0, 0], [far_corner, 0], [0, far_corner]], np.int32)
    )
    drawn: dict[str, Candidate] = {
        EMPTY: (frame, np.empty((0, 3), np.int32), options),
        REFERENCE: (corner, np.array([[0, 1, 2]], np.int32), options),
        **candidates,
    }
    with contextlib.ExitStack() as stack:

        def prepare(order: Sequence[str]) -> dict[str, Drawing]:
            """Free all drawings and prepare them again in `order`, with a new memory layout."""
            stack.close()
            prepared = {}
            for name in order:
                prepared[name] = rasteriser.prepare(*drawn[name])
                stack.enter_context(prepared[name])
            return {name: prepared[name] for name in drawn}

        drawings = prepare(list(drawn))
        return time_together(drawings, settings, test, seed=seed, renew=prepare)


def _get_rasteriser(name: str, device: Device) -> Rasteriser:
    """Return this process's rasteriser `name` on `device`, opened on the first call."""
    key = (name, device.name)
    if key not in _rasterisers:
        _rasterisers[key] = rasterisers.get(name)(device)
    return _rasterisers[key]


def select_device_timer(rasteriser: Rasteriser) -> TimerTest:
    """Select the timer of a device by timing a draw of many layers that fill the viewport."""
    far_corner = SELF_TEST_PX * SUBPIXEL
    square = np.array(
        [[0, 0], [far_corner, 0], [far_corner, far_corner], [0, far_corner]], np.int32
    )
    frame = make_bare_frame(SELF_TEST_PX, square)
    layer = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    layers = 1
    while True:
        triangles = np.tile(layer, (layers, 1))
        with rasteriser.prepare(frame, triangles, Options()) as drawing:
            drawing.sample(1)  # the first draw compiles and allocates
            if layers >= SELF_TEST_LAYERS or drawing.sample(1).wall >= SELF_TEST_S:
                return select_timer(drawing, software=rasteriser.device.software)
        layers *= 4


def compute_outline_bounds(
    frame: Frame, parts: Sequence[NDArray[np.int32] | None]
) -> NDArray[np.int64]:
    """Return the quads that each polygon's outline covers, (p,), or -1 if unknown.

    A model's triangles outside its polygons (`is_loose`) have no outline, so their bound is the
    quads that they shade. With a depth test all are -1, because hidden quads are not shaded.
    """
    if frame.viewing is None:
        return count_outline_quads(frame, parts)
    if frame.viewing.depths is not None:
        return np.full(len(parts), -1)
    is_loose = frame.viewing.source == len(frame.viewing.polygon_triangles)
    return np.where(is_loose, count_quads(frame, parts), count_outline_quads(frame, parts))


def estimate_search_seconds(frame: Frame) -> NDArray[np.float64]:
    """Return the estimated seconds to find each polygon's minimum quads, (p,); may be inf."""
    cubes = frame.grid.vertex_counts.astype(np.float64) ** 3
    low, high = frame.polygons.bounds()
    simple = cubes / 6 * (1 + (high - low)[:, 1] / 2) * ROW_S
    holes = frame.grid.ring_counts > 1
    seconds: NDArray[np.float64] = np.where(holes, np.maximum(simple, cubes * HOLES_S), simple)
    if frame.scissor is None:
        return seconds
    # A triangulation with minimum quads for a polygon need not be minimal for its visible part.
    x, y, width, height = frame.scissor
    inside = (low >= (x, y)) & (high <= (x + width, y + height))
    return np.where(inside.all(axis=1), seconds, np.inf)


def compute_min_quads(frame: Frame, database: Path | None) -> NDArray[np.int64]:
    """Return the proven minimum quads of each polygon, (p,), -1 if unknown.

    Polygons are solved in order of the estimated time, up to `MAX_SEARCH_S`. Views of a model are
    not solved: a face seen at an angle is not a valid polygon on the grid.
    """
    unknown = np.full(len(frame.polygons), -1)
    if frame.viewing is not None:
        return unknown
    seconds = estimate_search_seconds(frame)
    order = np.argsort(seconds, kind="stable")
    solvable = np.sort(order[np.cumsum(seconds[order]) <= MAX_SEARCH_S])
    if not len(solvable):
        return unknown
    warm_up(EXACT_QUADS)
    result = triangulate_polygons(EXACT_QUADS, frame.polygons.take(solvable), database)
    parts: list[NDArray[np.int32] | None] = [None] * len(unknown)
    gaps = iter(result.gaps)
    for index, part in zip(solvable.tolist(), result.parts, strict=True):
        if part is not None and next(gaps) == 0.0:
            parts[index] = part
    return np.where([part is not None for part in parts], count_quads(frame, parts), unknown)


def prepare_server() -> None:
    """Detach the fork server, in which this runs, from the terminal; load compiled code."""
    # Only the server and its workers need these modules, which import numba.
    from triangulators import many  # noqa: F401 - for the workers
    from triangulators.compute.storing import NotCompiledError, forbid_compiling

    # In a separate process group the server does not get the terminal's signals; it ends with the
    # command, which gets them.
    system.start_process_group()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # Processes that a task starts in a new session become the server's children when the worker
    # ends.
    system.become_subreaper()
    warnings.filterwarnings("ignore", message="forkserver: waitpid returned unexpected pid")
    # On a new machine nothing is compiled yet.
    with contextlib.suppress(NotCompiledError), forbid_compiling():
        for name in DEFAULT_TRIANGULATORS:
            warm_up(parse(name))
    # Exclude shared objects from the workers' garbage collection, which would copy their pages.
    gc.freeze()


if os.environ.pop(MARK, None):
    prepare_server()
