import json
from dataclasses import replace
from pathlib import Path

import pytest

from harness.errors import IncompatibleRunsError, InputError
from harness.page import device_summaries
from tests.conftest import assert_refused, require_ok
from tests.paths import ROOT


def test_imported_run_has_a_summary(harness, saved):
    require_ok(harness("import", str(saved()), "--out", "phone", "--summary", "phone.json"))
    summary = json.loads(Path("phone.json").read_text())
    assert summary["device"] == "apple-metal-3-safari"
    assert summary["timer"] == "gpu"
    assert "Safari" in summary["host"]
    assert [view["resolution"] for view in summary["views"]] == [64, 128]
    for view in summary["views"]:
        assert set(view["triangulators"]) == {"delaunay", "optimal:half-perimeter"}
        for metrics in view["triangulators"].values():
            value, low, high = metrics["time"]
            assert low < value < high
            assert 0.5 < metrics["quads"] < 1.5


def test_measured_run_has_a_summary(harness, small_run):
    assert_refused(harness("import", str(small_run.path)), "give --summary FILE")
    unused = ("--summary", "cpu.json", "--out", "copy")
    assert_refused(harness("import", str(small_run.path), *unused), "only for files of a page")
    require_ok(harness("import", str(small_run.path), "--summary", "cpu.json"))
    assert json.loads(Path("cpu.json").read_text())["rasteriser"] == "reference"
    arguments = ("import", str(small_run.path), "--summary", "x.json", "--device", "gpu7")
    assert_refused(harness(*arguments), "times of 0 devices")


def test_summary_accepts_other_scenes_but_not_other_devices(tmp_path, small_run):
    file = device_summaries.write_summary(small_run, tmp_path / "cpu.json")
    first = json.loads(file.read_text())
    assert json.loads(device_summaries.write_summary(small_run, file).read_text()) == first
    records = [record.with_id(scene="village") for record in small_run.records]
    device_summaries.write_summary(replace(small_run, records=records), file)
    assert len(json.loads(file.read_text())["views"]) == 4
    records = [record.with_id(device="other") for record in small_run.records]
    with pytest.raises(IncompatibleRunsError, match="a summary of reference on cpu"):
        device_summaries.write_summary(replace(small_run, records=records), file)
    file.write_text("{}")
    with pytest.raises(InputError, match="not a summary of a device"):
        device_summaries.write_summary(small_run, file)


def test_a_summary_has_the_drivers_name_of_the_device(small_run):
    devices = {"reference on cpu": {"details": {"renderer": "the CPU itself", "version": "7"}}}
    named = replace(small_run, facts={**small_run.facts, "devices": devices})
    summary = device_summaries.summarise_device(named)
    assert (summary["renderer"], summary["driver"]) == ("the CPU itself", "7")
    assert device_summaries.summarise_device(replace(small_run, facts={}))["renderer"] == "cpu"


def test_summary_of_a_software_device_refuses_another_cpu(tmp_path, small_run):
    file = tmp_path / "cpu.json"
    first, second = (
        replace(small_run, facts={**small_run.facts, "cpu": {"label": label}})
        for label in ("AMD EPYC 25/17, 512-bit", "Xeon 6/143, 512-bit")
    )
    device_summaries.write_summary(first, file)
    assert json.loads(file.read_text())["cpu"] == "AMD EPYC 25/17, 512-bit"
    assert "`cpu`, reference, AMD EPYC 25/17, 512-bit |" in device_summaries.format_table(tmp_path)
    message = "measured on AMD EPYC 25/17, 512-bit, this run on Xeon"
    with pytest.raises(IncompatibleRunsError, match=message):
        device_summaries.write_summary(second, file)
    gpu = [record.with_id(device="gpu0") for record in first.records]
    assert device_summaries.summarise_device(replace(first, records=gpu))["cpu"] == ""


@pytest.mark.parametrize(
    "file", sorted((ROOT / "results" / "devices").glob("*.json")), ids=lambda file: file.stem
)
def test_contributed_summaries_are_readable(file):
    summary = json.loads(file.read_text())
    assert summary["format"] == device_summaries.FORMAT
    assert summary["version"] <= device_summaries.VERSION
    for view in summary["views"]:
        for metrics in view["triangulators"].values():
            value, low, high = metrics["time"]
            assert 0 < low <= value <= high
