"""History of a device's profiles: what each costs, and where that changed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import BAD_INPUT
from harness.history import find_runs, read_series
from harness.history.profiles import is_profile
from harness.profile.profile import FORMAT
from tests.harness.test_cli import assert_one_line

pytestmark = pytest.mark.usefixtures("no_plots")


def write(folder: Path, day: int, **costs: float | None) -> Path:
    """Write a profile with seconds of some terms, None for a cost that is not shown."""
    terms = [
        {"name": name, "seconds": value or 0.0, "shown": value is not None}
        for name, value in costs.items()
    ]
    device = {"rasteriser": "opengl", "name": "gpu", "software": False, "cpu": ""}
    content = {
        "format": FORMAT,
        "design": 1,
        "seed": 0,
        "refused": False,
        "device": {**device, "created": f"2026-01-{day:02d}T00:00:00Z"},
        "terms": terms,
    }
    # Names that sort in another order than they were made.
    file = folder / f"{99 - day}.json"
    file.write_text(json.dumps(content))
    return file


@pytest.fixture
def kept(tmp_path) -> Path:
    """Eight profiles: from the fifth on a triangle costs a quarter more; lanes once nothing."""
    for day in range(1, 9):
        noise = 1 + 0.002 * (-1) ** day
        triangles = 2e-9 * noise * (1.25 if day > 4 else 1.0)
        write(tmp_path, day, triangles=triangles, helper_lanes=1e-11 if day != 3 else None)
    return tmp_path


def test_a_cost_that_changed_is_found_where_it_changed(kept):
    found = {each.name.triangulator: each for each in read_series(find_runs([kept]).runs)}
    assert found["triangles"].changes == (4,)
    assert found["triangles"].values[0] == pytest.approx(1.996)
    assert found["helper lanes"].changes == ()
    assert np.isnan(found["helper lanes"].values).nonzero()[0].tolist() == [2]


def test_the_command_says_it(harness, kept):
    code, out, err = harness("history", str(kept), "--out", "h")
    assert code == 0, err
    assert "cost_ns of triangles, profile 1024 px, opengl on gpu: 2 → 2.5 (+25" in out
    assert "cost_ns,triangles" in Path("h/history.csv").read_text()


def test_another_processor_begins_anew(tmp_path):
    for day in range(1, 9):
        file = write(tmp_path, day, triangles=2e-9 * (2.0 if day > 4 else 1.0))
        content = json.loads(file.read_text())
        content["device"] |= {"software": True, "cpu": "old" if day <= 4 else "new"}
        file.write_text(json.dumps(content))
    (series,) = read_series(find_runs([tmp_path]).runs)
    assert series.changes == ()


def test_only_profiles_are_profiles(kept, tmp_path):
    (tmp_path / "other.json").write_text("{}")
    (tmp_path / "folder.json").mkdir()
    assert not is_profile(tmp_path / "other.json")
    assert not is_profile(tmp_path / "folder.json")
    assert len(find_runs([kept]).runs) == 8


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.pop("terms"), "is a damaged profile: KeyError"),
        (lambda content: content["terms"][0].update(name="luck"), "is a damaged profile"),
        (lambda content: content["terms"][0].update(seconds="much"), "is a damaged profile"),
    ],
)
def test_what_is_damaged_is_one_line(harness, kept, change, message):
    file = kept / "98.json"
    content: dict[str, Any] = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))
    code, _, err = harness("history", str(kept))
    assert code == BAD_INPUT
    assert_one_line(err, message)


def test_what_was_refused_is_left_out_and_told(harness, kept):
    (kept / "98.json").rename(kept / "98.refused.json")
    file = kept / "98.refused.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "refused": True}))
    code, out, err = harness("history", str(kept), "--out", "h")
    assert code == 0, err
    assert "98.refused.json was refused when it was made: left out" in out
    assert "→ 2.5" in out


def test_profiles_lie_in_folders_and_are_written_in_any_way(kept):
    (kept / "2025").mkdir()
    file = kept / "98.json"
    content = json.loads(file.read_text())
    file.unlink()
    (kept / "2025" / "98.json").write_text(json.dumps(content, separators=(",", ":")))
    assert len(find_runs([kept]).runs) == 8
