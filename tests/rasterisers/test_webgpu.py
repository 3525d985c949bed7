"""WebGPU on the adapters of this machine, in separate processes, compared with the reference."""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from harness import rasterisers
from harness.errors import NoRasteriserError, UsageError
from harness.grid import round_points
from harness.measuring import tasks
from harness.rasterisers import Device, Options, devices, find_device, get
from harness.rasterisers.reference import SHADED
from tests.rasterisers import pictures
from tests.rasterisers.conftest import (
    Call,
    find_errors,
    loose_triangles,
    open_on,
    random_triangles,
)


@pytest.fixture(scope="module", params=["llvmpipe", "lavapipe"])
def on_device(request: pytest.FixtureRequest) -> Iterator[Call]:
    with open_on("webgpu", request.param) as call:
        yield call


def test_options_change_no_count_and_no_picture(on_device, reference):
    case = random_triangles(seed=250, size=250, number=150, grid=1)
    assert on_device(tasks.open_device).details["subpixel_bits"] == 8
    for options in (Options(), Options(work=50), Options(order="shuffled", seed=3)):
        drawn = on_device(tasks.draw_and_count, *case, options)
        assert set(drawn) == set(SHADED)
        assert find_errors(reference, drawn, *case) == []
        drawn = on_device(pictures.draw_image, *case, options)
        expected = pictures.read_image(reference, *case, replace(options, work=0))
        assert np.array_equal(drawn, expected)


def test_long_slivers_need_more_than_32_bits(on_device, reference):
    """Products of coordinates have 42 bits; the sign of their difference must be exact."""
    rng = np.random.default_rng(5)
    size = 8192
    ends = rng.integers(256, (size - 1) * 256, (40, 2, 2))
    apexes = np.clip(ends[:, :1] + rng.integers(-300, 300, (40, 1, 2)), 256, (size - 1) * 256)
    frame, triangles = loose_triangles(np.concatenate([ends, apexes], axis=1), size)
    drawn = on_device(tasks.draw_and_count, frame, triangles, Options())
    assert find_errors(reference, drawn, frame, triangles) == []
    assert drawn["fragments"].sum() > 50_000


def record_instances(name: str, device: Device, software: bool) -> tuple[list[int], list[float]]:
    """Draw 10 times in the worker; return the instances of each draw call, and the seconds."""
    from wgpu.backends import wgpu_native as wgpu

    opened = tasks._get_rasteriser(name, device)
    case = (*loose_triangles(np.array([[256, 256], [9000, 256], [256, 9000]]), 64), Options())
    instances_drawn: list[int] = []
    draw = wgpu.GPURenderPassEncoder.draw_indexed

    def record(self: Any, count: int, instances: int = 1, *arguments: Any) -> None:
        instances_drawn.append(instances)
        draw(self, count, instances, *arguments)

    with opened.prepare(*case) as drawing, pytest.MonkeyPatch.context() as patch:
        drawing.one_pass = not software
        patch.setattr(wgpu.GPURenderPassEncoder, "draw_indexed", record)
        sample = drawing.sample(10)
    return instances_drawn, [sample.wall, sample.gpu or 1.0]


def count_with_limit_of_32_px(name: str, device: Device, *case: Any) -> None:
    """Count in the worker with a maximum viewport of 32 px."""
    opened = tasks._get_rasteriser(name, device)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(opened, "max_size", 32)
        opened.draw_and_count(*case)


@pytest.mark.parametrize(("software", "drawn"), [(True, [1] * 10), (False, [10])])
def test_every_repeat_is_drawn(on_device, software, drawn):
    actual, seconds = on_device(record_instances, software)
    assert actual == drawn
    assert min(seconds) > 0


def test_swiftshader_counters_equal_the_reference_on_its_grid(reference):
    frame, triangles = random_triangles(seed=6, size=250, number=150, grid=1)
    moved = frame.with_points(round_points(frame.points, 16))
    with open_on("webgpu", "swiftshader") as call:
        details = call(tasks.open_device).details
        assert (details["step"], details["subpixel_bits"]) == (16, 4)
        counted = call(tasks.draw_and_count, frame, triangles, Options())
        picture = call(pictures.draw_image, frame, triangles, Options())
    assert find_errors(reference, counted, moved, triangles) == []
    assert np.array_equal(picture, pictures.read_image(reference, moved, triangles, Options()))


def test_unsupported_options_are_refused(on_device):
    frame, triangles = loose_triangles([[256, 256], [2000, 256], [256, 2000]], 64)
    for options in (Options(samples=4), Options(texture=1)):
        assert not get("webgpu").supports(options)
        with pytest.raises(UsageError, match=r"one sample per pixel and no textures\); use opengl"):
            on_device(tasks.draw_and_count, frame, triangles, options)
    with pytest.raises(UsageError, match="64x64 px exceeds the device's maximum of 32"):
        on_device(count_with_limit_of_32_px, frame, triangles, Options())


def make_adapter(name: str) -> dict[str, str]:
    """Return the facts of an adapter, "<kind>: <device> on <backend>"."""
    kind, device, backend = re.split(": | on ", name)
    facts = {"device": device, "adapter_type": kind, "backend_type": backend}
    return dict.fromkeys(("vendor", "architecture", "description"), "") | facts


H100 = "DiscreteGPU: NVIDIA H100 on Vulkan, DiscreteGPU: NVIDIA H100/PCIe/SSE2 on OpenGL"
LLVMPIPE = "CPU: llvmpipe (LLVM 15) on Vulkan, CPU: llvmpipe (LLVM 15) on OpenGL"
RTX = "DiscreteGPU: NVIDIA RTX on D3D12, CPU: Microsoft Basic Render on D3D12"
MALI, M3 = "IntegratedGPU: Mali-G52 (Panfrost) on OpenGL", "IntegratedGPU: Apple M3 on Metal"


@pytest.mark.parametrize(
    ("system", "adapters", "names"),
    [
        (
            "linux",
            f"{H100}, DiscreteGPU: AMD Radeon on Vulkan, {LLVMPIPE}",
            ["gpu0: NVIDIA H100 on Vulkan", "gpu1: AMD Radeon on Vulkan"],
        ),
        ("linux", MALI, ["gpu0: Mali-G52 (Panfrost) on OpenGL"]),
        ("darwin", M3, ["gpu0: Apple M3 on Metal"]),
        (
            "win32",
            f"{RTX}, DiscreteGPU: NVIDIA RTX on Vulkan",
            ["gpu0: NVIDIA RTX on D3D12", "warp: Microsoft Basic Render on D3D12"],
        ),
    ],
)
def test_gpu_is_listed_once_for_several_drivers(monkeypatch, system, adapters, names):
    monkeypatch.setattr(devices.sys, "platform", system)
    monkeypatch.setattr(devices, "find_vulkan_environment", lambda patterns: None)
    answer = {"devices": [make_adapter(name) for name in adapters.split(", ")], "problems": []}
    monkeypatch.setattr(devices, "run_probes", lambda probes: [answer for _ in probes])
    listed, problems = devices.list_webgpu_devices.__wrapped__()
    described = [
        f"{device.name}: {device.details['device']} on {device.details['backend_type']}"
        for device in listed
        if device.name != "llvmpipe"
    ]
    assert described == names
    assert all(device.software != device.name.startswith("gpu") for device in listed)
    assert problems == ()


def test_missing_wgpu_gets_an_install_command(monkeypatch):
    answer = (), ("gpu: No module named 'wgpu'",)
    monkeypatch.setattr(devices, "list_webgpu_devices", lambda: answer)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(NoRasteriserError, match=r"pip install .*\[webgpu\]"):
        find_device("webgpu")


def test_default_rasteriser(monkeypatch):
    assert rasterisers.choose_default_rasteriser() == "opengl"
    monkeypatch.setattr(get("opengl"), "devices", classmethod(lambda cls: []))
    assert rasterisers.choose_default_rasteriser() == "webgpu"
    monkeypatch.setattr(get("webgpu"), "devices", classmethod(lambda cls: []))
    assert rasterisers.choose_default_rasteriser() == "opengl"
