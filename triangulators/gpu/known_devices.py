"""Which device was measured to be faster than the CPU on this machine: a small file.

Nothing is measured here and no device is opened (see `measuring`). What was measured with another
driver, another version of this project or of Numba, or another number of cores does not count.
"""

import json
import os
import platform
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from platformdirs import user_cache_path

MARGIN = 0.8
"""Of the CPU's time: a device that takes more of it is not worth what it disturbs."""

_SCHEMA = 1


class Pace(NamedTuple):
    """Seconds: of a batch whatever its size, of one unit on the device, of one on the CPU.

    Units are polygons for rings of up to 64 corners, n^3 / 6 triples for larger ones.
    """

    once_s: float
    device_s: float
    cpu_s: float

    def gains(self, units: float) -> bool:
        """Whether the device is the faster one for so many units."""
        return self.once_s + units * self.device_s < MARGIN * units * self.cpu_s


class Measured(NamedTuple):
    """What a self-test found of a device; `equal`: whether its results were those of the CPU."""

    renderer: str
    version: str
    equal: bool
    small: Pace
    large: Pace


class Choice(NamedTuple):
    """A device, and for which rings it is the faster one."""

    device: str
    small: bool
    large: bool


def path() -> Path:
    """Return devices.json beside the model database (`RASTER_HARNESS_CACHE`, or the user's)."""
    if given := os.environ.get("RASTER_HARNESS_CACHE"):
        return Path(given).with_name("devices.json")
    return user_cache_path("raster-harness", appauthor=False) / "devices.json"


def recall() -> dict[str, Measured]:
    """Return what was measured here, by device; {} where nothing was, or the file is damaged."""
    place = path()
    try:
        return _read(place, place.stat().st_mtime_ns)
    except OSError:
        return {}


def remember(device: str, found: Measured) -> None:
    """Keep what was measured; where the file cannot be written, say nothing: it is a cache."""
    everything = {**recall(), device: found}
    entries = {name: each._asdict() for name, each in everything.items()}
    place = path()
    fresh = place.with_name(f"{place.name}.{os.getpid()}")
    with suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        fresh.write_text(json.dumps({"schema": _SCHEMA, **facts(), "devices": entries}, indent=1))
        fresh.replace(place)


def choose(small: int, triples: float) -> Choice | None:
    """Return the device that does so many small rings and triples of large ones faster, if any."""
    for name, found in recall().items():
        if found.equal:
            choice = Choice(name, found.small.gains(small), found.large.gains(triples))
            if choice.small or choice.large:
                return choice
    return None


def facts() -> dict[str, Any]:
    """Return what must be as it was for a measurement to count."""
    return {
        "machine": f"{platform.node()} {platform.machine()}",
        "cores": os.cpu_count(),
        "numba": version("numba"),
        "version": _version(),
    }


@lru_cache(maxsize=1)
def _version() -> str:
    try:
        return version("raster-harness")
    except PackageNotFoundError:
        return "not installed"


@lru_cache(maxsize=4)
def _read(place: Path, changed_ns: int) -> dict[str, Measured]:  # noqa: ARG001 - the cache's key
    try:
        content = json.loads(place.read_text())
        if {key: content[key] for key in ("schema", *facts())} != {"schema": _SCHEMA, **facts()}:
            return {}
        return {str(name): _measured(each) for name, each in content["devices"].items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def _measured(entry: dict[str, Any]) -> Measured:
    small, large = (Pace(*map(float, entry[key])) for key in ("small", "large"))
    equal = entry["equal"] is True
    return Measured(str(entry["renderer"]), str(entry["version"]), equal, small, large)
