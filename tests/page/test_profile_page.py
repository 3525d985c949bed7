"""The profiling page, on a simulated GPU with known costs and on SwiftShader."""

import json
from pathlib import Path

import numpy as np
import pytest

from harness.measuring.timing import EMPTY, Times
from harness.metrics.statistics import Ratio, compute_mean_interval
from harness.page.page_data import GRID_STEPS
from harness.profile import design, law
from harness.profile.advice import CRITERIA, compare_aspects
from harness.profile.cost_terms import TERMS, count_draw, fit_coefficients, make_design_rows
from harness.profile.law import COSTS as CRITERIA_TERMS
from harness.profile.measured import CONTROL, DrawTimes, normalise_times
from harness.profile.report import format_seconds
from tests.chromium import REPORT_READY, Chromium
from tests.conftest import assert_refused, require_ok
from tests.measuring.test_run import inline
from tests.page.conftest import WORLD, measure, open_page
from tests.page.test_hostile import MARKUP, require_safe
from tests.profile.charging import COSTS, STAGE_COSTS


@pytest.fixture
def loaded(browser, profile_page) -> Chromium:
    browser.open(profile_page, REPORT_READY, fragment="wait")
    return browser


def test_page_is_small_and_its_draws_equal_python(loaded, profile_page):
    assert profile_page.stat().st_size < 500_000
    loaded.evaluate(f"{WORLD}; null")
    for seed in (0, 5_000_000_003):
        loaded.evaluate(f"globalThis.made = makeDesign({seed}); null")
        draws = design.make_draws(seed)
        for step in (1, 16):
            sums = loaded.evaluate(f"sumsOf(made, {step})")
            assert sums == [design.snap_draw(draw, step).checksum for draw in draws]
    assert loaded.requests == [f"{profile_page.resolve().as_uri()}"]


def test_counters_in_the_page_equal_the_reference(loaded):
    grids = loaded.evaluate("state.page.grids")
    assert list(grids) == [str(step) for step in GRID_STEPS]
    for step, index in ((1, 20), (4, 80), (16, 100)):
        draw = design.snap_draw(design.make_draws()[index], step)
        counters = {name: values[index] for name, values in grids[str(step)]["counters"].items()}
        assert counters == count_draw(draw)
        assert grids[str(step)]["checksums"][index] == draw.checksum


@pytest.fixture(scope="module")
def design_rows() -> tuple[list[design.Draw], np.ndarray]:
    draws = design.make_draws()
    return draws, make_design_rows([count_draw(draw) for draw in draws])


def make_epochs(rows: np.ndarray, costs: dict[str, float], form: str) -> np.ndarray:
    """Return times of a device with these costs, with errors of draws and of epochs."""
    random = np.random.default_rng(0)
    times = law.predict_times(rows, np.array([costs.get(name, 0.0) for name in TERMS]), form)
    times *= np.exp(0.05 * random.standard_normal(len(rows)))
    return times * np.exp(0.01 * random.standard_normal((8, len(rows))))


@pytest.mark.parametrize(
    ("costs", "form"), [(COSTS, "sum"), *((STAGE_COSTS, form) for form in list(law.FORMS)[1:])]
)
def test_law_of_the_page_equals_python(loaded, design_rows, costs, form):
    draws, rows = design_rows
    epochs = make_epochs(rows, costs, form)
    places = loaded.evaluate("state.page.fitted.places")
    expected = law.fit_law(
        rows[places], epochs[:, places], [draws[index].group for index in places]
    )
    argument = json.dumps({"epochs": epochs.tolist()})
    actual = loaded.evaluate(f"{WORLD}; fitAs({argument})")
    assert actual["rows"] == rows.tolist()
    assert actual["form"] == expected.form == form
    # Fits end when no time changes by 1e-4, and errors are those of many fits.
    assert actual["errors"] == pytest.approx(expected.errors, rel=2e-3)
    assert actual["binding"] == expected.binding.tolist()
    assert actual["seconds"] == pytest.approx(expected.costs.tolist(), rel=1e-5, abs=1e-17)
    assert actual["known"] == expected.known.tolist()
    for end, values in zip(("low", "high"), expected.intervals.T.tolist(), strict=True):
        assert actual[end] == pytest.approx(values, rel=1e-4, abs=1e-14)
    assert actual["shown"] == expected.significant.tolist()
    assert actual["r2_over"] == pytest.approx(expected.r2_over, abs=1e-6)
    assert actual["r2_within"] == pytest.approx(expected.r2_within, abs=1e-6)


ASPECTS = """(() => {
    const given = %s, page = state.page, { counters } = page.grids[1];
    return compareAspects(page, makeDesignRows(page, counters, page.draws.length), given);
})()"""


@pytest.mark.parametrize("empty_s", [COSTS["draw"], 1.0])
def test_times_of_thin_triangles_equal_python(loaded, design_rows, empty_s):
    """Ratios are positive, even if noise makes a draw faster than the empty one."""
    draws, rows = design_rows
    epochs = make_epochs(rows, COSTS, "sum")
    times = DrawTimes(epochs, 1.0, empty_s, Ratio(1.0, 1.0, 1.0, 8), [2] * 8)
    argument = json.dumps({"epochs": epochs.tolist(), "empty_s": empty_s})
    actual = loaded.evaluate(ASPECTS % argument)
    for expected, found in zip(compare_aspects(draws, rows, times), actual, strict=True):
        assert min(found["ratios"]) > 0
        for name in ("area", "aspects"):
            assert found[name] == expected[name]
        for name in ("ratios", "low", "high", "lanes", "doubled_at"):
            assert found[name] == pytest.approx(expected[name], rel=1e-3)


def test_evaluation_of_rounds_equals_python(loaded):
    """On a machine whose speed changes, with noisy draws and a slightly deviating control."""
    random = np.random.default_rng(1)
    epochs, size = [2, 3, 2, 2], 6
    speed = np.exp(0.1 * random.standard_normal(sum(epochs)))
    names = [*map(str, range(size)), CONTROL, EMPTY]
    samples = {
        name: (1e-3 * (1 + index) * speed * random.uniform(0.95, 1.05, len(speed))).tolist()
        for index, name in enumerate([*names[:size], "3", EMPTY])
    }
    samples[CONTROL] = (np.array(samples["3"]) * random.uniform(1.0, 1.04, len(speed))).tolist()
    expected = normalise_times(
        {name: Times(1, samples[name], epochs) for name in names}, names[:size]
    )
    times = {name: {"samples_s": values} for name, values in samples.items()}
    argument = json.dumps({"times": times, "epochs": [2, 0, 3, 2, 2]})
    actual = loaded.evaluate(f"normaliseTimes({argument}, {size})")
    assert np.array(actual["epochs"]) == pytest.approx(expected.epochs, rel=1e-9)
    assert actual["drift"] == pytest.approx(expected.drift)
    assert actual["empty_s"] == pytest.approx(expected.empty)
    control = [actual["control"][name] for name in ("value", "low", "high")]
    expected_control = [expected.control.value, expected.control.low, expected.control.high]
    # Student's quantile with three degrees of freedom is 1 % too small by its expansion.
    assert np.log(control) == pytest.approx(np.log(expected_control), rel=0.02, abs=1e-4)


@pytest.mark.parametrize(
    ("low", "high", "drift", "trouble"),
    [
        (0.99, 1.01, 1.4, ""),
        (0.99, 1.01, 1.6, "speed changed by a factor of 1.60"),
        (1.01, 1.09, 1.0, ""),
        (1.04, 1.09, 1.0, "The same draw, timed under two names, differs by a factor of 1.065"),
        (0.9, 0.96, 1.0, "The same draw, timed under two names"),
    ],
)
def test_untrustworthy_times_are_reported(loaded, low, high, drift, trouble):
    control = json.dumps({"value": (low + high) / 2, "low": low, "high": high})
    problem = loaded.evaluate(f"describeDisturbance({{ drift: {drift}, control: {control} }})")
    assert trouble in problem
    assert bool(problem) == bool(trouble)


SAME_CHANCE = "(() => { let s = 1; return () => (s = s * 16807 % 2147483647) / 2147483647; })()"
"""Reproducible random numbers (Park and Miller, 1988)."""


def test_advice_is_the_criterion_with_the_lowest_cost(loaded):
    scenes = loaded.evaluate("state.page.scenes")
    assert list(scenes) == ["city"]
    rows = {name: np.array(values) for name, values in scenes["city"].items()}
    assert list(rows) == ["ear-clipping", *CRITERIA]
    assert {values.shape for values in rows.values()} == {(8, len(CRITERIA_TERMS) - 1)}
    for index, term in enumerate(CRITERIA_TERMS[1:]):
        coefficients = [0.0] * len(CRITERIA_TERMS)
        coefficients[1 + index] = 1e-9
        advice = loaded.evaluate(f"chooseTriangulator(state.page, {coefficients}, {SAME_CHANCE})")
        sums = {name: costs[:, index].sum() for name, costs in rows.items()}
        best = min(CRITERIA, key=lambda name: sums[name])
        assert advice["triangulator"] == best, term
        for name in CRITERIA:
            regret = sums[name] / sums[best] - 1
            assert advice["regret"][name] == pytest.approx(regret, abs=1e-9)
        logs = np.log(rows[best][:, index] / rows["ear-clipping"][:, index])
        (saved,) = advice["saved"]
        assert saved["value"] == pytest.approx(1 - np.exp(logs.mean()))
        if np.ptp(logs) > 1e-6:
            ends = [1 - np.exp(end) for end in compute_mean_interval(logs)]
            reach = ends[0] - ends[1]
            assert saved["low"] == pytest.approx(ends[1], abs=0.15 * reach)
            assert saved["high"] == pytest.approx(ends[0], abs=0.15 * reach)
    assert loaded.evaluate("chooseTriangulator(state.page, [1, 0, 0, 0, 0, 0, 0, 0, 0])") is None


@pytest.mark.parametrize("value", [0, 5.3e-8, 1.94e-9, 2e-13, 0.25, 3e-17, 12.0])
def test_format_of_seconds_equals_python(loaded, value):
    assert loaded.evaluate(f"formatSeconds({value})").replace("µ", "u") == format_seconds(value)


def test_page_reports_the_known_costs_of_a_gpu(profiled):
    result = profiled["result"]
    assert result["complete"]
    assert result["problem"] is None
    assert result["differing"] == 0
    assert len(result["epochs"]) >= 12
    for name, value in result["law"]["seconds"].items():
        assert value == pytest.approx(COSTS.get(name, 0.0), rel=0.01, abs=1e-12)
    assert result["law"]["r2_within"] > 0.99
    assert profiled["answer"].startswith(
        "On a test's GPU, a triangle costs 50 ns, a 4x4 block 30 ns, a pixel of its box's width "
        "and height 7 ns and a round of arithmetic 300 ps. Thin triangles take twice as long from"
    )
    assert profiled["stages"] == ["", *["all"] * (len(TERMS) - 1)]
    assert "A draw by itself costs 20 µs." in profiled["words"]
    for text in (
        "No significant cost: triangles set up, triangles that cover a pixel",
        "Triangulate by optimal:",
        " on city (",
    ):
        assert text in profiled["words"]
    assert "Times are wall-clock times (the device has no GPU timer)." in profiled["traps"]
    assert "no sign that the device sorts triangles into tiles" in profiled["traps"]
    assert profiled["panels"] == 2
    assert "twice at" in profiled["thin"]
    assert profiled["widths"] == [360, 360]


def test_coefficients_of_the_page_equal_python(profiled, loaded):
    plain = loaded.evaluate("state.page.plain")
    rows = np.array(loaded.evaluate("state.page.grids[1].predicted"))[plain["places"]]
    truth = rows @ np.array(profiled["coefficients"])
    coefficients = fit_coefficients(rows, truth, plain["labels"])
    assert coefficients == pytest.approx(profiled["coefficients"], rel=1e-3, abs=1e-14)


def test_gpu_timer_is_used_if_available(browser, profile_page):
    open_page(browser, profile_page, "timer: true, noise: 0")
    result = measure(browser)
    assert result["timer"]["timer"] == "gpu"
    assert "The GPU timer's resolution is" in browser.read_text("traps")


def test_measurements_of_a_lost_gpu_are_evaluated(browser, profile_page):
    open_page(browser, profile_page, "at: { 4500: ({ lose }) => lose() }")
    result = measure(browser)
    assert "lost the GPU (it was unplugged)" in result["problem"]
    assert not result["complete"]
    assert sum(result["epochs"]) > 8
    assert result["law"]["seconds"]["triangles"] == pytest.approx(5e-8, rel=0.1)
    assert "Completed measurements are kept" in browser.read_text("notice")
    assert not browser.evaluate("$('save').disabled")


def test_counters_of_a_gpu_that_is_lost_early_are_retained(browser, profile_page):
    open_page(browser, profile_page, "at: { 300: ({ lose }) => lose() }")
    result = measure(browser)
    assert len(result["draws"]) == 183
    assert result["law"] is None
    assert "All counters of 183 draws are the exact ones." in browser.read_text("answer")
    assert "Too few rounds were timed to fit" in browser.read_text("answer")


def test_hidden_page_waits_and_repeats_the_round(browser, profile_page):
    slow = "slower: (drawn) => (drawn === 4000 ? 50 : 1)"
    open_page(browser, profile_page, f"at: {{ 4000: () => hide() }}, {slow}")
    result = measure(browser)
    for draw in result["times"].values():
        assert max(draw["samples_s"]) < 1.1 * min(draw["samples_s"])
    assert result["complete"]
    assert result["hidden"]
    assert {len(draw["samples_s"]) for draw in result["times"].values()} == {sum(result["epochs"])}
    assert "waits until this page is visible" in browser.evaluate("hide.said")
    assert "The page was hidden for a while" in browser.read_text("traps")
    assert browser.evaluate("$('notice').hidden")


def test_gpu_that_slows_down_is_an_error(browser, profile_page):
    open_page(browser, profile_page, "slower: (drawn) => 1 + drawn / 6000")
    result = measure(browser)
    assert not result["complete"]
    for text in (result["problem"], browser.read_text("notice")):
        assert "The device's speed changed by a factor of" in text


def test_slow_device_has_fewer_parts_and_a_note(browser, profile_page):
    open_page(browser, profile_page, "scale: 150")
    result = measure(browser)
    assert result["limited"]
    assert 4 <= len(result["epochs"]) < 12
    assert result["law"]["seconds"]["triangles"] == pytest.approx(150 * 5e-8, rel=0.1)
    assert "The time limit of 4 minutes ended the measurement after" in browser.read_text("traps")


def test_much_too_slow_device_is_reported(browser, profile_page):
    open_page(browser, profile_page, "scale: 20000")
    result = measure(browser)
    assert result["law"] is None
    assert "ended the measurement before the first round" in browser.read_text("answer")


def test_differing_counters_are_reported(browser, profile_page):
    open_page(browser, profile_page, "wrong: 7")
    assert measure(browser)["differing"] == 1
    message = "Counters differ from the exact ones in 1 of 183 draws."
    assert message in browser.read_text("answer")
    assert message in browser.evaluate("state.profile.refused = true; describeAnswer(state.result)")


def test_browser_with_other_draws_is_refused(browser, profile_page):
    open_page(browser, profile_page)
    browser.evaluate("state.page.grids[1].checksums[5] += 1; null")
    assert measure(browser)["draws"] == []
    assert "checksum mismatch" in browser.read_text("notice")


def test_a_stop_keeps_what_was_counted(browser, profile_page):
    open_page(browser, profile_page, "at: { 3000: () => { $('stop').click(); } }")
    result = measure(browser)
    assert not result["complete"]
    assert not result["limited"]
    assert "Stopped. Completed measurements are kept." in browser.read_text("notice")


def test_markup_in_names_runs_no_script(browser, profile_page):
    open_page(browser, profile_page, f"describe: {json.dumps(MARKUP)}")
    browser.evaluate(
        f"const {{ draws, terms, scenes }} = state.page, markup = {json.dumps(MARKUP)};"
        "for (const draw of draws) draw.name += markup;"
        "for (const term of Object.values(terms)) term.noun += markup;"
        "scenes[markup] = scenes.city; null"
    )
    measure(browser)
    for part in ("answer", "terms", "words"):
        assert MARKUP in browser.read_text(part)
    require_safe(browser)
    assert browser.evaluate("document.querySelectorAll('b').length") == 0


def test_page_needs_a_run_or_profile(harness, monkeypatch):
    for arguments in ((), ("somewhere", "--profile")):
        result = harness("page", *arguments)
        assert_refused(result, "give either RUN, the folder of a run, or --profile")
    monkeypatch.setattr("harness.worker.Worker", inline)
    monkeypatch.setattr("harness.page.page_data.SCENES", {})
    out, _ = require_ok(harness("page", "--profile", "--out", "p.html"))
    assert "page: p.html; open it in a browser" in out
    assert "What a triangle costs on this device" in Path("p.html").read_text()


@pytest.mark.parametrize("work", [0, 64])
def test_fragment_work_of_a_draw_reaches_the_shader(loaded, work):
    loaded.evaluate("globalThis.GPUBufferUsage = {}; null")
    painter = "{ buffer: (content) => content, group() {}, hasTimer: false }"
    frame = f"{{ size: 8, points: [], owner: [], work: {work} }}"
    drawing = f"new Drawing({painter}, {frame}, [])"
    assert loaded.evaluate(f"new Uint32Array({drawing}.buffers[3].buffer)[2]") == work


def test_swiftshader_counters_equal_the_expected_ones(gpu_browser, profile_page):
    gpu_browser.open(profile_page, REPORT_READY, fragment="wait")
    differing = gpu_browser.evaluate(f"{WORLD}; differencesOf([1, 40, 60, 75, 90, 110])")
    assert differing == [0] * 12
