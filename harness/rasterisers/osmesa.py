"""OpenGL through OSMesa, the off-screen interface of Mesa before 25.1."""

import ctypes
import ctypes.util
from collections.abc import Mapping
from typing import Any, ClassVar

from harness.rasterisers.base import Device
from harness.rasterisers.opengl import OpenGL

INSTALL = "apt-get install -y libosmesa6"

OSMESA_RGBA, UNSIGNED_BYTE = 0x1908, 0x1401
OSMESA_FORMAT, OSMESA_PROFILE, OSMESA_CORE_PROFILE = 0x22, 0x33, 0x34
OSMESA_MAJOR, OSMESA_MINOR = 0x36, 0x37
SIDE = 16  # side in px of a buffer that OSMesa requires; drawings go elsewhere


class OSMesaContext:
    """A core-profile context of libOSMesa with the methods that moderngl requires."""

    def __init__(self, library: str) -> None:
        self._library = osmesa = ctypes.CDLL(library)
        osmesa.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        osmesa.OSMesaCreateContextAttribs.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        osmesa.OSMesaGetProcAddress.restype = ctypes.c_void_p
        osmesa.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        osmesa.OSMesaMakeCurrent.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_int] * 3
        osmesa.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        self._pixels = (ctypes.c_ubyte * (4 * SIDE * SIDE))()
        settings = (OSMESA_FORMAT, OSMESA_RGBA, OSMESA_PROFILE, OSMESA_CORE_PROFILE)
        attributes = (*settings, OSMESA_MAJOR, 3, OSMESA_MINOR, 3, 0)  # 3.3 or newer
        values = (ctypes.c_int * len(attributes))(*attributes)
        self._context: int | None = osmesa.OSMesaCreateContextAttribs(values, None)
        if self._context is None:
            raise OSError("OSMesa has no OpenGL 3.3 core context")
        self.__enter__()

    def load(self, name: str) -> int:
        """Return the address of an OpenGL function, or 0 if it does not exist."""
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
        self._library.OSMesaDestroyContext(self._context)


class OSMesa(OpenGL):
    """Rasteriser with the shaders and counters of `opengl`, on libOSMesa's software driver."""

    name = "osmesa"
    device_names: ClassVar[tuple[str, ...]] = ("osmesa",)
    remedies: ClassVar[Mapping[str, str]] = {"": f"run: {INSTALL} (not in Mesa 25.1 and newer)"}
    drawn_by: ClassVar[str] = "llvmpipe"

    @classmethod
    def devices(cls) -> list[Device]:
        """Return the only device, if libOSMesa is installed."""
        # The library is located but not opened, as opening it loads a driver.
        installed = ctypes.util.find_library("OSMesa")
        if installed is None:
            return []
        environment = {"GALLIUM_DRIVER": "llvmpipe", "LP_NUM_THREADS": "0"}
        return [Device("osmesa", True, environment, {"library": installed})]

    def _open(self, device: Device) -> Any:
        return OSMesaContext(device.details["library"])
