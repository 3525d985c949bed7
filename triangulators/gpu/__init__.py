"""Names of devices; the optimum of half-perimeter (H) or expected quads (Q) by compute shaders.

The shaders solve small rings. The CPU solves unsupported polygons, and polygons that a failed
device did not solve. Ties are broken as on the CPU.

H: the dynamic program of `optimum.full_table` in int32. The triangles are identical to the CPU's.

Q: the dynamic program of `optimum.any_cost` in doubles, with the operations of the CPU's kernel in
the same order, without fused operations. So the triangles are identical if the device rounds double
divisions correctly, as IEEE 754 requires and GLSL does not. On any device, Q of the returned
triangles, computed by the CPU, must be within 1e-9 of the device's sum.

The shaders run in OpenGL 4.3. GLSL has 64-bit products of 32-bit integers (imulExtended); WGSL,
which would also run on macOS, has not.
"""

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
