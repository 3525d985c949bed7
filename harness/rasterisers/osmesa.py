"""OpenGL through OSMesa, Mesa's off-screen interface, where a Mesa before 25.1 has it installed."""

import ctypes
import ctypes.util
from typing import Any, ClassVar

from harness.errors import NoRasteriser
from harness.rasterisers.base import Device
from harness.rasterisers.opengl import OpenGL

INSTALL = "apt-get install -y libosmesa6"
LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")

OSMESA_RGBA, UNSIGNED_BYTE = 0x1908, 0x1401
OSMESA_FORMAT, OSMESA_PROFILE, OSMESA_CORE_PROFILE = 0x22, 0x33, 0x34
OSMESA_MAJOR, OSMESA_MINOR = 0x36, 0x37
VERSIONS = ((4, 5), (3, 3))
SIDE = 16
"""Side of OSMesa's own buffer, px; everything is drawn into framebuffer objects instead."""


def library() -> ctypes.CDLL | None:
    """Load libOSMesa, None where it is not installed."""
    for name in (*LIBRARIES, ctypes.util.find_library("OSMesa")):
        if name:
            try:
                return ctypes.CDLL(name)
            except OSError:
                continue
    return None


class OSMesaContext:
    """A core-profile context with the methods moderngl asks of a context.

    Raises
    ------
    NoRasteriser
        if OSMesa is not installed or has no such context
    """

    def __init__(self) -> None:
        found = library()
        if found is None:
            raise NoRasteriser(f"OSMesa is not installed; run: {INSTALL} (Mesa 25.1 dropped it)")
        self._library = found
        found.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        found.OSMesaCreateContextAttribs.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        found.OSMesaGetProcAddress.restype = ctypes.c_void_p
        found.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        found.OSMesaMakeCurrent.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_int] * 3
        found.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        self._pixels = (ctypes.c_ubyte * (4 * SIDE * SIDE))()
        self._context = next(filter(None, (self._create(*version) for version in VERSIONS)), None)
        if self._context is None:
            raise NoRasteriser("OSMesa has no OpenGL 3.3 core context; install a newer Mesa")
        self.__enter__()

    def _create(self, major: int, minor: int) -> int | None:
        wanted = (OSMESA_FORMAT, OSMESA_RGBA, OSMESA_PROFILE, OSMESA_CORE_PROFILE)
        attributes = (*wanted, OSMESA_MAJOR, major, OSMESA_MINOR, minor, 0)
        values = (ctypes.c_int * len(attributes))(*attributes)
        context: int | None = self._library.OSMesaCreateContextAttribs(values, None)
        return context

    def load(self, name: str) -> int:
        """Return the address of an OpenGL function, 0 if there is none."""
        address: int | None = self._library.OSMesaGetProcAddress(name.encode())
        return address or 0

    load_opengl_function = load

    def __enter__(self) -> "OSMesaContext":
        self._library.OSMesaMakeCurrent(self._context, self._pixels, UNSIGNED_BYTE, SIDE, SIDE)
        return self

    def __exit__(self, *_: object) -> None:
        self._library.OSMesaMakeCurrent(None, None, UNSIGNED_BYTE, 0, 0)

    def release(self) -> None:
        """Free the context."""
        if self._context is not None:
            self._library.OSMesaDestroyContext(self._context)
            self._context = None


class OSMesa(OpenGL):
    """The same shaders and counters as `opengl`, on the software driver inside libOSMesa."""

    name = "osmesa"
    known: ClassVar[tuple[str, ...]] = ("osmesa",)

    @classmethod
    def devices(cls) -> list[Device]:
        """List the one device there is, if libOSMesa is installed."""
        # Where the file is, not what it says: the library loads a driver when it is loaded.
        installed = ctypes.util.find_library("OSMesa")
        if installed is None:
            return []
        environment = {"GALLIUM_DRIVER": "llvmpipe", "LP_NUM_THREADS": "0"}
        return [Device("osmesa", True, environment, {"library": installed})]

    @classmethod
    def remedy(cls, name: str | None = None) -> str:  # noqa: ARG003 - it has but one
        """Say how to install it."""
        return f"run: {INSTALL} (Mesa 25.1 dropped it)"

    def _open(self, device: Device) -> Any:
        return OSMesaContext()

    def _matches(self, device: Device, renderer: str) -> bool:
        return renderer.lower().startswith("llvmpipe")
