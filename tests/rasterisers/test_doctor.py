"""The doctor: what works is measured, what is missing gets its fix."""

import pytest

from harness import doctor, rasterisers
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
    assert "counts equal the reference's" in findings["bounding-box on llvmpipe"].detail
    if (roofs := findings["pyrender on llvmpipe"]).status == "ok":
        assert "it draws, but cannot count" in roofs.detail


def test_whatever_is_not_in_order_comes_with_a_fix(findings):
    for finding in findings.values():
        assert finding.status == "ok" or finding.fix, finding


def test_a_bare_machine_gets_the_lines_that_install_everything(monkeypatch):
    problem = "llvmpipe: libEGL.so.1: cannot open shared object file"
    monkeypatch.setattr(devices, "of_egl", lambda: ((), (problem,)))
    monkeypatch.setattr(osmesa.OSMesa, "devices", classmethod(lambda cls: []))
    monkeypatch.setattr(rasterisers.get("pyrender"), "devices", classmethod(lambda cls: []))
    findings = {finding.name: finding for finding in doctor.examine()}
    llvmpipe = findings["opengl on llvmpipe"]
    assert (llvmpipe.status, llvmpipe.detail) == ("missing", problem)
    assert "apt-get install -y libegl1 libgl1 libgl1-mesa-dri" in llvmpipe.fix
    assert "mesa-vulkan-drivers" in findings["opengl on zink"].fix
    assert "libosmesa6" in findings["osmesa on osmesa"].fix
    assert findings["pyrender on llvmpipe"].status == "warning"


def test_a_driver_that_crashes_is_a_finding_and_not_the_end(monkeypatch):
    device = rasterisers.Device("llvmpipe", True, {}, {"egl_index": 99})
    monkeypatch.setattr(devices, "of_egl", lambda: ((device,), ()))
    finding = doctor.examine_device("opengl", "llvmpipe")
    assert finding.status == "missing"
    assert "requested device index 99" in finding.detail
    assert finding.fix
