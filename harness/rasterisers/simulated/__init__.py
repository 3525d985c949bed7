"""GPUs' rasterisers whose design is published, simulated cycle by cycle: their time is a count.

A device is written as its design with the parameters that are to differ from the published ones:
`skybox`, `skybox:tile=16,shader=2`.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar

from harness.errors import UsageError, unknown
from harness.frame import Frame
from harness.rasterisers import load
from harness.rasterisers.base import Counters, Device, Options, Rasteriser, Triangles
from harness.rasterisers.reference import SHADED
from harness.rasterisers.simulated.building import Sources
from scenes.spec import parsed

DESIGNS = {
    "skybox": "harness.rasterisers.simulated.skybox:Skybox",
    "attila": "harness.rasterisers.simulated.attila:Attila",
}


class Design(ABC):
    """One design, built with its parameters.

    Class attributes: `name`; `parameters`, a frozen dataclass of what its designer would turn, each
    with the value it has as published; `choices`, the values of those that have but a few;
    `counters`, the names that `count` returns beside `counters.CYCLES`; `cuts`, as a rasteriser's;
    `sources`, what it is built from.
    """

    name: ClassVar[str]
    parameters: ClassVar[type[Any]]
    choices: ClassVar[Mapping[str, tuple[Any, ...]]] = {}
    counters: ClassVar[tuple[str, ...]]
    cuts: ClassVar[bool] = False
    sources: ClassVar[Sources]

    details: dict[str, Any]
    """What it was built from and with, JSON-ready."""

    @abstractmethod
    def __init__(self, parameters: Any) -> None:
        """Build it, or find it built; raises NoRasteriser where sources or tools lack."""

    @abstractmethod
    def count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        """Draw `triangles` (m, 3) and return `counters`, and `CYCLES`, () of all draws together."""


def design(name: str) -> type[Design]:
    """Return the design called `name`."""
    found: type[Design] = load(DESIGNS[name])
    return found


def read(name: str) -> tuple[type[Design], Any]:
    """Return the design that a device's name names, and its parameters.

    Raises
    ------
    UsageError
        for a name or a value of a parameter that there is not
    """
    base, given = parsed(name)
    found = design(base)
    published = found.parameters()
    kinds = {each.name: type(getattr(published, each.name)) for each in fields(published)}
    values = {}
    for name, text in given.items():
        if name not in kinds:
            raise unknown(f"parameter of {base}", name, kinds)
        try:
            values[name] = kinds[name](text)
        except ValueError:
            raise UsageError(f"{base}: {name}={text} is not a number") from None
        known = found.choices.get(name)
        if known and values[name] not in known:
            raise UsageError(f"{base}: {name}={text}: choose one of {', '.join(map(str, known))}")
    return found, found.parameters(**values)


class Simulated(Rasteriser):
    """Runs a published design cycle by cycle."""

    name = "simulated"
    # what every design counts; each has more of its own
    counters: ClassVar[tuple[str, ...]] = ("cycles", *SHADED)
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
        return [
            Device(name, software=True) for name in DESIGNS if not design(name).sources.problem()
        ]

    @classmethod
    def find(cls, name: str) -> Device | None:
        """Return the device of that name, parameters in order and only those that differ."""
        if not cls.knows(name):
            return None
        found, parameters = read(name)
        changed = [
            f"{each.name}={value:g}" if isinstance(value, float) else f"{each.name}={value}"
            for each in fields(parameters)
            if (value := getattr(parameters, each.name)) != each.default
        ]
        written = found.name + ":" * bool(changed) + ",".join(changed)
        return None if found.sources.problem() else Device(written, software=True)

    @classmethod
    def remedy(cls, name: str | None = None) -> str:
        """What lacks."""
        wanted = [parsed(name)[0]] if name else list(DESIGNS)
        return "; ".join(f"{each}: {design(each).sources.problem()}" for each in wanted)

    def __init__(self, device: Device) -> None:
        found, parameters = read(device.name)
        self._design = found(parameters)
        self.device = Device(device.name, software=True, details=self._design.details)

    def _count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        if frame.scissor is not None and not self._design.cuts:
            raise UsageError(f"{self._design.name} cannot cut at a tile's edge")
        return self._design.count(frame, triangles, options)
