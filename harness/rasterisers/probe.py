"""Ask EGL or WebGPU what it can open: a program, run in the environment of the device looked for.

`probe.py egl hardware` opens each EGL device that is not software, `probe.py egl software` the
first that is, `probe.py egl list` none; `probe.py webgpu BACKEND,BACKEND` (Vulkan, Metal, DX12, GL)
opens nothing but the drivers' lists. Each prints one JSON object. It stands alone, so that it
starts quickly and so that a driver that crashes takes only the probe with it.
"""

import ctypes
import json
import sys
from typing import Any

EGL_EXTENSIONS = 0x3055
EGL_DRM_DEVICE_FILE = 0x3233
STRINGS = {"vendor": 0x1F00, "renderer": 0x1F01, "version": 0x1F02, "shading_language": 0x8B8C}
MAX_DEVICES = 32

ADAPTER = ("vendor", "architecture", "device", "description", "adapter_type", "backend_type")
"""What is told of a WebGPU adapter."""


def egl_devices() -> list[dict[str, Any]]:
    """List EGL's devices: index, whether software, DRM file; opens none of them.

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
        drm = "EGL_EXT_device_drm " in extensions + " "
        file = query_string(found[index], EGL_DRM_DEVICE_FILE) if drm else None
        devices.append(
            {
                "egl_index": index,
                "software": "EGL_MESA_device_software" in extensions,
                "file": file.decode() if file else None,
            }
        )
    return devices


def open_device(index: int) -> dict[str, str]:
    """Open an OpenGL context on an EGL device and return the driver's strings."""
    import glcontext

    context = glcontext.get_backend_by_name("egl")(
        mode="standalone",
        glversion=330,
        device_index=index,
        libgl="libGL.so.1",
        libegl="libEGL.so.1",
    )
    get_string = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_uint)(context.load("glGetString"))
    return {key: (get_string(name) or b"").decode() for key, name in STRINGS.items()}


def egl(kind: str) -> dict[str, Any]:
    """Probe the EGL devices of one kind; {"devices": [...], "problems": [...]}."""
    result: dict[str, Any] = {"devices": [], "problems": []}
    try:
        found = egl_devices()
    except OSError as error:
        result["problems"].append(str(error))
        return result
    if kind == "list":
        return {**result, "devices": found}
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
