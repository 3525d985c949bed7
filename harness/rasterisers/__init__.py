"""Rasterisers by name; a rasteriser's module is imported on first use."""

from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from harness.errors import NoRasteriserError, UsageError, unknown
from harness.machine.user_modules import allow_user_module
from harness.rasterisers.base import (
    Counters,
    Device,
    Drawing,
    Options,
    Rasteriser,
    Sample,
    Triangles,
)
from harness.rasterisers.counters import Counter, register

__all__ = [
    "Counter",
    "Counters",
    "Device",
    "Drawing",
    "Options",
    "Rasteriser",
    "Sample",
    "Triangles",
    "find_device",
    "get",
    "names",
    "usual",
]

GROUP = "raster_harness.rasterisers"

BUILT_IN = {
    "opengl": "harness.rasterisers.opengl:OpenGL",
    "osmesa": "harness.rasterisers.osmesa:OSMesa",
    "bounding-box": "harness.rasterisers.compute:BoundingBox",
    "scanline": "harness.rasterisers.compute:Scanline",
    "binning": "harness.rasterisers.reference:Binning",
    "webgpu": "harness.rasterisers.webgpu:WebGPU",
    "pyrender": "harness.rasterisers.pyrender:Pyrender",
    "reference": "harness.rasterisers.reference:Reference",
}


@cache
def _plugins() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUP)}


def load(reference: str) -> Any:
    """Import and return an attribute given as "module:attribute"."""
    module, _, attribute = reference.partition(":")
    return getattr(import_module(module), attribute)


def names() -> list[str]:
    """Return the names of all rasterisers, third parties' included."""
    return [*BUILT_IN, *sorted(set(_plugins()) - set(BUILT_IN))]


def get(name: str) -> type[Rasteriser]:
    """Return the rasteriser class called `name`, or given as "module:class".

    Raises
    ------
    UsageError
        if the name is unknown, or a third party's rasteriser cannot be loaded
    """
    if name in BUILT_IN:
        rasteriser = load(BUILT_IN[name])
    elif name in _plugins() or ":" in name:
        if name not in _plugins():
            allow_user_module(name)
        try:
            rasteriser = _plugins()[name].load() if name in _plugins() else load(name)
        except Exception as error:
            raise UsageError(f"rasteriser '{name}' cannot be loaded: {error}") from error
    else:
        raise unknown("rasteriser", name, names())
    if not (isinstance(rasteriser, type) and issubclass(rasteriser, Rasteriser)):
        raise UsageError(f"rasteriser '{name}' is not a harness.rasterisers.Rasteriser class")
    register(rasteriser.new_counters)
    return rasteriser


def usual() -> str:
    """Return the default rasteriser: opengl, or webgpu if EGL is missing."""
    if not get("opengl").devices() and get("webgpu").devices():
        return "webgpu"
    return "opengl"


def find_device(rasteriser: str, name: str | None = None) -> Device:
    """Return the device called `name` of a rasteriser, by default its best device.

    Raises
    ------
    UsageError
        if the rasteriser, or any device of that name, is unknown
    NoRasteriserError
        if the device exists by name but does not work on this machine
    """
    kind = get(rasteriser)
    if name is None:
        if devices := kind.devices():
            return devices[0]
        raise NoRasteriserError(f"{rasteriser}: no device works here; {kind.remedy()}")
    if device := kind.find(name):
        return device
    if kind.knows(name):
        raise NoRasteriserError(
            f"{rasteriser}: device '{name}' does not work here; {kind.remedy(name)}"
        )
    raise unknown("device", name, [device.name for device in kind.devices()] or kind.known)
