"""Rasterisers by name; a rasteriser's module is imported on first use."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pkgutil import resolve_name

from harness.errors import NoRasteriserError, UsageError, make_unknown_name_error
from harness.machine.process import allow_user_module
from harness.rasterisers.base import Device, Options, Rasteriser, Triangles
from harness.rasterisers.counters import register_counters

__all__ = [
    "Device",
    "Options",
    "Rasteriser",
    "Triangles",
    "choose_default_rasteriser",
    "find_device",
    "get",
    "names",
]

GROUP = "raster_harness.rasterisers"  # group of third-party entry points

BUILT_IN = {
    "opengl": "harness.rasterisers.opengl:OpenGL",
    "osmesa": "harness.rasterisers.opengl:OSMesa",
    "bounding-box": "harness.rasterisers.compute:BoundingBox",
    "scanline": "harness.rasterisers.compute:Scanline",
    "binning": "harness.rasterisers.reference:Binning",
    "webgpu": "harness.rasterisers.webgpu:WebGPU",
    "pyrender": "harness.rasterisers.pyrender:Pyrender",
    "reference": "harness.rasterisers.reference:Reference",
}


@cache
def _find_plugins() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUP)}


def names() -> list[str]:
    """Return the names of all rasterisers, including third-party ones."""
    return [*BUILT_IN, *sorted(set(_find_plugins()) - set(BUILT_IN))]


def get(name: str) -> type[Rasteriser]:
    """Return a rasteriser class by name, or given as "module:class"; register its counters."""
    if name in BUILT_IN:
        rasteriser = resolve_name(BUILT_IN[name])
    elif name in _find_plugins() or ":" in name:
        plugin = _find_plugins().get(name)
        if plugin is None:
            allow_user_module(name)
        try:
            rasteriser = plugin.load() if plugin else resolve_name(name)
        except Exception as error:
            raise UsageError(
                f"rasteriser '{name}': import failed ({error}); correct or reinstall the module"
            ) from error
    else:
        raise make_unknown_name_error("rasteriser", name, names())
    if not (isinstance(rasteriser, type) and issubclass(rasteriser, Rasteriser)):
        raise UsageError(
            f"rasteriser '{name}' is not a subclass of harness.rasterisers.Rasteriser; derive its "
            "class from Rasteriser"
        )
    register_counters(rasteriser.new_counters)
    return rasteriser


def choose_default_rasteriser() -> str:
    """Return the default rasteriser: opengl, or webgpu if EGL is missing."""
    if not get("opengl").devices() and get("webgpu").devices():
        return "webgpu"
    return "opengl"


def find_device(rasteriser: str, name: str | None = None) -> Device:
    """Return a rasteriser's device called `name`, by default the best; raise if it is missing."""
    kind = get(rasteriser)
    if name is None:
        if devices := kind.devices():
            return devices[0]
        raise NoRasteriserError(f"{rasteriser}: no usable device found; {kind.remedy()}")
    if device := kind.find(name):
        return device
    if kind.is_device_name(name):
        raise NoRasteriserError(f"{rasteriser}: device '{name}' not found; {kind.remedy(name)}")
    raise make_unknown_name_error(
        "device", name, [device.name for device in kind.devices()] or kind.device_names
    )
