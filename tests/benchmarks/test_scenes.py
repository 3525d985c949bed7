"""Records of every installed scene and triangulator from `run --quick` on llvmpipe."""

from pathlib import Path

import pytest

from harness.results.run_folder import Record, read_run
from scenes.registry import find_entry, names
from tests.paths import run_python
from tests.records import get_rows
from triangulators import names as triangulators
from triangulators.registry import BUILTIN

SCENES = [name for name in names() if find_entry(name).find_install_command() is None]
EXPECTED_REASONS = (
    "holes",
    "no vertex sees the whole polygon",
    "no zigzag stays inside the polygon",
    "more than 1000000 triangulations",
    "vertices",
    "took more than",
)
"""Parts of valid reasons to skip a polygon."""

LIBRARIES = ("ear-clipping", "sweep", "manifold", "delaunay")
"""Triangulators that may leave T-junctions."""


def measure(scene: str, out: Path) -> list[Record]:
    methods = ",".join(name for name in triangulators(available_only=True) if name in BUILTIN)
    command = ["-m", "harness", "run", "--scene", scene, "--quick", "--quiet"]
    command += ["--device", "llvmpipe", "--triangulators", methods, "--out", out]
    process = run_python(*command)
    assert process.returncode == 0, process.stderr
    run = read_run(out)
    assert run.problems == []
    return get_rows(run)


def check(record: Record) -> None:
    name, reason = record["triangulator"], record["reason"] or ""
    is_expected = any(part in reason for part in EXPECTED_REASONS)
    if record["status"] == "skipped":
        assert is_expected, (name, reason)
        return
    assert record["status"] == "ok", (name, reason)
    # polygons that the verifier refuses count as failed
    assert record["polygons_failed"] == 0, (name, reason)
    assert record["polygons_skipped"] == 0 or is_expected, (name, reason)
    assert record["conforming"] or name in LIBRARIES, name
    if record["conforming"]:
        assert record["coverage_error"] == 0, name
        assert record["t_junctions"] == 0, name
    assert record["counters"]["fragments"] > 0
    assert record["time"]["median_s"] > 0


@pytest.mark.parametrize("scene", SCENES)
def test_scene_by_all_triangulators(scene, tmp_path):
    records = measure(scene, tmp_path / "out")
    assert len(records) == len([n for n in triangulators(available_only=True) if n in BUILTIN])
    for record in records:
        check(record)
    assert {r["triangulator"] for r in records if r["status"] == "ok"} >= {
        *("ear-clipping", "delaunay", "greedy", "optimal:overdraw", "worst:overdraw")
    }


def test_all_scenes_are_available():
    missing = [name for name in names() if name not in SCENES]
    assert missing == [], "install what requirements-data.lock pins: make setup"


def test_largest_stress_scene_completes(tmp_path):
    """For a polygon of 100,000 vertices, triangulators that take over a minute are skipped."""
    for record in measure("stress:vertices=100000,family=koch", tmp_path / "out"):
        if record["status"] != "ok":
            check(record)
