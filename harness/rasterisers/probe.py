"""Program that lists the devices of EGL or WebGPU as JSON, for `devices.py`.

`probe.py egl hardware` opens each hardware device of EGL, `probe.py egl software` the first
software device; `probe.py webgpu BACKEND,BACKEND` (Vulkan, Metal, DX12, GL) lists adapters without
opening them. The program imports nothing of the harness, so that it starts quickly.
"""

import ctypes
import json
import sys
from typing import Any

EGL_EXTENSIONS = 0x3055
MAX_DEVICES = 32

# Reported properties of a WebGPU adapter.
ADAPTER = ("vendor", "architecture", "device", "description", "adapter_type", "backend_type")


def list_egl_devices() -> list[dict[str, Any]]:
    """List EGL's devices without opening them; raise OSError if libEGL cannot list devices."""
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
    pointers, number = (handle * MAX_DEVICES)(), ctypes.c_int()
    query_devices(MAX_DEVICES, pointers, ctypes.byref(number))
    devices = []
    for index in range(number.value):
        extensions = (query_string(pointers[index], EGL_EXTENSIONS) or b"").decode()
        software = "EGL_MESA_device_software" in extensions
        devices.append({"egl_index": index, "software": software})
    return devices


def open_device(index: int) -> dict[str, str]:
    """Open an OpenGL context on an EGL device and return the driver's strings."""
    import moderngl

    names = {"libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
    settings: dict[str, Any] = {"backend": "egl", "device_index": index, **names}
    info = moderngl.create_standalone_context(**settings).info
    return {name: info[f"GL_{name.upper()}"] for name in ("vendor", "renderer", "version")}


def probe_egl(kind: str) -> dict[str, Any]:
    """Return all "hardware" devices, or the first "software" device, that open, and problems."""
    result: dict[str, Any] = {"devices": [], "problems": []}
    try:
        listed = list_egl_devices()
    except OSError as error:
        result["problems"].append(str(error))
        return result
    devices = [device for device in listed if device["software"] == (kind == "software")]
    for device in devices[:1] if kind == "software" else devices:
        try:
            result["devices"].append({**device, **open_device(device["egl_index"])})
        except Exception as error:  # glcontext raises plain Exception
            result["problems"].append(f"EGL device {device['egl_index']}: {error}")
    return result


def probe_webgpu(backends: str) -> dict[str, Any]:
    """Return the adapters of comma-separated backends, and problems."""
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
    print(json.dumps({"egl": probe_egl, "webgpu": probe_webgpu}[sys.argv[1]](sys.argv[2])))
