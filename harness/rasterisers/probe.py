"""Ask EGL or WebGPU what it can open: a program, run in the environment of the device looked for.

`probe.py egl hardware` opens each EGL device that is not software, `probe.py egl software` the
first that is; `probe.py webgpu BACKEND,BACKEND` (Vulkan, Metal, DX12, GL) opens nothing but the
drivers' lists. Each prints one JSON object. It stands alone, so that it starts quickly and so that
a driver that crashes takes only the probe with it.
"""

import ctypes
import json
import sys
from typing import Any

EGL_EXTENSIONS = 0x3055
MAX_DEVICES = 32

ADAPTER = ("vendor", "architecture", "device", "description", "adapter_type", "backend_type")
"""What is told of a WebGPU adapter."""


def egl_devices() -> list[dict[str, Any]]:
    """List EGL's devices: index, whether software; opens none of them.

    Raises
    ------
    OSError
        if there is no libEGL, or it cannot list devices
    """
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    addresses = [
        egl.eglGetProcAddress(name) for name in (b"eglQueryDevicesEXT", b"eglQueryDeviceStringEXT")
    ]
    if not all(addresses):
        raise OSError("libEGL has no EGL_EXT_device_enumeration")
    handle, handles = ctypes.c_void_p, ctypes.POINTER(ctypes.c_void_p)
    query_devices = ctypes.CFUNCTYPE(
        ctypes.c_uint, ctypes.c_int, handles, ctypes.POINTER(ctypes.c_int)
    )(addresses[0])
    query_string = ctypes.CFUNCTYPE(ctypes.c_char_p, handle, ctypes.c_int)(addresses[1])
    found, number = (handle * MAX_DEVICES)(), ctypes.c_int()
    query_devices(MAX_DEVICES, found, ctypes.byref(number))
    devices = []
    for index in range(number.value):
        extensions = (query_string(found[index], EGL_EXTENSIONS) or b"").decode()
        software = "EGL_MESA_device_software" in extensions
        devices.append({"egl_index": index, "software": software})
    return devices


def open_device(index: int) -> dict[str, str]:
    """Open an OpenGL context on an EGL device and return the driver's strings."""
    import moderngl

    names = {"libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
    where: dict[str, Any] = {"backend": "egl", "device_index": index, **names}
    told = moderngl.create_standalone_context(**where).info
    return {name: told[f"GL_{name.upper()}"] for name in ("vendor", "renderer", "version")}


def egl(kind: str) -> dict[str, Any]:
    """Probe the EGL devices of one kind; {"devices": [...], "problems": [...]}."""
    result: dict[str, Any] = {"devices": [], "problems": []}
    try:
        found = egl_devices()
    except OSError as error:
        result["problems"].append(str(error))
        return result
    devices = [device for device in found if device["software"] == (kind == "software")]
    for device in devices[:1] if kind == "software" else devices:
        try:
            result["devices"].append({**device, **open_device(device["egl_index"])})
        except Exception as error:  # glcontext raises plain Exception
            result["problems"].append(f"EGL device {device['egl_index']}: {error}")
    return result


def webgpu(backends: str) -> dict[str, Any]:
    """List the adapters of some backends; {"devices": [...], "problems": [...]}."""
    try:
        import wgpu
        from wgpu.backends.wgpu_native.extras import set_instance_extras

        set_instance_extras(backends=backends.split(","))
        adapters = wgpu.gpu.enumerate_adapters_sync()
    except (ImportError, OSError, RuntimeError) as error:
        return {"devices": [], "problems": [str(error)]}
    devices = [{name: str(adapter.info[name]) for name in ADAPTER} for adapter in adapters]
    return {"devices": devices, "problems": []}


if __name__ == "__main__":
    print(json.dumps({"egl": egl, "webgpu": webgpu}[sys.argv[1]](sys.argv[2])))
