"""A rasteriser that charges known costs for what the reference counts, and waits for nothing."""

from typing import ClassVar

from harness.frame import Frame
from harness.grid import SUBPIXEL
from harness.profile.counted import counters
from harness.profile.design import Draw
from harness.rasterisers.base import Device, Drawing, Options, Sample, Triangles
from tests.mock import MockRasteriser

COSTS = {
    "draw": 2e-5,
    "triangles": 5e-8,
    "half_perimeter": 7e-9,
    "blocks": 3e-8,
    "work": 3e-10,
}
"""Seconds for each; all else costs nothing."""


class Charged(Drawing):
    def __init__(self, seconds: float) -> None:
        self.seconds = seconds

    def sample(self, repeats: int) -> Sample:
        return Sample(wall=self.seconds * repeats)

    def close(self) -> None:
        pass


class Charging(MockRasteriser):
    """Its device is called scripted."""

    name = "charging"
    shades = True
    known_costs: ClassVar[dict[bytes, dict[str, int]]] = {}

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        if len(triangles) == 0:
            return Charged(COSTS["draw"])
        key = triangles.tobytes() + frame.points.tobytes() + bytes(options.work)
        if key not in self.known_costs:
            draw = Draw("", "", "", frame, triangles, options.work)
            self.known_costs[key] = {**counters(draw), "draw": 1}
        found = self.known_costs[key]
        seconds = sum(
            cost * found[name] for name, cost in COSTS.items() if name != "half_perimeter"
        )
        return Charged(seconds + COSTS["half_perimeter"] * found["half_perimeter"] / SUBPIXEL)


class Coarse(Charging):
    """Its grid is 1/16 px: what it is given lies on that."""

    @classmethod
    def devices(cls) -> list[Device]:
        return [Device("coarse", software=True, details={"step": 16})]

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        if options.work or len(triangles) > 2:  # the test of its timer draws what it likes
            assert not (frame.points % 16).any()
        return super()._prepare(frame, triangles, options)


class Drifting(Charging):
    """It becomes twice as slow while it is measured."""

    drawn = 0

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        made = super()._prepare(frame, triangles, options)
        type(self).drawn += 1
        assert isinstance(made, Charged)
        return Charged(made.seconds * (1.0 + self.drawn / 2000.0))


class Failing(Charging):
    """It fails under a draw of the design."""

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        if options.work:
            raise RuntimeError("the device is gone")
        return super()._prepare(frame, triangles, options)


class Nowhere(Charging):
    """It works on no machine."""

    @classmethod
    def devices(cls) -> list[Device]:
        return []
