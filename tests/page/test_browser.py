"""The page in Chromium, on SwiftShader: a rasteriser that shares no code with Mesa."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from harness.page.page_data import content_of, write_page
from harness.page.result import TOLD
from harness.rasterisers import Options
from harness.rasterisers.reference import Reference
from harness.results.run_folder import read_run
from tests.chromium import MEASUREMENT_ENDED, REPORT_READY, Chromium
from tests.conftest import require_ok
from tests.page.conftest import measure, read_result
from tests.rasterisers.conftest import random_triangles
from tests.records import lines_of


@pytest.fixture(scope="module")
def page(small_run, tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("page") / "page.html"
    write_page(content_of(small_run), file)
    return file


def opened(browser: Chromium, page: Path) -> None:
    """Open the page without having it begin by itself, and let it be quick."""
    browser.open(page, REPORT_READY, fragment="wait")
    browser.evaluate("PACE.quick = 0.05; $('pace').value = 'quick'; null")


@pytest.fixture(scope="module")
def whole(gpu_browser, page) -> SimpleNamespace:
    """A measurement that nobody disturbed, and what the page showed, saved and asked for."""
    opened(gpu_browser, page)
    result = measure(gpu_browser)
    asked = {"shown": "document.body.innerText", "device": "$('device').innerText"}
    asked |= {"saved": "savedText()", "address": "location.href"}
    told = {name: gpu_browser.evaluate(text) for name, text in asked.items()}
    return SimpleNamespace(result=result, requests=list(gpu_browser.requests), **told)


def test_it_counts_as_expected_and_its_result_is_a_run(whole, harness, small_run, tmp_path):
    result = whole.result
    assert result["problem"] is None
    assert result["complete"]
    assert [len(view["cases"]) for view in result["views"]] == [3, 3]
    for view in result["views"]:
        for case in view["cases"].values():
            assert case["differing"] == 0
        rounds = sum(view["epochs"])
        assert len(view["epochs"]) >= 6
        assert rounds >= 12
        assert {len(times["samples_s"]) for times in view["times"].values()} == {rounds}
        assert set(view["times"]) - set(view["cases"]) == {
            "(empty)",
            "(reference)",
            "(the base again)",
        }
    assert "All counters are the expected ones." in whole.shown
    assert "ear-clipping drawn a second time" in whole.shown
    assert whole.requests == [whole.address.split("#")[0]]

    file = tmp_path / "saved.json"
    file.write_text(whole.saved)
    assert read_result(file).device.vendor == "google"
    run = str(small_run.path)
    require_ok(harness("import", str(file), "--out", "browser", "--run", run))
    records = lines_of(read_run(Path("browser")))
    assert len(records) == 6
    assert all(record["coverage_error"] == 0 for record in records)
    assert all(record["time"]["median_s"] > 0 for record in records)


def test_swiftshader_has_a_coarse_grid_and_is_exact_on_it(whole):
    """Vulkan asks for 4 bits of sub-pixel precision, and SwiftShader has no more."""
    assert whole.result["device"]["step"] == 16
    assert "moved to it first" in whole.device


def test_the_pages_reference_is_ours(browser, page):
    frame, rows = random_triangles(seed=3, size=128, number=200, grid=1)
    expected = Reference().count(frame, rows, Options())
    browser.open(page, MEASUREMENT_ENDED)
    made = {"points": frame.points.ravel().tolist(), "owner": (np.arange(600) // 3).tolist()}
    given = f"{json.dumps({**made, 'polygons': 200})}, {rows.ravel().tolist()}"
    counted = browser.evaluate(f"countExactly({given})")
    for name in TOLD:
        assert counted[name] == expected[name].tolist()


def test_counters_that_differ_are_said(gpu_browser, page):
    opened(gpu_browser, page)
    gpu_browser.evaluate(
        "{ const exactly = countExactly; countExactly = (frame, rows) => { "
        "const found = exactly(frame, rows); return { ...found, quads: found.fragments }; };"
        "findStep = async () => 16; state.page.views.length = 1; null }"
    )
    result = measure(gpu_browser)
    assert result["views"][0]["cases"]["delaunay"]["differing"] > 0
    assert "Counters differ from the expected ones in" in gpu_browser.evaluate(
        "$('answer').textContent"
    )


def test_a_stop_keeps_what_was_measured(gpu_browser, page):
    opened(gpu_browser, page)
    gpu_browser.evaluate("PACE.quick = 60; start(); null")
    gpu_browser.wait("state.result?.views[0]?.epochs[0] > 1")
    gpu_browser.evaluate("$('stop').click(); null")
    gpu_browser.wait(MEASUREMENT_ENDED)
    result = json.loads(gpu_browser.evaluate("JSON.stringify(state.result)"))
    assert not result["complete"]
    assert result["problem"] is None
    assert len(result["views"]) == 1
    assert sum(result["views"][0]["epochs"]) > 1
    assert not gpu_browser.evaluate("$('save').disabled")
    assert "What was measured is kept" in gpu_browser.evaluate("$('notice').textContent")


def test_a_lost_device_keeps_what_was_measured(gpu_browser, page):
    opened(gpu_browser, page)
    gpu_browser.evaluate(
        "{ const make = Painter; globalThis.seen = null;"
        " const count = Painter.prototype.count;"
        " Painter.prototype.count = function (...rest) { globalThis.seen = this.device;"
        " return count.apply(this, rest); }; PACE.quick = 60; start(); null }"
    )
    gpu_browser.wait("state.result?.views[0]?.epochs[0] > 1")
    gpu_browser.evaluate("seen.destroy(); null")
    gpu_browser.wait(MEASUREMENT_ENDED)
    result = json.loads(gpu_browser.evaluate("JSON.stringify(state.result)"))
    assert "lost the GPU" in result["problem"]
    assert len(result["views"][0]["cases"]) == 3
    assert sum(result["views"][0]["epochs"]) > 1
    assert "start again for the rest" in gpu_browser.evaluate("$('notice').textContent")
    assert not gpu_browser.evaluate("$('start').disabled")


def test_without_webgpu_it_says_which_browsers_have_it(browser, page):
    browser.open(page, MEASUREMENT_ENDED)
    notice = browser.evaluate("$('notice').textContent")
    assert "WebGPU" in notice
    for name in ("Chrome", "Safari", "Firefox"):
        assert name in notice
    assert browser.evaluate("$('save').disabled")
    assert browser.evaluate("$('answer').textContent") == "Nothing was measured."


# Drawings in a world where time passes only as they say: with a cost of their own, noise of 1 %,
# and a timer that may show multiples of a step alone.
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


def simulated(browser: Chromium, ratio: float, step: float) -> dict[str, float]:
    return browser.evaluate(SIMULATED.replace("STEP", str(step)).replace("RATIO", str(ratio)))


@pytest.mark.parametrize("ratio", [0.7, 1.0, 1.05])
def test_a_timer_of_100_us_steps_tells_the_same_ratio(browser, page, ratio):
    browser.open(page, MEASUREMENT_ENDED)
    fine = simulated(browser, ratio, 0)
    coarse = simulated(browser, ratio, 1e-4)
    assert coarse["epochs"] >= 6
    assert abs(coarse["value"] / fine["value"] - 1) < 0.005
    assert abs(coarse["value"] / ratio - 1) < 0.005
    assert coarse["high"] / coarse["low"] < 1.02


def test_a_timers_step_is_found(browser, page):
    browser.open(page, MEASUREMENT_ENDED)
    assert browser.evaluate("stepOf([300000, 500000, 12300000])") == pytest.approx(1e-4)
    assert browser.evaluate("stepOf([65536 * 3, 65536 * 8])") == pytest.approx(65.536e-6)
    assert browser.evaluate("stepOf([1001, 2003])") == pytest.approx(1e-9)


def test_figures_equal_ours(browser, page):
    """The page's interval is Python's, to what the expansion of Student's quantile leaves out."""
    from harness.metrics.per_polygon import ranks
    from harness.stats.intervals import of_any_run, paired_ratio

    browser.open(page, MEASUREMENT_ENDED)
    samples = [1.00, 1.02, 1.01, 1.05, 1.00, 0.99, 1.03, 1.02, 1.01, 1.00, 1.04, 1.02]
    base = [1.01, 1.00, 1.02, 1.01, 0.98, 1.00, 1.01, 1.03, 1.00, 0.99, 1.01, 1.00]
    ours = of_any_run(paired_ratio(samples, base, [2] * 6))
    theirs = browser.evaluate(f"pairedRatio({samples}, {base}, [2, 2, 2, 2, 2, 2])")
    assert theirs["value"] == pytest.approx(ours.value, rel=1e-12)
    assert theirs["low"] == pytest.approx(ours.low, abs=1e-4)
    assert theirs["high"] == pytest.approx(ours.high, abs=1e-4)
    assert browser.evaluate("rankCorrelation([1, 2, 3, 4], [10, 20, 20, 40])") == pytest.approx(
        0.9486833
    )
    assert browser.evaluate("rankCorrelation([0.3, 0.1 + 0.2, 0.3], [1, 2, 3])") is None
    sums = [4, 0.3, 0.1 + 0.2, -1e-300, 1 - 2e-9, 1, 2.0000000050000001, 2.000000005]
    assert browser.evaluate(f"ranks({sums})") == ranks(np.array(sums)).tolist()
