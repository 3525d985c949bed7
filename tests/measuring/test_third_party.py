"""A third party's triangulator may do anything: it costs its own case and nothing else."""

from __future__ import annotations

import pytest

from harness.measuring.run import run
from harness.measuring.worker import Worker
from tests.measuring.test_run import MOCK, measure, plan_for, quiet

REASONS = {
    "segfault": "died: SIGSEGV",
    "hang": "ran past",
    "devour": "emory",
    "raises": "RuntimeError: no idea",
    "returns_nothing": "shape ()",
    "returns_nan": "expected integer indices",
    "returns_out_of_range": "indices outside",
    "returns_coordinates": "expected (m, 3)",
    "returns_overlapping": "polygon 0",
    "returns_too_little": "polygon 0",
}


def test_what_goes_wrong_is_a_failed_record_and_the_rest_is_measured(block, tmp_path, monkeypatch):
    monkeypatch.setattr("harness.measuring.processes.MEMORY_SHARE", 0.15)
    names = tuple(f"tests.broken:{name}" for name in REASONS)
    plan = plan_for(block, triangulators=("delaunay", *names, "tests.broken:right"), timeout_s=6.0)
    records = {
        record["triangulator"]: record
        for record in measure(plan, tmp_path / "out", open_worker=Worker).records
    }
    for name, reason in REASONS.items():
        record = records[f"tests.broken:{name}"]
        assert record["status"] == "failed", name
        assert reason in record["reason"], name
    assert records["delaunay"]["status"] == "ok"
    assert records["tests.broken:right"]["status"] == "ok"
    assert records["tests.broken:right"]["coverage_error"] == 0


@pytest.mark.parametrize(("name", "code"), [("segfault", 4), ("right", 0)])
def test_exit_code_is_4_only_if_nothing_was_measured(block, harness, name, code):
    arguments = ["run", "--scene", str(block), "--out", "out", "--quick", "-q"]
    arguments += ["--rasterisers", MOCK, "--triangulators", f"tests.broken:{name}"]
    assert harness(*arguments)[0] == code


def test_a_module_that_crashes_when_imported_is_imported_by_the_worker_only(
    block, tmp_path, monkeypatch
):
    (tmp_path / "crashing.py").write_text("import os\nos.abort()\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    plan = plan_for(block, triangulators=("crashing:cut", "delaunay"))
    records = run(plan, tmp_path / "out", quiet(), open_worker=Worker).records
    assert {r["triangulator"]: r["status"] for r in records} == {
        "crashing:cut": "failed",
        "delaunay": "ok",
    }
