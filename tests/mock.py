"""A rasteriser with scripted costs, to test without waiting: only drawing advances its clock."""

import os
import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from harness.frame import Frame
from harness.rasterisers.base import (
    Counters,
    Device,
    Drawing,
    Options,
    Rasteriser,
    Sample,
    Triangles,
)


@dataclass
class Clock:
    """A clock that only drawing advances; `speed` is a factor that depends on the time."""

    now: float = 0.0
    speed: Callable[[float], float] = lambda now: 1.0

    def __call__(self) -> float:
        return self.now

    def spend(self, seconds: float) -> float:
        duration = seconds * self.speed(self.now)
        self.now += duration
        return duration


@dataclass
class ScriptedDrawing:
    """Takes `cost` seconds per draw with relative `noise`; appends every call to `log`."""

    name: str
    cost: float
    clock: Clock
    noise: float = 0.0
    log: list[str] = field(default_factory=list)
    seed: int = 0

    def __post_init__(self) -> None:
        self._random = random.Random(f"{self.name}{self.seed}")

    def sample(self, repeats: int) -> Sample:
        self.log.append(self.name)
        factor = max(0.01, self._random.gauss(1.0, self.noise))
        return Sample(wall=self.clock.spend(self.cost * repeats * factor))


class MockDrawing(Drawing):
    """Takes and waits a microsecond per triangle; without the wait there would be 10^6 rounds."""

    def __init__(self, triangles: Triangles, speed: float) -> None:
        self._cost = 1e-6 * (1 + len(triangles)) * speed

    def sample(self, repeats: int) -> Sample:
        time.sleep(self._cost * repeats)
        return Sample(wall=self._cost * repeats)

    def close(self) -> None:
        pass


class MockRasteriser(Rasteriser):
    """Counts twice the area as fragments; the variable MOCK_FAULT selects a fault."""

    name = "mock"
    device_names = ("scripted",)
    runs = 0
    """Number of runs in this process, counted by `begin_run`."""
    counters = ("fragments", "quads", "helper_lanes")

    @classmethod
    def begin_run(cls) -> None:
        """Make the times of this run differ slightly from those of earlier runs."""
        cls.runs += 1

    @classmethod
    def devices(cls) -> list[Device]:
        return [Device("scripted", software=True)]

    def __init__(self, device: Device) -> None:
        self.device = device

    def _draw_and_count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        _raise_fault("count", len(triangles))
        corners = frame.points[triangles].astype(np.int64)
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        double_areas = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        polygons = len(frame.grid)
        owner = frame.find_owners(triangles)
        fragments = np.zeros(polygons, np.int64)
        np.add.at(fragments, owner, double_areas)
        quads = fragments + np.bincount(owner, minlength=polygons)
        return {"fragments": fragments, "quads": quads, "helper_lanes": 4 * quads - fragments}

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        _raise_fault("time", len(triangles))
        number = (7919 * os.getpid() + 613 * self.runs) % 9973
        return MockDrawing(triangles, 1.0 + 5e-7 * number)


def _raise_fault(stage: str, triangles: int) -> None:
    """Fail if MOCK_FAULT is "<stage>:<kind>" and the number of triangles is odd, but not 1."""
    fault_stage, _, kind = os.environ.get("MOCK_FAULT", "").partition(":")
    if fault_stage != stage or triangles % 2 == 0 or triangles == 1:
        return
    if kind == "crash":
        os.abort()
    if kind == "hang":
        time.sleep(3600)
    raise RuntimeError("scripted failure")
