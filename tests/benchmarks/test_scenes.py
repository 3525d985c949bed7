"""Every scene by every triangulator through `run --quick`, on llvmpipe: what each record says.

Scenes of other people's data are measured where those data are installed (`make setup` does).
"""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from harness.results.run_folder import Record, read_run
from scenes import load
from scenes.registry import entry, names
from tests.paths import ROOT
from tests.records import lines_of
from triangulators import names as triangulators
from triangulators.registry import BUILTIN

SCENES = [name for name in names() if entry(name).available() is None]
BY_DESIGN = (
    "holes",
    "no vertex sees the whole polygon",
    "no zigzag stays inside the polygon",
    "more than 1000000 triangulations",
    "vertices",
    "took more than",
)
"""What a triangulator may say of a polygon that it does not do."""

LIBRARIES = ("ear-clipping", "sweep", "manifold", "delaunay")
"""They may leave T-junctions; ours may not."""

MODEL = """o hexagon
v 0 0 0
v 4 0 0
v 6 3 0
v 4 6 0
v 0 6 0
v -2 3 0
f 1 2 3 4 5 6
o pentagon
v 10 0 1
v 14 0 1
v 14 0 5
v 12 0 3
v 10 0 5
f 7 8 9 10 11
"""


def measured(scene: str, out: Path) -> list[Record]:
    chosen = ",".join(name for name in triangulators(available_only=True) if name in BUILTIN)
    command = [sys.executable, "-m", "harness", "run", "--scene", scene, "--quick", "--quiet"]
    command += ["--device", "llvmpipe", "--triangulators", chosen, "--out", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    run = read_run(out)
    assert run.problems == []
    seconds = run.facts["seconds"]
    print(
        f"\n{scene}: {run.facts['scene']['polygons']} polygons, {seconds['all']:.0f} s in all, "
        f"{seconds['triangulate']:.0f} s of it triangulating"
    )
    return lines_of(run)


def check(record: Record) -> None:
    """A case was drawn and is right, or was skipped for a reason that is known."""
    name, reason = record["triangulator"], record["reason"] or ""
    known = any(part in reason for part in BY_DESIGN)
    if record["status"] == "skipped":
        print(f"  {name:24} skipped: {reason}")
        assert known, (name, reason)
        return
    print(
        f"  {name:24} {record['polygons']:6} drawn {record['polygons_skipped']:6} skipped "
        f"{record['triangulate_s']:8.3f} s {record['t_junctions']:4} T-junctions, "
        f"{record['coverage_error']} px wrong"
    )
    assert record["status"] == "ok", (name, reason)
    # what the verifier refuses is a failed polygon
    assert record["polygons_failed"] == 0, (name, reason)
    assert record["polygons_skipped"] == 0 or known, (name, reason)
    assert record["conforming"] or name in LIBRARIES, name
    if record["conforming"]:
        assert record["coverage_error"] == 0, name
        assert record["t_junctions"] == 0, name
    assert record["counters"]["fragments"] > 0
    assert record["time"]["median_s"] > 0


@pytest.mark.parametrize("scene", SCENES)
def test_a_scene_by_all(scene, tmp_path):
    records = measured(scene, tmp_path / "out")
    assert len(records) == len([n for n in triangulators(available_only=True) if n in BUILTIN])
    for record in records:
        check(record)
    assert {r["triangulator"] for r in records if r["status"] == "ok"} >= {
        *("ear-clipping", "delaunay", "greedy", "optimal:overdraw", "worst:overdraw")
    }


def test_all_scenes_of_the_list_were_there():
    missing = [name for name in names() if name not in SCENES]
    assert missing == [], "install what requirements-data.lock pins: make setup"


def test_a_model_of_a_users(tmp_path):
    (tmp_path / "faces.obj").write_text(MODEL)
    records = measured(f"meshes:model={tmp_path / 'faces.obj'}", tmp_path / "out")
    for record in records:
        check(record)
    done = {record["triangulator"]: record for record in records}
    assert done["optimal:overdraw"]["triangles"] == 4 + 3


def test_the_largest_stress_scene_ends(tmp_path):
    """100,000 vertices in a polygon: what cannot be done in a minute says so."""
    for record in measured("stress:vertices=100000,family=koch", tmp_path / "out"):
        if record["status"] == "ok":
            print(f"  {record['triangulator']:24} {record['triangulate_s']:.1f} s")
        else:
            check(record)


def test_ten_thousand_buildings_take_seconds():
    start = time.perf_counter()
    scene = load("city", buildings=10_000)
    assert len(scene.polygons) == 10_000
    assert time.perf_counter() - start < 15  # about 1 s on an idle core
