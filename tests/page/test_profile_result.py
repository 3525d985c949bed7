"""Import of the file of a profiling page, and refusal of inconsistent files."""

import functools
import json
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from harness.errors import INCONCLUSIVE
from harness.page.profile_result import FORMAT
from harness.profile import advice, design, report
from harness.profile.cost_terms import count_draw
from harness.profile.placing import Draw
from harness.profile.profile import read_coefficients
from tests.conftest import assert_refused, require_ok
from tests.measuring.test_run import inline
from tests.page.conftest import write_saved
from tests.page.test_hostile import MARKUP, add_markup
from tests.profile.charging import COSTS

DRAWS = functools.cache(design.make_draws)
COUNTED: dict[tuple[int, int], dict[str, int]] = {}


def count_once(draw: Draw) -> dict[str, int]:
    """Return the counters of a draw, cached by checksum for all tests."""
    key = draw.checksum, draw.work
    if key not in COUNTED:
        COUNTED[key] = count_draw(draw)
    return dict(COUNTED[key])


@pytest.fixture(autouse=True)
def _short_measurements(monkeypatch):
    """Make and count draws once, use workers in this process and few polygons for the advice."""
    monkeypatch.setattr(design, "make_draws", DRAWS)
    monkeypatch.setattr("harness.page.profile_result.count_draw", count_once)
    monkeypatch.setattr("harness.worker.Worker", inline)
    monkeypatch.setattr(advice, "SCENES", {"city:buildings=12": ""})
    monkeypatch.setattr(advice, "SCENE_POLYGONS", 8)


@pytest.fixture
def saved(profiled, tmp_path) -> Callable[..., str]:
    """Return a function that writes the page's file, changed by a function, with a valid digest."""

    def write(change: Callable[[dict[str, Any]], object] = lambda result: None) -> str:
        result = deepcopy(profiled["result"])
        change(result)
        return str(write_saved(result, tmp_path / "saved.json", FORMAT))

    return write


def test_file_of_the_page_becomes_a_profile(harness, profiled):
    Path("saved.json").write_text(profiled["saved"])
    command = ("import", "saved.json", "--out", "p.json", "--device", "my phone")
    out, err = require_ok(harness(*command))
    assert err == ""
    assert out.startswith("On my-phone:\nA draw by itself costs 20 us.\nA triangle costs 50 ns")
    content = json.loads(Path("p.json").read_text())
    for term in content["terms"]:
        assert term["cost"] == pytest.approx(COSTS.get(term["name"], 0.0), rel=0.01, abs=1e-12)
    assert content["device"]["rasteriser"] == "webgpu"
    assert not content["device"]["software"]
    assert content["device"]["timer"]["timer"] == "wall"
    assert sum(content["rounds"]) == sum(profiled["result"]["epochs"])
    expected = pytest.approx(profiled["coefficients"], rel=0.01, abs=1e-12)
    assert list(read_coefficients(Path("p.json")).values()) == expected
    assert Path("p.png").stat().st_size > 10_000


@pytest.mark.parametrize("name", ["llvmpipe (LLVM 15.0.7)", "Microsoft Basic Render Driver"])
def test_software_adapter_is_recorded_as_software(harness, saved, name):
    file = saved(lambda result: result["device"].update(description=name))
    assert harness("import", file, "--out", "p.json")[0] == 0
    assert json.loads(Path("p.json").read_text())["device"]["software"]


def times(result: dict[str, Any], name: str) -> list[float]:
    return result["times"][name]["samples_s"]


def slow_down(result: dict[str, Any], first: int) -> None:
    for draw in result["times"].values():
        draw["samples_s"][first:] = [2 * value for value in draw["samples_s"][first:]]


def truncate_epochs(number: int) -> Callable[[dict[str, Any]], None]:
    def change(result: dict[str, Any]) -> None:
        del result["epochs"][number:]
        for draw in result["times"].values():
            del draw["samples_s"][sum(result["epochs"]) :]

    return change


def miscount(result: dict[str, Any]) -> None:
    result["draws"][3]["quads"] += 1


FORGERIES: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "design": (lambda r: r["page"].update(design=2), "measured with version 2 of"),
    "seed": (lambda r: r["page"].update(seed=1), "the draws differ from the draws of seed 1"),
    "checksum": (lambda r: r["draws"][3].update(checksum=5), "differ from the draws of seed 0"),
    "grid": (lambda r: r["device"].update(step=16), "differ from the draws of seed 0"),
    "draws": (lambda r: r["draws"].pop(), "differ from the draws of seed 0"),
    "counter": (miscount, "differ from the exact reference in 1 draws, not in 0"),
    "differing": (lambda r: r.update(differing=2), "in 0 draws, not in 2"),
    "quads": (lambda r: r["draws"][3].update(quads=1), "more than four"),
    "law": (lambda r: r["law"]["seconds"].update(triangles=6e-8), "does not follow from the times"),
    "terms": (lambda r: r["law"]["seconds"].pop("near"), "unknown terms or form"),
    "times": (lambda r: slow_down(r, 0), "does not follow from the times"),
    "rounds": (lambda r: times(r, "40").pop(), "draws have different numbers of rounds"),
    "zero": (lambda r: times(r, "40").__setitem__(0, 0.0), "a draw took no time"),
    "negative": (lambda r: times(r, "40").__setitem__(0, -1.0), "greater than or equal to 0"),
    "missing": (lambda r: r["times"].pop("40"), "timed draws are not the 183 draws"),
    "strange": (lambda r: r["times"].update(x=r["times"]["4"]), "timed draws are not the 183"),
    "few": (truncate_epochs(3), "after 3 of at least 4 epochs"),
    "untimed": (lambda r: r.update(times=None, epochs=[], law=None), "after 0 of at least 4"),
    "no timer": (lambda r: r.update(timer=None), "too few for a fit"),
    "field": (lambda r: r.update(more=1), "more: Extra inputs are not permitted"),
    "lacking": (lambda r: r.pop("draws"), "draws: Field required"),
}


@pytest.mark.parametrize("name", FORGERIES)
def test_inconsistent_results_are_refused_in_one_line(harness, saved, name):
    change, message = FORGERIES[name]
    result = harness("import", saved(change))
    assert_refused(result, message)
    assert result[1] == ""
    assert not Path("results").exists()


def test_options_for_runs_are_refused(harness, saved):
    result = harness("import", saved(), "--summary", "s.json")
    assert_refused(result, "--run and --summary are only for runs")


def test_problems_of_the_page_are_reported(harness, saved):
    def change(result: dict[str, Any]) -> None:
        truncate_epochs(5)(result)
        result |= {"complete": False, "problem": "The browser lost\nthe GPU.", "hidden": True}
        result["limited"], result["law"] = True, None

    _, err = require_ok(harness("import", saved(change)))
    for part in ("a problem: The browser lost the GPU.", "was stopped", "hidden", "time limit"):
        assert part in err
    assert Path("results/profiles/webgpu-a-test-s-gpu-chrome.json").exists()


def test_profile_of_a_device_that_slowed_down_is_refused(harness, saved):
    def change(result: dict[str, Any]) -> None:
        slow_down(result, sum(result["epochs"]) // 2)
        result["law"] = None

    result = harness("import", saved(change), "--out", "p.json")
    assert_refused(result, "speed changed by a factor of 2", code=INCONCLUSIVE)
    assert Path("p.refused.json").exists()


def test_markup_in_names_is_escaped(harness, saved):
    def change(result: dict[str, Any]) -> None:
        for part in ("device", "browser", "started", "ended", "timer"):
            result[part] = add_markup(result[part], "")

    out, _ = require_ok(harness("import", saved(change), "--out", "profiles/p.json"))
    assert MARKUP not in out
    assert MARKUP not in Path("profiles/p.svg").read_text()
    rows = report.make_devices_table(Path("profiles"))[1]
    assert "<" not in "".join(rows[0])
