"""Views of a model on every device: equal to the reference, each view a call of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.frame import Frame, frame_of, view_of
from harness.measuring import tasks
from harness.measuring.worker import Worker
from harness.models.seen import read
from harness.rasterisers import Options, get
from harness.rasterisers.agreement import disagreements
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse
from harness.triangulating.seen import in_views, original
from tests.models.test_in_place import plate
from tests.rasterisers.test_tiles import DEVICES

NATIVE = Options()

Call = Callable[..., Any]


@pytest.fixture(scope="module", params=DEVICES, ids="-".join)
def on_device(request: pytest.FixtureRequest) -> Iterator[tuple[str, Call]]:
    """Run a task on a device in a process of its own; skipped where it is not installed."""
    rasteriser, name = request.param
    device = next((each for each in get(rasteriser).devices() if each.name == name), None)
    if device is None:
        pytest.skip(f"{rasteriser} on {name} is not installed")
    with Worker(name, device.environment) as worker:
        yield (
            rasteriser,
            lambda task, *case: worker.call(task, rasteriser, device, *case, timeout_s=120),
        )


@pytest.fixture(scope="session")
def seen(tmp_path_factory) -> tuple[Frame, list[np.ndarray]]:
    """Views of a plate and three triangulations of its faces."""
    path: Path = tmp_path_factory.mktemp("models") / "plate.glb"
    plate().export(path)
    scene = read(str(path), views=4, pixels=128)
    frame = frame_of(scene, view_of(scene))
    assert frame.flat is not None
    parts = [original(frame).parts]
    for name in ("delaunay", "optimal:edge-length"):
        parts.append(in_views(frame, triangulate_polygons(parse(name), frame.flat.polygons)).parts)
    return frame, [frame.join(each) for each in parts]


def test_counters_of_each_piece_equal_the_reference(on_device, seen, reference):
    rasteriser, call = on_device
    frame, triangulations = seen
    lanes = []
    for rows in triangulations:
        exact = reference.count(frame, rows, NATIVE)
        lanes.append(int(exact["helper_lanes"].sum()))
        exact["hits"] = exact["fragments"]
        exact = {name: exact[name] for name in get(rasteriser).counters if name in exact}
        assert len(exact) >= 1
        assert disagreements(frame, call(tasks.count, frame, rows, NATIVE), exact) == []
    assert lanes[2] < lanes[1] < lanes[0]


def test_each_triangulation_covers_the_same(seen, reference):
    frame, triangulations = seen
    covered = [reference.count(frame, rows, NATIVE)["fragments"] for rows in triangulations]
    assert np.array_equal(covered[0], covered[1])
    assert np.array_equal(covered[0], covered[2])


def test_views_are_timed(on_device, seen):
    _, call = on_device
    assert call(_seconds, (seen[0], seen[1][0])) > 0


def _seconds(name: str, device: Any, case: Any) -> float:
    with tasks._opened(name, device).prepare(*case, NATIVE) as drawing:
        return drawing.sample(2).wall
