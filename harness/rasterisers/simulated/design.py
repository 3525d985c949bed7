"""What every simulated design can be asked, and its parameters as they are written."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar

from harness.errors import UsageError, unknown
from harness.frame import Frame
from harness.rasterisers.base import Counters, Image, Options, Triangles
from harness.rasterisers.simulated.building import Lacking


class Design(ABC):
    """One design, built with its parameters.

    Class attributes: `name`; `parameters`, a frozen dataclass of what its designer would turn, each
    with the value it has as published; `choices`, the values of those that have but a few;
    `counters`, the names that `count` returns beside `counters.CYCLES`; `cuts` and `pictured`, as a
    rasteriser's.
    """

    name: ClassVar[str]
    parameters: ClassVar[type[Any]]
    choices: ClassVar[Mapping[str, tuple[Any, ...]]] = {}
    counters: ClassVar[tuple[str, ...]]
    cuts: ClassVar[bool] = False
    pictured: ClassVar[bool] = False

    details: dict[str, Any]
    """What it was built from and with, JSON-ready."""

    @classmethod
    @abstractmethod
    def problem(cls) -> Lacking | None:
        """Say what lacks to simulate it here, or None."""

    @abstractmethod
    def __init__(self, parameters: Any) -> None:
        """Build it, or find it built; raises NoRasteriser where `problem` says something."""

    @abstractmethod
    def count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        """Draw `triangles` (m, 3) and return `counters`, and `CYCLES`, () of all draws together."""

    def image(self, frame: Frame, triangles: Triangles) -> Image:
        """Return what the design draws, (height, width, 4), top row first."""
        raise NotImplementedError


def read_parameters(design: type[Design], given: Mapping[str, str]) -> Any:
    """Return a design's parameters, those `given` as text and the published ones.

    Raises
    ------
    UsageError
        for a name or a value that there is not
    """
    published = design.parameters()
    kinds = {each.name: type(getattr(published, each.name)) for each in fields(published)}
    values = {}
    for name, text in given.items():
        if name not in kinds:
            raise unknown(f"parameter of {design.name}", name, kinds)
        try:
            values[name] = kinds[name](text)
        except ValueError:
            raise UsageError(f"{design.name}: {name}={text} is not a number") from None
        known = design.choices.get(name)
        if known and values[name] not in known:
            raise UsageError(
                f"{design.name}: {name}={text}: choose one of {', '.join(map(str, known))}"
            )
    return design.parameters(**values)


def written(design: type[Design], parameters: Any) -> str:
    """Return the device's name: the design, and parameters that are not as published."""
    changed = [
        f"{each.name}={value:g}" if isinstance(value, float) else f"{each.name}={value}"
        for each in fields(parameters)
        if (value := getattr(parameters, each.name)) != each.default
    ]
    return design.name + ":" * bool(changed) + ",".join(changed)
