"""The rasteriser `simulated`: a device is a design, and its time a count of cycles.

A device is written as its design with the parameters that are to differ from the published ones:
`skybox`, `skybox:tile=16,shader=2`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, ClassVar

from harness.errors import UsageError
from harness.frame import Frame
from harness.rasterisers.base import Counters, Device, Image, Options, Rasteriser, Triangles
from harness.rasterisers.simulated.design import Design, read_parameters, written
from scenes.spec import parsed

DESIGNS = {
    "skybox": "harness.rasterisers.simulated.skybox.skybox:Skybox",
    "attila": "harness.rasterisers.simulated.attila.attila:Attila",
}


def design(name: str) -> type[Design]:
    """Return the design called `name`."""
    module, _, attribute = DESIGNS[name].partition(":")
    found: type[Design] = getattr(import_module(module), attribute)
    return found


def read(name: str) -> tuple[type[Design], Any]:
    """Return the design that a device's name names, and its parameters."""
    base, given = parsed(name)
    found = design(base)
    return found, read_parameters(found, given)


class Simulated(Rasteriser):
    """Runs a published design cycle by cycle."""

    name = "simulated"
    # what every design counts; each has more of its own
    counters: ClassVar[tuple[str, ...]] = (
        *("cycles", "fragments", "quads", "helper_lanes", "partial_quads"),
    )
    lacking = "one sample a pixel and no fragment work"
    timed = False
    cuts = True
    known: ClassVar[tuple[str, ...]] = tuple(DESIGNS)

    @classmethod
    def knows(cls, name: str) -> bool:
        """Whether `name` is a design, with parameters that it has.

        Raises
        ------
        UsageError
            for parameters that it has not
        """
        if parsed(name)[0] not in DESIGNS:
            return False
        read(name)
        return True

    @classmethod
    def devices(cls) -> list[Device]:
        """The designs that can be simulated here, as they were published."""
        return [Device(name, software=True) for name in DESIGNS if not design(name).problem()]

    @classmethod
    def find(cls, name: str) -> Device | None:
        """Return the device of that name, parameters in order and only those that differ."""
        if not cls.knows(name):
            return None
        found, parameters = read(name)
        return None if found.problem() else Device(written(found, parameters), software=True)

    @classmethod
    def remedy(cls, name: str | None = None) -> str:
        """What lacks."""
        wanted = [parsed(name)[0]] if name else list(DESIGNS)
        return "; ".join(f"{each}: {design(each).problem()}" for each in wanted)

    def __init__(self, device: Device) -> None:
        found, parameters = read(device.name)
        self._design = found(parameters)
        self.device = Device(device.name, software=True, details=self._design.details)

    def _count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        if frame.scissor is not None and not self._design.cuts:
            raise UsageError(f"{self._design.name} cannot cut at a tile's edge")
        return self._design.count(frame, triangles, options)

    def image(self, frame: Frame, triangles: Triangles, options: Options) -> Image:
        """Return the picture, (height, width, 4) RGBA, top row first; see `Reference.image`."""
        if not self._design.pictured:
            raise UsageError(f"{self._design.name} has no picture")
        return self._design.image(frame, self._ready(frame, triangles, options))
