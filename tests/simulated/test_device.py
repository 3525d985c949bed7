"""The device as a user meets it: names, what lacks, runs and comparisons."""

import json
import shutil
from hashlib import sha256

import pytest

from harness.errors import NoRasteriser, UsageError
from harness.rasterisers import find_device
from harness.rasterisers.simulated import building, skybox
from tests.conftest import ends_well
from tests.simulated.conftest import BESIDE

VARIABLE = skybox.SOURCES.variable


def test_a_devices_name_has_the_parameters_that_differ_in_order(buildable):
    names = {
        "skybox": "skybox",
        "skybox:tile=32": "skybox",
        "skybox:shader=2,tile=16": "skybox:tile=16,shader=2",
        "skybox:shader=0.50": "skybox:shader=0.5",
    }
    assert {name: find_device("simulated", name).name for name in names} == names


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("skybox:tile=17", "tile=17: choose one of 16, 32, 64"),
        ("skybox:tile=big", "tile=big is not a number"),
        ("skybox:tiles=16", "unknown parameter of skybox 'tiles'; did you mean 'tile'"),
        ("skybox:shader=0.1", "shader=0.1 is no multiple of 1/16"),
        ("skybox:fetch=-1", "fetch=-1 is outside"),
        ("skybix", "unknown device 'skybix'"),
    ],
)
def test_a_name_that_cannot_be_is_refused_in_a_line(name, said):
    with pytest.raises(UsageError, match=said):
        find_device("simulated", name)


def test_without_sources_one_line_says_what_to_do(monkeypatch, tmp_path, harness):
    monkeypatch.delenv(VARIABLE, raising=False)
    arguments = ("run", "--scene", "paper", "--rasterisers", "simulated", "--device", "skybox")
    code, _, told = harness(*arguments)
    assert code == 3
    assert f"{VARIABLE} is not set: clone" in told
    assert len(told.strip().splitlines()) == 1
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    with pytest.raises(NoRasteriser, match=f"{tmp_path} is not as it was published: clone"):
        find_device("simulated", "skybox")


def test_without_tools_one_line_says_what_to_do(monkeypatch, tmp_path):
    nothing = building.Sources("HERE", "", (), sha256().hexdigest(), skybox.SOURCES.tools)
    monkeypatch.setenv("HERE", str(tmp_path))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    lacking = "verilator, g++, make not installed: run make simulated"
    assert nothing.problem() == lacking


def test_a_file_that_was_changed_is_refused(buildable, monkeypatch, tmp_path):
    shutil.copytree(BESIDE, tmp_path / "other")
    changed = tmp_path / "other" / "hw" / "rtl" / "raster" / "VX_raster_qe.sv"
    changed.write_text(changed.read_text() + "\n")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "other"))
    with pytest.raises(NoRasteriser, match="is not as it was published"):
        find_device("simulated", "skybox")


def test_a_build_that_fails_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(building, "cache_file", lambda name: tmp_path / name)
    with pytest.raises(NoRasteriser, match="x cannot be built: false failed"):
        building.built("x", "key", lambda made: [["false"]])
    assert list((tmp_path / "simulated").iterdir()) == []


def records_of(folder):
    return [json.loads(line) for line in (folder / "cases.jsonl").read_text().splitlines()]


def test_a_run_has_cycles_for_its_time_and_compare_finds_one_added(
    buildable, harness, in_process, no_plots, tmp_path
):
    arguments = ("run", "--scene", "paper", "--rasterisers", "simulated", "--device", "skybox")
    chosen = ("--triangulators", "ear-clipping,optimal:half-perimeter", "--resolution", "64")
    for name in ("base", "head"):
        told, _ = ends_well(harness(*arguments, *chosen, "--out", str(tmp_path / name)))
    assert "cycles" in told
    assert "fewer cycles than ear-clipping" in " ".join(told.split())
    for record in records_of(tmp_path / "base"):
        assert record["time"] == {"timer": "cycles", "cycles": record["counters"]["cycles"]}
        assert record["device"] == "skybox"
    assert [r["time"] for r in records_of(tmp_path / "base")] == [
        r["time"] for r in records_of(tmp_path / "head")
    ]
    base, head = str(tmp_path / "base"), str(tmp_path / "head")
    told, _ = ends_well(harness("compare", base, head))
    assert "no counter differs" in told
    assert "cycles" in told.splitlines()[4].split()

    later = records_of(tmp_path / "head")
    later[0]["counters"]["cycles"] += 1
    later[0]["time"]["cycles"] += 1
    lines = "".join(json.dumps(record) + "\n" for record in later)
    (tmp_path / "head" / "cases.jsonl").write_text(lines)
    code, told, _ = harness("compare", base, head)
    assert code == 1
    assert "cycles" in told
