"""The doctor: what works is measured, what is missing gets its fix."""

from __future__ import annotations

import pytest

from harness import doctor, rasterisers
from harness.rasterisers.opengl import egl, osmesa


@pytest.fixture(scope="module")
def findings() -> dict[str, doctor.Finding]:
    return {finding.name: finding for finding in doctor.examine()}


def test_what_works_here_is_reported_with_its_figures(findings):
    llvmpipe = findings["opengl on llvmpipe"]
    assert llvmpipe.status == "ok", llvmpipe
    assert "llvmpipe" in llvmpipe.detail
    assert "timer: wall" in llvmpipe.detail
    assert "counts equal the reference's" in llvmpipe.detail
    assert findings["EGL devices"].status == "ok"
    assert "software" in findings["EGL devices"].detail
    assert ".json" in findings["EGL vendor files"].detail
    assert "million bounding-box pixels a second" in findings["reference"].detail
    assert any(name.startswith("bounding-box on") for name in findings)


def test_whatever_is_not_in_order_comes_with_a_fix(findings):
    for finding in findings.values():
        assert finding.status == "ok" or finding.fix, finding


def test_a_bare_machine_gets_the_lines_that_install_everything(monkeypatch):
    nothing = {"devices": [], "problems": ["libEGL.so.1: cannot open shared object file"]}
    monkeypatch.setattr(egl, "probe", lambda: ((), ()))
    monkeypatch.setattr(egl, "listing", lambda: nothing)
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
    monkeypatch.setattr(egl, "probe", lambda: ((device,), ()))
    finding = doctor._devices("opengl", "llvmpipe")
    assert finding.status == "missing"
    assert "requested device index 99" in finding.detail
    assert finding.fix
