"""Rasterisers and devices by name, and what is said when one is missing."""

from __future__ import annotations

import pytest

from harness.errors import NoRasteriser, UsageError
from harness.rasterisers import Device, Rasteriser, egl, find_device, get, names


def test_every_name_leads_to_a_rasteriser_of_that_name():
    for name in names():
        assert issubclass(get(name), Rasteriser)
        assert get(name).name == name


def test_an_unknown_rasteriser_gets_the_nearest_name():
    with pytest.raises(UsageError, match="unknown rasteriser 'opengll'; did you mean 'opengl'"):
        get("opengll")


def test_an_unknown_device_gets_the_nearest_name():
    with pytest.raises(UsageError, match="unknown device 'llvmpip'; did you mean 'llvmpipe'"):
        find_device("opengl", "llvmpip")


def test_a_missing_gpu_is_an_error_and_no_fallback(monkeypatch):
    monkeypatch.setattr(egl, "probe", lambda: ((Device("llvmpipe", True),), ()))
    with pytest.raises(NoRasteriser, match="device 'gpu0' does not work here"):
        find_device("opengl", "gpu0")


def test_a_machine_without_gl_gets_the_line_that_installs_it(monkeypatch):
    monkeypatch.setattr(egl, "probe", lambda: ((), ("no libEGL",)))
    for name in (None, "llvmpipe"):
        with pytest.raises(NoRasteriser, match="apt-get install -y libegl1 libgl1 libgl1-mesa-dri"):
            find_device("opengl", name)


def test_the_best_device_comes_first(monkeypatch):
    found = (Device("gpu0", False), Device("llvmpipe", True))
    monkeypatch.setattr(egl, "probe", lambda: (found, ()))
    assert find_device("opengl").name == "gpu0"
    assert find_device("reference").name == "cpu"


@pytest.mark.parametrize(
    ("name", "renderer", "expected"),
    [
        ("llvmpipe", "llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("llvmpipe", "zink (llvmpipe (LLVM 15.0.6, 256 bits))", False),
        ("zink", "zink Vulkan 1.3(llvmpipe (LLVM 19.1.7, 256 bits) (MESA_LLVMPIPE))", True),
        ("softpipe", "softpipe", True),
        ("gpu0", "NVIDIA H200/PCIe/SSE2", True),
        ("gpu0", "zink (AMD Radeon)", True),
        ("gpu1", "llvmpipe (LLVM 15.0.6, 256 bits)", False),
    ],
)
def test_the_renderer_is_checked_against_the_name(name, renderer, expected):
    assert egl.matches(name, renderer) is expected


def test_devices_are_found_with_their_strings():
    device = find_device("opengl", "llvmpipe")
    assert device.software
    assert device.environment["LP_NUM_THREADS"] == "0"
    assert {"vendor", "renderer", "version", "egl_index"} <= set(device.details)
