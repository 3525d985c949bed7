import json

import pytest

from harness.measuring.records import update_reference_draws
from harness.results.record import Record
from tests.records import make_record


def records(reference_s: float, **changes: object) -> list[Record]:
    """Return two cases timed together, which share reference draws."""
    draws = [reference_s * 0.9, reference_s, reference_s * 1.4]
    time = {"timer": "cpu", "samples_s": draws, "reference_s": draws}
    return [make_record(name, **{"time": time, **changes}) for name in ("fan", "another")]


def test_the_first_run_sets_the_minimum(tmp_path):
    file = tmp_path / "a" / "new" / "draws.json"
    (draw,) = update_reference_draws(records(1e-3), file)
    assert file.is_file()
    view = {"rasteriser": "opengl", "device": "llvmpipe", "resolution": 1024}
    view |= {"samples": 1, "work": 0, "timer": "cpu"}
    assert draw == view | {"reference_s": 1e-3, "best_s": 1e-3, "runs": 1, "slower": 1.0}


def test_slower_runs_have_their_ratio_to_the_minimum(tmp_path):
    file = tmp_path / "draws.json"
    update_reference_draws(records(1e-3), file)
    (slow,) = update_reference_draws(records(2e-3), file)
    assert (slow["slower"], slow["runs"]) == (pytest.approx(2.0), 2)
    (faster,) = update_reference_draws(records(0.5e-3), file)
    assert (faster["best_s"], faster["slower"], faster["runs"]) == (0.5e-3, 1.0, 3)


def test_devices_views_and_machines_have_separate_minima(tmp_path, monkeypatch):
    file = tmp_path / "draws.json"
    update_reference_draws(records(1e-3), file)
    for other in ({"resolution": 256}, {"device": "zink"}, {"options": {"samples": 4, "work": 0}}):
        assert update_reference_draws(records(5e-3, **other), file)[0]["slower"] == 1.0
    other_cpu = {"label": "another"}
    monkeypatch.setattr("harness.measuring.records.describe_processor", lambda: other_cpu)
    assert update_reference_draws(records(5e-3), file)[0]["slower"] == 1.0


@pytest.mark.parametrize("content", ["", "[1]", '{"a": [0, 1]}', '{"a": [1, 0]}', '{"a": 3}', "{"])
def test_damaged_files_are_replaced(content, tmp_path):
    file = tmp_path / "draws.json"
    file.write_text(content)
    assert update_reference_draws(records(1e-3), file)[0]["best_s"] == 1e-3
    assert len(json.loads(file.read_text())) == 1


def test_unwritable_files_are_ignored(tmp_path):
    (tmp_path / "file").write_text("")
    (draw,) = update_reference_draws(records(1e-3), tmp_path / "file" / "draws.json")
    assert (draw["slower"], draw["runs"]) == (1.0, 1)


def test_cases_without_times_have_no_entry(tmp_path):
    assert update_reference_draws(records(1e-3, time=None), tmp_path / "draws.json") == []
