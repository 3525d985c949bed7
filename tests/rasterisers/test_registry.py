import json
import os
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from harness import rasterisers
from harness.errors import NoRasteriserError
from harness.rasterisers import Device, Rasteriser, devices, find_device, get, names
from triangulators.gpu import selects_renderer


def test_get_returns_the_rasteriser_of_each_name():
    for name in names():
        assert issubclass(get(name), Rasteriser)
        assert get(name).name == name


def test_missing_devices_are_errors_without_fallback(monkeypatch):
    monkeypatch.setattr(devices, "list_egl_devices", lambda: ((Device("llvmpipe", True),), ()))
    with pytest.raises(NoRasteriserError, match="device 'gpu0' not found"):
        find_device("opengl", "gpu0")
    monkeypatch.setattr(devices, "list_egl_devices", lambda: ((), ("no libEGL",)))
    command = "apt-get install -y libegl1 libgl1 libgl1-mesa-dri"
    for name in (None, "llvmpipe"):
        with pytest.raises(NoRasteriserError, match=command):
            find_device("opengl", name)


def test_best_device_is_listed_first(monkeypatch):
    listed = (Device("gpu0", False), Device("llvmpipe", True))
    monkeypatch.setattr(devices, "list_egl_devices", lambda: (listed, ()))
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
def test_renderer_must_match_the_device_name(name, renderer, expected):
    assert selects_renderer(name, renderer) is expected


def test_devices_have_strings_of_the_driver():
    device = find_device("opengl", "llvmpipe")
    assert device.software
    assert device.environment["LP_NUM_THREADS"] == "0"
    assert {"vendor", "renderer", "version", "egl_index"} <= set(device.details)


def test_third_party_rasteriser_is_loaded_but_cannot_replace_a_built_in_one(monkeypatch):
    path = "harness.rasterisers.reference:Reference"
    points = {name: EntryPoint(name, path, rasterisers.GROUP) for name in ("mine", "opengl")}
    monkeypatch.setattr(rasterisers, "_find_plugins", lambda: points)
    assert (names().count("mine"), names().count("opengl")) == (1, 1)
    assert (get("mine").name, get("opengl").name) == ("reference", "opengl")


def test_first_working_environment_is_used(monkeypatch):
    answers = {
        name: {"devices": [{"renderer": renderer, "egl_index": 0}], "problems": []}
        for name, renderer in (("first", "llvmpipe"), ("second", "zink (x)"))
    }
    names = ("first", "second", "second")
    kinds = [devices.DeviceKind("zink", {"WAY": name}, ("egl", "software")) for name in names]
    monkeypatch.setattr(devices, "_list_egl_kinds", lambda: kinds)
    monkeypatch.setattr(
        devices, "run_probes", lambda probes: [answers[variables["WAY"]] for _, variables in probes]
    )
    working, problems = devices.list_egl_devices.__wrapped__()
    assert [(device.name, device.environment["WAY"]) for device in working] == [("zink", "second")]
    assert problems == ("zink: EGL opened 'llvmpipe' instead",)


def test_two_gpus_are_numbered(monkeypatch):
    names = enumerate(["NVIDIA A", "llvmpipe", "AMD B"])
    cards = [{"renderer": name, "egl_index": k} for k, name in names]
    kinds = [devices.DeviceKind("gpu", {}, ("egl", "hardware"))]
    monkeypatch.setattr(devices, "_list_egl_kinds", lambda: kinds)
    monkeypatch.setattr(devices, "run_probes", lambda probes: [{"devices": cards, "problems": []}])
    gpus, problems = devices.list_egl_devices.__wrapped__()
    facts = [(device.name, device.details["egl_index"], device.software) for device in gpus]
    assert facts == [("gpu0", 0, False), ("gpu1", 2, False)]
    assert problems == ()


def test_hanging_or_crashing_driver_is_reported_as_a_problem(monkeypatch, tmp_path):
    hanging, crashing = tmp_path / "hangs.py", tmp_path / "dies.py"
    hanging.write_text("import time; time.sleep(60)")
    crashing.write_text("import sys; sys.exit('segmentation fault')")
    monkeypatch.setattr(devices, "PROBE_TIMEOUT_S", 0.5)
    for program, problem in ((hanging, "no answer within"), (crashing, "segmentation fault")):
        monkeypatch.setattr(devices, "PROBE", program)
        working, problems = devices.list_egl_devices.__wrapped__()
        assert working == ()
        assert all(problem in text for text in problems)


ANSWER = {"devices": [{"renderer": "x"}], "problems": []}


@pytest.fixture
def program(monkeypatch, tmp_path) -> Path:
    """Return a probe program that lists one device and counts its calls."""
    monkeypatch.setenv("RASTER_HARNESS_CACHE", str(tmp_path / "cache" / "database.sqlite"))
    file = tmp_path / "probe.py"
    log = f"import sys; open({str(tmp_path / 'asked')!r}, 'a').write(sys.argv[1])\n"
    file.write_text(f"{log}print('{json.dumps(ANSWER)}')")
    monkeypatch.setattr(devices, "PROBE", file)
    return file


def count_calls(program: Path) -> int:
    return len((program.parent / "asked").read_text())


def test_answers_are_cached_until_drivers_or_variables_change(program, monkeypatch, tmp_path):
    monkeypatch.setattr(devices, "ROOT", tmp_path)
    (drivers := tmp_path / "usr/share/vulkan/icd.d").mkdir(parents=True)
    question = (("a",), {})
    for _ in range(3):
        assert devices.run_probes([question]) == [ANSWER]
    assert count_calls(program) == 1
    os.utime(drivers, (1, 1))
    devices.run_probes([question])
    assert count_calls(program) == 2
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev/nvidia0").symlink_to(tmp_path / "missing")  # ignored
    devices.run_probes([question])
    assert count_calls(program) == 2
    monkeypatch.setenv("MESA_LOADER_DRIVER_OVERRIDE", "zink")
    devices.run_probes([question])
    assert count_calls(program) == 3
    devices.run_probes([(("a",), {"OTHER": "1"}), (("b",), {})])
    assert count_calls(program) == 5
    devices.clear_cache()
    devices.run_probes([question])
    assert count_calls(program) == 6


def test_damaged_or_failed_answers_are_probed_again(program, tmp_path):
    question = (("a",), {})
    for damaged in ("", '{"devices": ['):
        devices.run_probes([question])
        (file,) = (tmp_path / "cache" / "drivers").iterdir()
        file.write_text(damaged)
    assert devices.run_probes([question])[0]["problems"] == []
    assert count_calls(program) == 3
    program.write_text("raise SystemExit('no')")
    for _ in range(2):
        assert devices.run_probes([question])[0]["problems"] == ["the driver failed: no"]
    assert list((tmp_path / "cache" / "drivers").iterdir()) == [file]
