"""The command `doctor`: working devices are measured, and missing ones get a fix."""

from harness import rasterisers
from harness.commands import doctor
from harness.rasterisers import devices, opengl


def test_working_devices_are_reported_and_every_problem_has_a_fix():
    findings = {finding.name: finding for finding in doctor.examine_devices()}
    llvmpipe = findings["opengl on llvmpipe"]
    assert llvmpipe.status == "ok", llvmpipe
    assert "llvmpipe" in llvmpipe.detail
    assert "timer: cpu" in llvmpipe.detail
    assert "counts equal the reference's" in llvmpipe.detail
    assert "counts equal the reference's" in findings["bounding-box on llvmpipe"].detail
    if (roofs := findings["pyrender on llvmpipe"]).status == "ok":
        assert "draws, but cannot count" in roofs.detail
    for finding in findings.values():
        assert finding.status == "ok" or finding.fix, finding


def test_bare_machine_gets_install_commands(monkeypatch):
    problem = "llvmpipe: libEGL.so.1: cannot open shared object file"
    monkeypatch.setattr(devices, "list_egl_devices", lambda: ((), (problem,)))
    monkeypatch.setattr(opengl.OSMesa, "devices", classmethod(lambda cls: []))
    monkeypatch.setattr(rasterisers.get("pyrender"), "devices", classmethod(lambda cls: []))
    findings = {finding.name: finding for finding in doctor.examine_devices()}
    llvmpipe = findings["opengl on llvmpipe"]
    assert (llvmpipe.status, llvmpipe.detail) == ("missing", problem)
    assert "apt-get install -y libegl1 libgl1 libgl1-mesa-dri" in llvmpipe.fix
    assert "mesa-vulkan-drivers" in findings["opengl on zink"].fix
    assert "libosmesa6" in findings["osmesa on osmesa"].fix
    assert findings["pyrender on llvmpipe"].status == "warning"


def test_crashing_driver_is_reported_as_a_finding(monkeypatch):
    device = rasterisers.Device("llvmpipe", True, {}, {"egl_index": 99})
    monkeypatch.setattr(devices, "list_egl_devices", lambda: ((device,), ()))
    finding = doctor.examine_device("opengl", "llvmpipe")
    assert finding.status == "missing"
    assert "requested device index 99" in finding.detail
    assert finding.fix


def test_fix_names_variables_that_hide_drivers_and_container_options(monkeypatch, tmp_path):
    kind = rasterisers.get("opengl")
    for variable in doctor.HIDING_VARIABLES:
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(doctor, "NVIDIA_NODE", tmp_path / "missing")
    assert doctor._find_remedy(kind, "llvmpipe") == kind.remedy("llvmpipe")
    assert doctor._find_remedy(kind, "gpu0") == kind.remedy("gpu0")
    monkeypatch.setattr(doctor, "NVIDIA_NODE", tmp_path)
    assert "NVIDIA_DRIVER_CAPABILITIES=graphics" in doctor._find_remedy(kind, "gpu0")
    assert doctor._find_remedy(kind, "llvmpipe") == kind.remedy("llvmpipe")
    monkeypatch.setenv("LIBGL_DRIVERS_PATH", "/nowhere")
    remedy = doctor._find_remedy(kind, "llvmpipe")
    assert remedy.startswith("unset LIBGL_DRIVERS_PATH, which may hide")
