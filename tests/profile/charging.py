"""A rasteriser whose times are known costs times the exact counters, without waiting."""

from typing import ClassVar

from harness.frame import Frame
from harness.grid import SUBPIXEL
from harness.profile.cost_terms import count_draw
from harness.profile.placing import Draw
from harness.rasterisers.base import Device, Drawing, Options, Sample, Triangles
from tests.mock import MockRasteriser

COSTS = {
    "draw": 2e-5,
    "triangles": 5e-8,
    "half_perimeter": 7e-9,
    "blocks": 3e-8,
    "work": 3e-10,
}
"""Seconds per unit of a counter; other counters cost nothing."""

STAGE_COSTS = {
    "draw": 1e-9,
    "transformed_vertices": 6e-10,
    "tile_pairs": 1.9e-9,
    "fragments": 7e-11,
    "helper_lanes": 6e-11,
    "work": 1.1e-11,
}
"""Seconds per unit, for a device whose draws take the time of the slowest stage."""


class ChargedDrawing(Drawing):
    def __init__(self, seconds: float) -> None:
        self.seconds = seconds

    def sample(self, repeats: int) -> Sample:
        return Sample(wall=self.seconds * repeats)

    def close(self) -> None:
        pass


class Charger(MockRasteriser):
    """A rasteriser whose draws take the seconds of `COSTS`; the device is named scripted."""

    name = "charging"
    shades_fragments = True
    counters_by_draw: ClassVar[dict[bytes, dict[str, int]]] = {}

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        if len(triangles) == 0:
            return ChargedDrawing(COSTS["draw"])
        key = triangles.tobytes() + frame.points.tobytes() + bytes(options.work)
        if key not in self.counters_by_draw:
            draw = Draw("", "", "", frame, triangles, options.work)
            self.counters_by_draw[key] = {**count_draw(draw), "draw": 1}
        counts = self.counters_by_draw[key]
        counts = {**counts, "half_perimeter": counts["half_perimeter"] / SUBPIXEL}
        return ChargedDrawing(sum(cost * counts[name] for name, cost in COSTS.items()))


class CoarseCharger(Charger):
    """A device with a grid of 1/16 px, which requires vertices on that grid."""

    @classmethod
    def devices(cls) -> list[Device]:
        return [Device("coarse", software=True, details={"step": 16})]

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        if options.work or len(triangles) > 2:  # the test of the timer is not on the grid
            assert not (frame.points % 16).any()
        return super()._prepare(frame, triangles, options)


class DriftingCharger(Charger):
    drawings = 0

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        drawing = super()._prepare(frame, triangles, options)
        type(self).drawings += 1
        assert isinstance(drawing, ChargedDrawing)
        return ChargedDrawing(drawing.seconds * (1.0 + self.drawings / 2000.0))


class FailingCharger(Charger):
    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        if options.work:
            raise RuntimeError("the device is gone")
        return super()._prepare(frame, triangles, options)


class MissingCharger(Charger):
    @classmethod
    def devices(cls) -> list[Device]:
        return []
