"""A rasteriser with scripted costs, so that scheduling is tested without waiting.

Its time is a clock of its own, which drawing alone moves; its counters follow from the triangles.
"""

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
    """Seconds that pass only when something is drawn; `speed` may change on the way."""

    now: float = 0.0
    speed: Callable[[float], float] = lambda now: 1.0

    def __call__(self) -> float:
        return self.now

    def spend(self, seconds: float) -> float:
        taken = seconds * self.speed(self.now)
        self.now += taken
        return taken


@dataclass
class ScriptedDrawing:
    """Takes `cost` seconds a draw, give or take `noise` of it; notes every call in `log`."""

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
    """Costs a microsecond a triangle, and waits so long, or there would be a million rounds."""

    def __init__(self, triangles: Triangles, speed: float) -> None:
        self._cost = 1e-6 * (1 + len(triangles)) * speed

    def sample(self, repeats: int) -> Sample:
        time.sleep(self._cost * repeats)
        return Sample(wall=self._cost * repeats)

    def close(self) -> None:
        pass


class MockRasteriser(Rasteriser):
    """Counts twice a triangle's area as fragments, so any full triangulation gives the same.

    What it does wrong is chosen by the environment variable MOCK_FAULT.
    """

    name = "mock"
    known = ("scripted",)
    runs = 0
    """Of this process, as `begin_run` is told of them."""
    counters = ("fragments", "quads", "helper_lanes")

    @classmethod
    def begin_run(cls) -> None:
        """Let what is measured from now on differ a little from what was: no two runs are equal."""
        cls.runs += 1

    @classmethod
    def devices(cls) -> list[Device]:
        return [Device("scripted", software=True)]

    def __init__(self, device: Device) -> None:
        self.device = device

    def _count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        _fault("count", len(triangles))
        corners = frame.points[triangles].astype(np.int64)
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        doubled = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        polygons = len(frame.grid)
        owner = frame.owner(triangles)
        fragments = np.zeros(polygons, np.int64)
        np.add.at(fragments, owner, doubled)
        quads = fragments + np.bincount(owner, minlength=polygons)
        return {"fragments": fragments, "quads": quads, "helper_lanes": 4 * quads - fragments}

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        _fault("time", len(triangles))
        number = (7919 * os.getpid() + 613 * self.runs) % 9973
        return MockDrawing(triangles, 1.0 + 5e-7 * number)


def _fault(stage: str, triangles: int) -> None:
    """Fail as told: MOCK_FAULT is "<stage>:<kind>", for an odd number of triangles (but one)."""
    wanted, _, kind = os.environ.get("MOCK_FAULT", "").partition(":")
    if wanted != stage or triangles % 2 == 0 or triangles == 1:
        return
    if kind == "crash":
        os.abort()
    if kind == "hang":
        time.sleep(3600)
    raise RuntimeError("scripted failure")
