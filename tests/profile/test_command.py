"""The command `profile` on a rasteriser with known costs."""

import json
import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from harness.commands.runs import parse_recipes
from harness.errors import INCONCLUSIVE, NO_RASTERISER, NOTHING_MEASURED
from harness.machine.environment import describe_processor
from harness.profile import advice, design, measured, report
from harness.profile.advice import BASE, CALIBRATED_OPTIMUM, CRITERIA, choose_triangulator
from harness.profile.cost_terms import make_design_rows
from harness.profile.law import DEVIATION_FACTOR
from harness.profile.profile import describe_origin, is_of_this_machine, read_coefficients, read_law
from tests.conftest import assert_one_line, assert_refused, require_ok
from tests.measuring.test_run import inline
from tests.paths import ROOT
from tests.profile.charging import COSTS

MODULE = "tests.profile.charging:"


@pytest.fixture(autouse=True)
def _short_measurements(monkeypatch):
    """Use workers in this process, few processes, and few polygons for the advice."""
    monkeypatch.setattr(measured, "EPOCHS", 6)
    monkeypatch.setattr("harness.worker.Worker", inline)
    monkeypatch.setattr(advice, "SCENES", {"city:buildings=12": ""})
    monkeypatch.setattr(advice, "SCENE_POLYGONS", 8)


def run_profile(harness, rasteriser: str, *more: str) -> tuple[int, str, str]:
    arguments = ("--budget", "0.002", "--out", "p.json", "-q")
    return harness("profile", "--rasteriser", MODULE + rasteriser, *arguments, *more)


def test_profile_reports_the_known_costs(harness):
    out, _ = require_ok(run_profile(harness, "Charger"))
    assert out.startswith(
        f"On scripted, on {describe_processor()['label']}:\nA draw by itself costs 20 us."
    )
    assert "\nA triangle costs 50 ns" in out
    assert "Each pixel of a triangle's width and height costs 7 ns." in out
    assert "No significant cost: triangles set up, triangles that cover a pixel" in out
    assert "on city:buildings=12 (" in out
    content = json.loads(Path("p.json").read_text())
    for term in content["terms"]:
        assert term["cost"] == pytest.approx(COSTS.get(term["name"], 0.0), rel=0.01, abs=1e-13)
        assert term["shown"] == (term["name"] in COSTS)
    assert content["form"] == "sum"
    assert content["errors"]["sum"] == min(content["errors"].values())
    assert content["r2_over"] > 0.999
    assert content["r2_within"] > 0.999
    assert not content["refused"]
    thin = content["aspects"][0]
    assert thin["ratios"][0] == 1
    assert thin["ratios"] == sorted(thin["ratios"])
    assert content["second_filling"] == pytest.approx({"4 px": 1.0, "32 px": 1.0}, abs=1e-3)
    for draw in content["times"]:
        counts = {**draw["counters"], "draw": 1}
        counts["half_perimeter"] /= 256
        expected = sum(cost * counts[name] for name, cost in COSTS.items())
        assert draw["epochs"][0] == pytest.approx(expected, rel=1e-4)
    assert Path("p.png").stat().st_size > 10_000
    coefficients = read_coefficients(Path("p.json"))
    assert coefficients["half_perimeter"] == pytest.approx(COSTS["half_perimeter"], rel=0.2)
    (recipe,) = parse_recipes((CALIBRATED_OPTIMUM,), 0, Path("p.json"))
    assert dict(recipe.calibration or ()) == coefficients


def test_draws_are_snapped_to_a_coarser_grid(harness):
    require_ok(run_profile(harness, "CoarseCharger"))
    content = json.loads(Path("p.json").read_text())
    checksums = {draw["checksum"] for draw in content["times"]}
    assert checksums == {design.snap_draw(draw, 16).checksum for draw in design.make_draws(0)}


def test_profile_of_a_machine_that_slows_down_is_refused(harness, monkeypatch):
    monkeypatch.setattr(measured, "EPOCHS", 12)
    monkeypatch.setattr(advice, "recommend_triangulator", lambda *_: None)
    monkeypatch.setattr("harness.profile.report.draw_chart", lambda *_: "none")
    code, out, err = run_profile(harness, "DriftingCharger")
    assert code == INCONCLUSIVE
    assert_one_line(err, "the machine's speed changed by a factor of")
    assert "A draw by itself" in out
    assert not Path("p.json").exists()
    assert Path("p.refused.json").exists()


def test_too_slow_device_is_an_error(harness, monkeypatch):
    timing = replace(measured.make_profile_timing(0.002, 1), limit_s=0)
    monkeypatch.setattr(measured, "make_profile_timing", lambda *_: timing)
    result = run_profile(harness, "Charger")
    assert_refused(result, "too slow (1 of 6 epochs in 0 s, and a fit needs", code=INCONCLUSIVE)
    assert not list(Path().iterdir())


def test_fewer_parts_are_a_warning(harness, monkeypatch):
    """Without matplotlib there is no picture."""
    monkeypatch.setattr(advice, "recommend_triangulator", lambda *_: None)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    measure = measured.measure_draws

    def measure_five_parts(*arguments):
        times = measure(*arguments)
        return replace(times, rounds=times.rounds[:5])

    monkeypatch.setattr(measured, "measure_draws", measure_five_parts)
    out, err = require_ok(run_profile(harness, "Charger"))
    assert out.splitlines()[-1] == "profile: p.json"
    assert "warning: slow device: 5 of 6 epochs in 100 s, so intervals are wide" in err


def test_the_time_limit_follows_from_the_budget():
    assert measured.make_profile_timing(0.5, 126).limit_s == 126
    assert measured.make_profile_timing(0.1, 126).limit_s == measured.MIN_LIMIT_S
    timing = measured.make_profile_timing(0.5, 126)
    assert (timing.processes, timing.epochs) == (measured.EPOCHS, 1)
    assert timing.processes * timing.budget_s == pytest.approx(0.5)


def test_unusable_devices_are_refused_in_one_line(harness):
    missing = run_profile(harness, "MissingCharger")
    assert_refused(missing, "no usable device found", code=NO_RASTERISER)
    assert_refused(run_profile(harness, "Charger", "--device", "none"), "none")
    failing = run_profile(harness, "FailingCharger")
    assert_refused(failing, "the device is gone", code=NOTHING_MEASURED)
    assert not list(Path().iterdir())


def make_costs(**ratios: float) -> Mapping[str, np.ndarray]:
    """Return the seconds of eight polygons by triangulator, as ratios to the calibrated one."""
    calibrated = np.linspace(1.0, 2.0, 8)
    names = dict(zip(CRITERIA.values(), CRITERIA, strict=True))
    others = {names[letter]: ratio * calibrated for letter, ratio in ratios.items()}
    return {CALIBRATED_OPTIMUM: calibrated, BASE: 1.25 * calibrated, **others}


def test_criterion_is_preferred_if_as_good_as_the_calibrated_one():
    costs = make_costs(H=1.004, Q=1.002, A=1.1)
    recommendation = choose_triangulator({"one": costs, "two": costs})
    assert recommendation["triangulator"] == "optimal:expected-quads"
    assert recommendation["regret"]["optimal:overdraw"] == pytest.approx(0.1)
    assert recommendation["saved"]["one"][0] == pytest.approx(1 - 1.002 / 1.25)
    calibrated = choose_triangulator({"one": make_costs(H=1.02, Q=1.03, A=1.1)})
    assert calibrated["triangulator"] == CALIBRATED_OPTIMUM


def test_seconds_have_readable_units():
    texts = [report.format_seconds(value) for value in (0, 5.3e-8, 1.94e-9, 2e-13, 0.25)]
    assert texts == ["0 s", "53 ns", "1.9 ns", "0.2 ps", "250 ms"]


def test_interval_of_a_saving_covers_the_true_share():
    """Costs simulated with the stored covariance, widened as intervals are."""
    law = read_law(GOOD)
    rows = [row["counters"] for row in GOOD["times"] if row["kind"] == "aspect"]
    base, spent = make_design_rows([rows[-1], rows[0]])
    rng, covered = np.random.default_rng(0), 0
    truth = 1 - spent @ law.signed_costs / (base @ law.signed_costs)
    covariance = DEVIATION_FACTOR**2 * law.covariance
    for costs in rng.multivariate_normal(law.signed_costs, covariance, 400):
        simulated = replace(law, signed_costs=costs, costs=costs)
        low, high = simulated.compute_saved_interval(spent, base, costs)
        covered += low <= truth <= high
    assert 0.93 <= covered / 400 <= 0.99


def test_inspect_warns_about_a_profile_of_another_machine(harness, monkeypatch):
    cpu = GOOD["device"]["cpu"]
    for label in (cpu, "another CPU"):
        facts = {"label": label}
        monkeypatch.setattr("harness.profile.profile.describe_processor", lambda facts=facts: facts)
        command = ("inspect", "paper", "--sizes", "64", "--profile", "opengl-llvmpipe")
        _, err = require_ok(harness(*command))
        warning = f"measured on another machine (llvmpipe, on {cpu})"
        assert (warning in err) is (label != cpu)
    gpu = {"name": "gpu0", "rasteriser": "os:system", "details": {"renderer": "NVIDIA H200/PCIe"}}
    assert (describe_origin(gpu), is_of_this_machine(gpu)) == ("NVIDIA H200", False)
    kind = SimpleNamespace(devices=lambda: [SimpleNamespace(details=gpu["details"])])
    monkeypatch.setattr("harness.rasterisers.get", lambda name: kind)
    assert is_of_this_machine({**gpu, "rasteriser": "opengl"})


GOOD = json.loads((ROOT / "results/reference/profiles/opengl-llvmpipe.json").read_text())
EQUAL_COSTS = {"terms": [{**term, "cost": 1e-9} for term in GOOD["terms"]]}


def set_cost(cost: object) -> dict[str, object]:
    return {"terms": [{**EQUAL_COSTS["terms"][0], "cost": cost}, *EQUAL_COSTS["terms"][1:]]}


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        *((set_cost(cost), "cost of draw") for cost in (math.nan, math.inf, -1e-9, 1e300, "1")),
        (set_cost(True), "cost of draw"),
        ({"terms": [{**term, "cost": 0.0} for term in GOOD["terms"]]}, "all terms are 0"),
        ({"terms": GOOD["terms"][1:]}, "names of the terms differ"),
        ({"coefficients": {**GOOD["coefficients"], "triangles": math.nan}}, "cost of triangles"),
        ({"coefficients": dict.fromkeys(GOOD["coefficients"], 0)}, "coefficients are 0"),
        ({"format": "another"}, "unsupported format 'another'"),
        ({"version": 1}, "unsupported version 1 (supported: 2); create the profile again"),
        ({"form": "a product"}, "unknown form 'a product' (choose from sum, maximum of two"),
        ({"version": True}, "unsupported version True"),
        ({"unit": "ms"}, "unsupported unit 'ms'"),
        ({"device": {"name": "GPU\nIt does not matter"}}, "device.name is not a line"),
        ({"device": {"name": "GPU", "cpu": "\x1b[2J"}}, "device.cpu is not a line"),
    ],
)
def test_profile_with_impossible_values_is_refused(harness, change, problem):
    file = Path("p.json")
    file.write_text(json.dumps(GOOD))
    assert read_coefficients(file) == GOOD["coefficients"]
    file.write_text(json.dumps({**GOOD, **change}))
    run = ("run", "--scene", "paper", "--triangulators", "optimal:calibrated")
    assert_refused(
        harness("inspect", "paper", "--sizes", "64", "--profile", "p.json"), problem, "p.json"
    )
    assert_refused(harness(*run, "--profile", "p.json"), problem, "p.json")


def test_cost_that_no_draws_determine_is_unknown():
    """The scan of bounding boxes does no arithmetic, so its draws do not determine that cost."""
    file = ROOT / "results/reference/profiles/bounding-box-llvmpipe.json"
    table = report.make_table(json.loads(file.read_text()))
    rows = list(zip(*(column.cells for column in table.columns), strict=True))
    assert [row for row in rows if "unknown" in row] == [
        ("rounds of arithmetic", "all", "unknown", "-")
    ]
