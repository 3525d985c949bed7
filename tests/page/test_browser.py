"""The measuring page in Chromium on SwiftShader, a rasteriser that shares no code with Mesa."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from harness.metrics.statistics import add_run_scatter, compute_paired_ratio, compute_ranks
from harness.page.page_data import make_page_content, write_page
from harness.page.result import COUNTERS
from harness.rasterisers import Options
from harness.rasterisers.reference import Reference
from harness.results.run_folder import read_run
from tests.chromium import MEASUREMENT_ENDED, REPORT_READY, Chromium
from tests.conftest import require_ok
from tests.page.conftest import measure, read_result
from tests.rasterisers.conftest import random_triangles
from tests.records import get_rows


@pytest.fixture(scope="module")
def page(small_run, tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("page") / "page.html"
    write_page(make_page_content(small_run), file)
    return file


def open_page(browser: Chromium, page: Path) -> None:
    browser.open(page, REPORT_READY, fragment="wait")
    browser.evaluate("PACE.quick = 0.05; $('pace').value = 'quick'; null")


@pytest.fixture(scope="module")
def undisturbed(gpu_browser, page) -> SimpleNamespace:
    open_page(gpu_browser, page)
    result = measure(gpu_browser)
    return SimpleNamespace(
        result=result,
        requests=list(gpu_browser.requests),
        shown=gpu_browser.evaluate("document.body.innerText"),
        device=gpu_browser.evaluate("$('device').innerText"),
        saved=gpu_browser.evaluate("savedText()"),
        address=gpu_browser.evaluate("location.href"),
    )


def test_page_counts_as_expected_and_its_result_is_a_run(undisturbed, harness, small_run, tmp_path):
    result = undisturbed.result
    assert result["problem"] is None
    assert result["complete"]
    assert [len(view["cases"]) for view in result["views"]] == [3, 3]
    controls = {"(empty)", "(reference)", "(the base again)"}
    for view in result["views"]:
        assert {case["differing"] for case in view["cases"].values()} == {0}
        rounds = sum(view["epochs"])
        assert len(view["epochs"]) >= 6
        assert rounds >= 12
        assert {len(times["samples_s"]) for times in view["times"].values()} == {rounds}
        assert set(view["times"]) - set(view["cases"]) == controls
    assert "All counters are the expected ones." in undisturbed.shown
    assert "ear-clipping drawn a second time" in undisturbed.shown
    assert undisturbed.requests == [undisturbed.address.split("#")[0]]

    file = tmp_path / "saved.json"
    file.write_text(undisturbed.saved)
    assert read_result(file).device.vendor == "google"
    run = str(small_run.path)
    require_ok(harness("import", str(file), "--out", "browser", "--run", run))
    records = get_rows(read_run(Path("browser")))
    assert len(records) == 6
    assert all(record["coverage_error"] == 0 for record in records)
    assert all(record["time"]["median_s"] > 0 for record in records)


def test_swiftshader_has_exact_counters_on_its_coarse_grid(undisturbed):
    """Vulkan requires 4 bits of sub-pixel precision; SwiftShader has exactly these."""
    assert undisturbed.result["device"]["step"] == 16
    assert "vertices were moved to this grid" in undisturbed.device


def test_reference_of_the_page_equals_python(browser, page):
    frame, rows = random_triangles(seed=3, size=128, number=200, grid=1)
    expected = Reference().draw_and_count(frame, rows, Options())
    browser.open(page, MEASUREMENT_ENDED)
    fields = {"points": frame.points.ravel().tolist(), "owner": (np.arange(600) // 3).tolist()}
    arguments = f"{json.dumps({**fields, 'polygons': 200})}, {rows.ravel().tolist()}"
    counts = browser.evaluate(f"countExactly({arguments})")
    for name in COUNTERS:
        assert counts[name] == expected[name].tolist()


def test_differing_counters_are_reported(gpu_browser, page):
    open_page(gpu_browser, page)
    gpu_browser.evaluate(
        "{ const exactly = countExactly; countExactly = (frame, rows) => { "
        "const found = exactly(frame, rows); return { ...found, quads: found.fragments }; };"
        "findStep = async () => 16; state.page.views.length = 1; null }"
    )
    result = measure(gpu_browser)
    assert result["views"][0]["cases"]["delaunay"]["differing"] > 0
    assert "Counters differ from the expected ones in" in gpu_browser.read_text("answer")


@pytest.mark.parametrize(
    ("end", "problem", "notice"),
    [
        ("$('stop').click()", "", "Completed measurements are kept"),
        ("seen.destroy()", "lost the GPU", "start again to measure everything"),
    ],
)
def test_measurements_before_a_stop_or_a_lost_device_are_retained(
    gpu_browser, page, end, problem, notice
):
    open_page(gpu_browser, page)
    gpu_browser.evaluate(
        "{ const count = Painter.prototype.count;"
        " Painter.prototype.count = function (...rest) { globalThis.seen = this.device;"
        " return count.apply(this, rest); }; PACE.quick = 60; start(); null }"
    )
    gpu_browser.wait("state.result?.views[0]?.epochs[0] > 1")
    gpu_browser.evaluate(f"{end}; null")
    gpu_browser.wait(MEASUREMENT_ENDED)
    result = json.loads(gpu_browser.evaluate("JSON.stringify(state.result)"))
    assert not result["complete"]
    assert problem in result["problem"] if problem else result["problem"] is None
    (view,) = result["views"]
    assert len(view["cases"]) == 3
    assert sum(view["epochs"]) > 1
    assert notice in gpu_browser.read_text("notice")
    assert not gpu_browser.evaluate("$('save').disabled || $('start').disabled")


@pytest.mark.parametrize("name", ["page", "profile_page"])
def test_page_without_webgpu_names_browsers_with_webgpu(browser, request, name):
    browser.open(request.getfixturevalue(name), MEASUREMENT_ENDED)
    notice = browser.read_text("notice")
    for text in ("WebGPU is in Chrome", "Safari", "Firefox"):
        assert text in notice
    assert browser.evaluate("$('save').disabled")
    assert browser.read_text("answer") == "Nothing was measured."


# Simulated drawings with given costs and noise of 1 %, and a timer with an optional step; only
# drawing advances the clock.
SIMULATED = """
(async () => {
  let now = 0, seed = 1;
  const random = () => { seed = (seed * 16807) % 2147483647; return seed / 2147483647; };
  const step = STEP;
  timing.clock = () => { now += 1e-6; return now; };
  const drawing = (cost) => ({ sample: async (repeats) => {
    const start = now;
    now += cost * repeats * (1 + 0.01 * (random() - 0.5));
    const shown = (at) => (step ? Math.floor(at / step) * step : at);
    return { wall: now - start, gpu: shown(now) - shown(start) };
  } });
  const costs = { "(empty)": 1e-6, "(reference)": 50e-6, a: 100e-6, b: 100e-6 * RATIO };
  const prepare = async (order) => new Map(order.map((name) => [name, drawing(costs[name])]));
  const found = {};
  const settings = { budget_s: 4, min_batch_s: 1e-3, warm_up_s: 0.1 };
  const test = { timer: "gpu", asking_s: 0, resolution_s: step || 1e-9 };
  const names = Object.keys(costs);
  await timeTogether(names, prepare, settings, test, () => {}, () => false, found, random);
  return { ...pairedRatio(found.times.b.samples_s, found.times.a.samples_s, found.epochs),
    epochs: found.epochs.length, rounds: found.times.a.samples_s.length };
})()
"""


def simulate_ratio(browser: Chromium, ratio: float, step: float) -> dict[str, float]:
    return browser.evaluate(SIMULATED.replace("STEP", str(step)).replace("RATIO", str(ratio)))


@pytest.mark.parametrize("ratio", [0.7, 1.0, 1.05])
def test_timer_with_steps_of_100_us_gives_the_same_ratio(browser, page, ratio):
    browser.open(page, MEASUREMENT_ENDED)
    fine = simulate_ratio(browser, ratio, 0)
    coarse = simulate_ratio(browser, ratio, 1e-4)
    assert coarse["epochs"] >= 6
    assert abs(coarse["value"] / fine["value"] - 1) < 0.005
    assert abs(coarse["value"] / ratio - 1) < 0.005
    assert coarse["high"] / coarse["low"] < 1.02


def test_step_of_a_timer_is_detected(browser, page):
    browser.open(page, MEASUREMENT_ENDED)
    assert browser.evaluate("findTimerStep([300000, 500000, 12300000])") == pytest.approx(1e-4)
    assert browser.evaluate("findTimerStep([65536 * 3, 65536 * 8])") == pytest.approx(65.536e-6)
    assert browser.evaluate("findTimerStep([1001, 2003])") == pytest.approx(1e-9)


def test_statistics_of_the_page_equal_python(browser, page):
    """Intervals differ only by the expansion of Student's quantile in JavaScript."""
    browser.open(page, MEASUREMENT_ENDED)
    samples = [1.00, 1.02, 1.01, 1.05, 1.00, 0.99, 1.03, 1.02, 1.01, 1.00, 1.04, 1.02]
    base = [1.01, 1.00, 1.02, 1.01, 0.98, 1.00, 1.01, 1.03, 1.00, 0.99, 1.01, 1.00]
    expected = add_run_scatter(compute_paired_ratio(samples, base, [2] * 6))
    actual = browser.evaluate(f"pairedRatio({samples}, {base}, [2, 2, 2, 2, 2, 2])")
    assert actual["value"] == pytest.approx(expected.value, rel=1e-12)
    assert actual["low"] == pytest.approx(expected.low, abs=1e-4)
    assert actual["high"] == pytest.approx(expected.high, abs=1e-4)
    correlation = browser.evaluate("rankCorrelation([1, 2, 3, 4], [10, 20, 20, 40])")
    assert correlation == pytest.approx(0.9486833)
    assert browser.evaluate("rankCorrelation([0.3, 0.1 + 0.2, 0.3], [1, 2, 3])") is None
    sums = [4, 0.3, 0.1 + 0.2, -1e-300, 1 - 2e-9, 1, 2.0000000050000001, 2.000000005]
    assert browser.evaluate(f"ranks({sums})") == compute_ranks(np.array(sums)).tolist()
