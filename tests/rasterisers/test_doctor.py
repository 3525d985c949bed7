"""The doctor: what works is measured, what is missing gets its fix."""

from types import SimpleNamespace

import numpy as np
import pytest

from harness import doctor, rasterisers
from harness.frame import bare_frame
from harness.rasterisers import devices, osmesa


@pytest.fixture(scope="module")
def findings() -> dict[str, doctor.Finding]:
    return {finding.name: finding for finding in doctor.examine()}


def test_what_works_here_is_reported_with_its_figures(findings):
    llvmpipe = findings["opengl on llvmpipe"]
    assert llvmpipe.status == "ok", llvmpipe
    assert "llvmpipe" in llvmpipe.detail
    assert "timer: cpu" in llvmpipe.detail
    assert "counts equal the reference's" in llvmpipe.detail
    assert findings["EGL devices"].status == "ok"
    assert "software" in findings["EGL devices"].detail
    assert ".json" in findings["EGL vendor files"].detail
    assert "million bounding-box pixels a second" in findings["reference"].detail
    assert any(name.startswith("bounding-box on") for name in findings)


def test_how_often_a_pixel_of_four_samples_is_shaded_is_told(findings):
    assert "with 4 samples it shades once a pixel" in findings["opengl on llvmpipe"].detail
    assert "samples" not in findings["opengl on softpipe"].detail


def test_a_device_that_shades_each_sample_is_told():
    points = np.array([[0, 0], [2048, 0], [2048, 2048], [0, 2048]], np.int32)
    layer = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    for most, told in ((1, []), (4, ["with 4 samples it shades once a sample"])):
        opened = SimpleNamespace(
            supports=lambda options: True,
            device=SimpleNamespace(details={"max_samples": most}),
            count=lambda frame, triangles, options: {"hits": np.array([64 * options.samples])},
        )
        assert doctor._multisampling(opened, bare_frame(8, points, 4), layer) == told


def test_a_timers_step_is_what_all_its_times_are_multiples_of():
    assert doctor._step([3e-4, 5e-4, 12.3e-3]) == pytest.approx(1e-4)
    assert doctor._step([1.001e-6, 2.003e-6]) == pytest.approx(1e-9)
    assert doctor._step([0.0, 0.0]) == pytest.approx(1e-9)


def test_whatever_is_not_in_order_comes_with_a_fix(findings):
    for finding in findings.values():
        assert finding.status == "ok" or finding.fix, finding


def test_a_bare_machine_gets_the_lines_that_install_everything(monkeypatch):
    nothing = {"devices": [], "problems": ["libEGL.so.1: cannot open shared object file"]}
    monkeypatch.setattr(devices, "of_egl", lambda: ((), ()))
    monkeypatch.setattr(devices, "egl_listing", lambda: nothing)
    monkeypatch.setattr(osmesa.OSMesa, "devices", classmethod(lambda cls: []))
    monkeypatch.setattr(rasterisers.get("pyrender"), "devices", classmethod(lambda cls: []))
    monkeypatch.setattr(doctor, "VENDOR_FOLDERS", ("/nonexistent",))
    findings = {finding.name: finding for finding in doctor.examine()}
    for name in ("EGL vendor files", "EGL devices", "opengl on llvmpipe"):
        assert findings[name].status == "missing"
        assert "apt-get install -y libegl1 libgl1 libgl1-mesa-dri" in findings[name].fix
    assert "mesa-vulkan-drivers" in findings["opengl on zink"].fix
    assert "libosmesa6" in findings["osmesa"].fix
    assert findings["pyrender"].status == "warning"
    assert findings["reference"].status == "ok"


def test_a_driver_that_crashes_is_a_finding_and_not_the_end(monkeypatch):
    device = rasterisers.Device("llvmpipe", True, {}, {"egl_index": 99})
    monkeypatch.setattr(devices, "of_egl", lambda: ((device,), ()))
    finding = doctor._devices("opengl", "llvmpipe")
    assert finding.status == "missing"
    assert "requested device index 99" in finding.detail
    assert finding.fix
