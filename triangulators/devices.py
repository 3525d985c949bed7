"""What computes: names of the devices that OpenGL may offer, and the CPU's cores."""

import os

from triangulators.errors import UnknownName

CPU = "cpu"
"""No device: compiled code."""

LLVMPIPE = "llvmpipe"

SOFTWARE_RENDERERS = (
    *("llvmpipe", "softpipe", "swrast", "swiftshader", "lavapipe", "software", "basic render"),
)


def is_software(renderer: str) -> bool:
    """Whether a renderer's name, such as GL_RENDERER, is of one that runs on a CPU."""
    return any(word in renderer.lower() for word in SOFTWARE_RENDERERS)


def matches(name: str, renderer: str) -> bool:
    """Whether GL_RENDERER is the device that `name` asks for."""
    if name.startswith("gpu"):
        return not is_software(renderer)
    return renderer.lower().startswith(name)


def check_name(name: str) -> None:
    """Raise `UnknownName` unless `name` is that of a device on some machine.

    >>> check_name("gpu1")
    """
    if name not in (CPU, LLVMPIPE) and not (name.startswith("gpu") and name[3:].isdigit()):
        raise UnknownName(f"unknown device {name!r} (known: gpu0, gpu1, ..., {LLVMPIPE}, {CPU})")


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
