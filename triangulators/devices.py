"""Names of devices: the CPU, and OpenGL devices; and the number of CPU cores."""

import os

from triangulators.errors import UnknownNameError

CPU = "cpu"  # compiled code on the CPU, without OpenGL
LLVMPIPE = "llvmpipe"  # Mesa's OpenGL renderer on the CPU

SOFTWARE_RENDERERS = (
    *("llvmpipe", "softpipe", "swrast", "swiftshader", "lavapipe", "software", "basic render"),
)


def is_software(renderer: str) -> bool:
    """Whether the renderer that OpenGL names `renderer` (GL_RENDERER) runs on a CPU."""
    return any(word in renderer.lower() for word in SOFTWARE_RENDERERS)


def selects_renderer(name: str, renderer: str) -> bool:
    """Whether a device's name, such as "gpu0", selects the renderer of this GL_RENDERER string."""
    if name.startswith("gpu"):
        return not is_software(renderer)
    return renderer.lower().startswith(name)


def check_device_name(name: str) -> None:
    """Raise `UnknownNameError` unless `name` has a device name's form; devices are not opened.

    >>> check_device_name("gpu1")
    """
    if name not in (CPU, LLVMPIPE) and not (name.startswith("gpu") and name[3:].isdigit()):
        choices = f"gpu0, gpu1, ..., {LLVMPIPE}, {CPU}"
        raise UnknownNameError(f"unknown device {name!r}; known: {choices}")


def count_usable_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
