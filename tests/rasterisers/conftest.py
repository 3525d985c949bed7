"""Hand-made frames, and the devices on which the rasterisers are tested."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from harness.errors import NoRasteriserError
from harness.frame import Frame, make_bare_frame
from harness.measuring import tasks
from harness.rasterisers import Device, Options, Rasteriser, find_device, get
from harness.rasterisers.base import Counters, order_submission, sum_per_polygon
from harness.rasterisers.reference import find_disagreements
from harness.worker import Worker

Call = Callable[..., Any]


DEVICES = [
    *(("opengl", "llvmpipe"), ("opengl", "zink"), ("osmesa", "osmesa")),
    *(("bounding-box", "llvmpipe"), ("bounding-box", "zink"), ("scanline", "llvmpipe")),
    *(("webgpu", "llvmpipe"), ("webgpu", "lavapipe")),
]


@contextmanager
def open_on(rasteriser: str, name: str) -> Iterator[Call]:
    """Run tasks on a device in a process; if it is missing, check the error and skip the test."""
    device = get(rasteriser).find(name)
    if device is None:
        command = r"run: (apt-get|python -m pip) install"
        with pytest.raises(NoRasteriserError, match=command) as error:
            find_device(rasteriser, name)
        pytest.skip(str(error.value))
    with Worker(name, device.environment) as worker:
        yield lambda task, *case: worker.call(task, rasteriser, device, *case, timeout_s=120)


@pytest.fixture(scope="module", params=DEVICES, ids="-".join)
def on_device(request: pytest.FixtureRequest) -> Iterator[tuple[str, Call]]:
    """Return a rasteriser's name, and a function that runs a task on its device."""
    with open_on(*request.param) as call:
        yield request.param[0], call


def require_reference_counts(on_device: tuple[str, Call], reference: Rasteriser, *case: Any):
    """Check each counter of the device for every polygon; return the reference's counters."""
    rasteriser, call = on_device
    frame, triangles, options = (*case, Options())[:3]
    drawn = call(tasks.draw_and_count, frame, triangles, options)
    exact = reference.draw_and_count(frame, triangles, options)
    exact["hits"] = exact["fragments"]
    exact = {name: exact[name] for name in get(rasteriser).counters if name in exact}
    assert exact
    assert drawn.keys() >= exact.keys()
    assert find_disagreements(frame, drawn, exact) == []
    if "samples_passed" in drawn:
        assert drawn["samples_passed"] == exact["fragments"].sum()
        require_covering_triangles(call, frame, triangles, replace(options, samples=4))
    return exact


def require_covering_triangles(call: Call, *case: Any) -> None:
    """Check the covering triangles of polygons against the fragments of each triangle."""
    counted, expected = call(_count_covering, *case)
    assert counted.tolist() == expected.tolist()


def _count_covering(name: str, device: Device, *case: Any) -> tuple[np.ndarray, np.ndarray]:
    """Count covering triangles in the worker: per polygon, and with each triangle as a polygon."""
    opened = tasks._get_rasteriser(name, device)
    counted = opened.draw_and_count(*case)["covering_triangles"]
    frame, triangles, options = case
    rows = order_submission(frame, triangles, options)
    single = make_bare_frame(frame.width, frame.points[rows].reshape(-1, 2), 3)
    tiles = None if frame.tiles is None else np.searchsorted(frame.find_owners(rows), frame.tiles)
    viewing = frame.viewing
    if viewing is not None and viewing.depths is not None:
        viewing = replace(viewing, depths=viewing.depths[rows.ravel()])
    single = replace(single, scissor=frame.scissor, tiles=tiles, viewing=viewing)
    separate = np.arange(rows.size, dtype=np.int32).reshape(-1, 3)
    fragments = opened._draw_and_count(single, separate, options)["fragments"]
    return counted, sum_per_polygon(frame, rows, (fragments > 0).astype(np.int64))


def find_errors(reference: Rasteriser, drawn: Counters, *case: Any) -> list[str]:
    """Return the differences of a drawing's counters from those of the reference."""
    frame, triangles, options = (*case, Options())[:3]
    return find_disagreements(frame, drawn, reference.draw_and_count(frame, triangles, options))


def time_draws(name: str, device: Device, case: Any) -> float:
    """Draw three times, inside the worker, and return the seconds."""
    with tasks._get_rasteriser(name, device).prepare(*case, Options()) as drawing:
        return drawing.sample(3).wall


def loose_triangles(points: np.ndarray, size: int) -> tuple[Frame, np.ndarray]:
    """Make a frame in which each triangle, three rows of `points` in 1/256 px, is a polygon."""
    points = np.asarray(points, np.int32).reshape(-1, 2)
    return make_bare_frame(size, points, 3), np.arange(len(points), dtype=np.int32).reshape(-1, 3)


def random_triangles(seed: int, size: int, number: int, grid: int) -> tuple[Frame, np.ndarray]:
    """Return triangles with vertices on multiples of `grid`/256 px; 128 includes pixel centres."""
    rng = np.random.default_rng(seed)
    reach = np.array([4, 16, size // 4, size])[rng.integers(0, 4, number)]
    low = rng.integers(1, np.maximum(size - 1 - reach, 2)[:, None], (number, 2))
    steps = rng.integers(0, reach[:, None, None] * 256 // grid + 1, (number, 3, 2))
    corners = low[:, None] * 256 + steps * grid
    return loose_triangles(np.clip(corners, 256, (size - 1) * 256), size)


@pytest.fixture(scope="session")
def reference() -> Rasteriser:
    return get("reference")(find_device("reference"))


@pytest.fixture(scope="session")
def _open_rasterisers() -> dict[str, Rasteriser]:
    """Return the rasterisers that are open in this process, by name."""
    return {}


@pytest.fixture(scope="session")
def opened(_open_rasterisers: dict[str, Rasteriser]) -> Iterator[Callable[[str], Rasteriser]]:
    """Return a function that opens a rasteriser on llvmpipe in this process, once."""
    device = find_device("opengl", "llvmpipe")

    def open_(name: str) -> Rasteriser:
        if name not in _open_rasterisers:
            _open_rasterisers[name] = get(name)(device)
        return _open_rasterisers[name]

    with pytest.MonkeyPatch.context() as patch:
        for key, value in device.environment.items():
            patch.setenv(key, value)
        yield open_
        while _open_rasterisers:
            _open_rasterisers.popitem()[1].close()


@pytest.fixture(autouse=True)
def _no_error_in_opengl(_open_rasterisers: dict[str, Rasteriser]) -> Iterator[None]:
    """Check that no OpenGL error is pending before or after a test, in any context."""
    _check_errors(_open_rasterisers)
    yield
    _check_errors(_open_rasterisers)


def _check_errors(rasterisers: dict[str, Rasteriser]) -> None:
    for name, rasteriser in rasterisers.items():
        rasteriser.context.activate()
        assert rasteriser.ctx.error == "GL_NO_ERROR", name


@pytest.fixture
def llvmpipe(opened: Callable[[str], Rasteriser]) -> Rasteriser:
    return opened("opengl")
