"""The page that profiles a device, on a GPU that charges known costs, and on SwiftShader."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import BAD_INPUT
from harness.measuring.timing import EMPTY, Times
from harness.page.page_data import STEPS
from harness.profile import design, law
from harness.profile.advice import CRITERIA, aspects
from harness.profile.counted import TERMS, counters, design_of
from harness.profile.law import COSTS as OF_CRITERIA
from harness.profile.law import solve
from harness.profile.measured import CONTROL, Measured, of_times
from harness.profile.words import amount
from harness.stats.intervals import Ratio, mean_interval
from tests.chromium import MEASUREMENT_ENDED, REPORT_READY, Chromium
from tests.conftest import assert_refused, require_ok
from tests.measuring.test_run import inline
from tests.page.conftest import WORLD, measure, open_page, read_text
from tests.page.test_hostile import MARKUP
from tests.profile.charging import COSTS


@pytest.fixture
def waiting(browser, profile_page) -> Chromium:
    """The page, which does not begin by itself."""
    browser.open(profile_page, REPORT_READY, fragment="wait")
    return browser


def test_the_page_is_small_and_its_draws_are_those_of_python(waiting, profile_page):
    assert profile_page.stat().st_size < 500_000
    waiting.evaluate(f"{WORLD}; null")
    for seed in (0, 5_000_000_003):
        waiting.evaluate(f"globalThis.made = designOf({seed}); null")
        draws = design.draws(seed)
        for step in (1, 16):
            sums = waiting.evaluate(f"sumsOf(made, {step})")
            assert sums == [design.snapped(draw, step).checksum for draw in draws]
    assert waiting.requests == [f"{profile_page.resolve().as_uri()}"]


def test_what_it_holds_is_counted_by_the_exact_reference(waiting):
    grids = waiting.evaluate("state.page.grids")
    assert list(grids) == [str(step) for step in STEPS]
    for step, place in ((1, 20), (4, 80), (16, 100)):
        draw = design.snapped(design.draws()[place], step)
        read_text = {name: values[place] for name, values in grids[str(step)]["counters"].items()}
        assert read_text == counters(draw)
        assert grids[str(step)]["checksums"][place] == draw.checksum


@pytest.fixture(scope="module")
def synthetic() -> dict[str, Any]:
    """Times that follow a law, with errors of their own and of each epoch."""
    draws = design.draws()
    rows = design_of([counters(draw) for draw in draws])
    truth = np.array([COSTS.get(name, 0.0) for name in TERMS])
    random = np.random.default_rng(0)
    missed = np.exp(0.05 * random.standard_normal(len(rows)))
    epochs = rows @ truth * missed * np.exp(0.01 * random.standard_normal((8, len(rows))))
    return {"draws": draws, "rows": rows, "epochs": epochs}


def test_its_law_is_that_of_python(waiting, synthetic):
    fitted = waiting.evaluate("state.page.fitted")
    places = fitted["places"]
    draws, rows, epochs = (synthetic[name] for name in ("draws", "rows", "epochs"))
    groups = [draws[place].group for place in places]
    ours = law.fit(rows[places], epochs[:, places], groups)
    few = law.fewest(rows[places], np.exp(np.log(epochs[:, places]).mean(axis=0)), groups)
    given = json.dumps({"epochs": epochs.tolist()})
    theirs = waiting.evaluate(f"{WORLD}; fitAs({given})")
    assert theirs["rows"] == rows.tolist()
    assert theirs["seconds"] == pytest.approx(ours.costs.tolist(), rel=1e-6)
    for place, end in enumerate(("low", "high")):
        assert theirs[end] == pytest.approx(ours.intervals[:, place].tolist(), rel=1e-5, abs=1e-15)
    assert theirs["shown"] == ours.shown.tolist()
    for own, parts in zip(theirs["sums"], law.SUMS.values(), strict=True):
        weights = np.array([parts.get(term, 0.0) for term in TERMS])
        found = ours.sum_of(weights, law.CONFIDENCE)
        assert [own["seconds"], own["low"], own["high"]] == pytest.approx(found, rel=1e-5)
        assert own["shown"] == ours.is_shown(weights)
    assert theirs["r2_over"] == pytest.approx(ours.r2_over, abs=1e-9)
    assert theirs["r2_within"] == pytest.approx(ours.r2_within, abs=1e-9)
    assert [list(TERMS)[place] for place in theirs["fewest"]] == list(few)


ASPECTS = """(() => {
    const given = %s, page = state.page;
    const rows = designRows(page, page.grids[1].counters, page.draws.length);
    return aspectsOf(page, rows, given, given.law);
})()"""


def test_what_it_says_of_thin_triangles_is_what_python_says(waiting, synthetic):
    draws, rows, epochs = (synthetic[name] for name in ("draws", "rows", "epochs"))
    groups = [draw.group for draw in draws]
    ours = law.fit(rows, epochs, groups)
    times = Measured(epochs, 1.0, COSTS["draw"], Ratio(1.0, 1.0, 1.0, 8), [2] * 8)
    low, high = ours.intervals.T.tolist()
    shown = {"seconds": ours.costs.tolist(), "low": low, "high": high}
    given = json.dumps({"law": shown, "epochs": epochs.tolist(), "empty_s": COSTS["draw"]})
    theirs = waiting.evaluate(ASPECTS % given)
    for own, other in zip(aspects(draws, rows, times, ours), theirs, strict=True):
        for name in ("area", "aspects"):
            assert other[name] == own[name]
        for name in ("ratios", "low", "high", "lanes", "lanes_alone", "doubled_at"):
            assert other[name] == pytest.approx(own[name], rel=1e-3)
        shares = {
            each["name"]: [each["value"], each["low"], each["high"]] for each in other["shares"]
        }
        assert list(shares) == list(own["shares"])
        for name, ends in own["shares"].items():
            assert shares[name] == pytest.approx(ends, rel=1e-6, abs=1e-9)


def test_rounds_tell_it_what_they_tell_python(waiting):
    """Of a machine whose speed changes, draws that are noisy, and a control a little apart."""
    random = np.random.default_rng(1)
    epochs, size = [2, 3, 2, 2], 6
    speed = np.exp(0.1 * random.standard_normal(sum(epochs)))
    names = [*map(str, range(size)), CONTROL, EMPTY]
    samples = {
        name: (1e-3 * (1 + place) * speed * random.uniform(0.95, 1.05, len(speed))).tolist()
        for place, name in enumerate([*names[:size], "3", EMPTY])
    }
    samples[CONTROL] = (np.array(samples["3"]) * random.uniform(1.0, 1.04, len(speed))).tolist()
    ours = of_times({name: Times(1, samples[name], epochs) for name in names}, names[:size])
    read_text = {name: {"samples_s": values} for name, values in samples.items()}
    given = json.dumps({"times": read_text, "epochs": [2, 0, 3, 2, 2]})
    theirs = waiting.evaluate(f"measuredOf({given}, {size})")
    assert np.array(theirs["epochs"]) == pytest.approx(ours.epochs, rel=1e-9)
    assert theirs["drift"] == pytest.approx(ours.drift)
    assert theirs["empty_s"] == pytest.approx(ours.empty)
    control = [theirs["control"][name] for name in ("value", "low", "high")]
    wanted = [ours.control.value, ours.control.low, ours.control.high]
    # Student's quantile with three degrees of freedom is 1 % too small by its expansion.
    assert np.log(control) == pytest.approx(np.log(wanted), rel=0.02, abs=1e-4)


@pytest.mark.parametrize(
    ("low", "high", "drift", "trouble"),
    [
        (0.99, 1.01, 1.4, ""),
        (0.99, 1.01, 1.6, "speed changed by a factor of 1.60"),
        (1.01, 1.09, 1.0, ""),
        (1.04, 1.09, 1.0, "One draw under two names took 1.065 times"),
        (0.9, 0.96, 1.0, "One draw under two names"),
    ],
)
def test_what_makes_times_untrustworthy_is_told(waiting, low, high, drift, trouble):
    control = json.dumps({"value": (low + high) / 2, "low": low, "high": high})
    found = waiting.evaluate(f"troubleOf({{ drift: {drift}, control: {control} }})")
    assert trouble in found
    assert bool(found) == bool(trouble)


SAME_CHANCE = "(() => { let s = 1; return () => (s = s * 16807 % 2147483647) / 2147483647; })()"
"""Random numbers that are the same at every call (Park and Miller, 1988)."""


def test_its_advice_is_the_least_of_the_criteria(waiting):
    scenes = waiting.evaluate("state.page.scenes")
    assert list(scenes) == ["city"]
    rows = {name: np.array(each) for name, each in scenes["city"].items()}
    assert list(rows) == ["ear-clipping", *CRITERIA]
    assert {each.shape for each in rows.values()} == {(8, len(OF_CRITERIA) - 1)}
    for place, term in enumerate(OF_CRITERIA[1:]):
        coefficients = [0.0] * len(OF_CRITERIA)
        coefficients[1 + place] = 1e-9
        found = waiting.evaluate(f"adviceOf(state.page, {coefficients}, {SAME_CHANCE})")
        sums = {name: each[:, place].sum() for name, each in rows.items()}
        least = min(CRITERIA, key=lambda name: sums[name])
        assert found["triangulator"] == least, term
        for name in CRITERIA:
            assert found["regret"][name] == pytest.approx(sums[name] / sums[least] - 1, abs=1e-9)
        logs = np.log(rows[least][:, place] / rows["ear-clipping"][:, place])
        (saved,) = found["saved"]
        assert saved["value"] == pytest.approx(1 - np.exp(logs.mean()))
        if np.ptp(logs) > 1e-6:
            ends = [1 - np.exp(end) for end in mean_interval(logs)]
            reach = ends[0] - ends[1]
            assert saved["low"] == pytest.approx(ends[1], abs=0.15 * reach)
            assert saved["high"] == pytest.approx(ends[0], abs=0.15 * reach)
    assert waiting.evaluate("adviceOf(state.page, [1, 0, 0, 0, 0, 0, 0, 0, 0])") is None


@pytest.mark.parametrize("value", [0, 5.3e-8, 1.94e-9, 2e-13, 0.25, 3e-17, 12.0])
def test_it_writes_seconds_as_python_does(waiting, value):
    assert waiting.evaluate(f"secondsText({value})").replace("µ", "u") == amount(value)


def test_a_gpu_that_charges_known_costs_is_told_what_it_charges(profiled):
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
    assert profiled["needed"] == ["yes" if name in COSTS else "" for name in TERMS]
    assert "A draw by itself costs 20 µs." in profiled["words"]
    nothing = "Nothing is shown for triangles set up, triangles that cover a pixel, vertices"
    assert nothing in profiled["words"]
    assert "Triangulate by optimal:" in profiled["words"]
    assert " on city (" in profiled["words"]
    assert "Times are the wall clock's, for the device has no GPU timer." in profiled["traps"]
    assert "nothing here says that the device sorts triangles into tiles" in profiled["traps"]
    assert profiled["panels"] == 2
    assert "twice at" in profiled["thin"]
    assert profiled["widths"] == [360, 360]


def test_its_coefficients_are_those_that_python_fits(profiled, waiting):
    plain = waiting.evaluate("state.page.plain")
    rows = np.array(waiting.evaluate("state.page.grids[1].predicted"))[plain["places"]]
    truth = rows @ np.array(profiled["coefficients"])
    found = solve(rows, truth, plain["labels"])
    assert found == pytest.approx(profiled["coefficients"], rel=1e-3, abs=1e-14)


def test_a_gpu_timer_is_used_where_there_is_one(browser, profile_page):
    open_page(browser, profile_page, "timer: true, noise: 0")
    result = measure(browser)
    assert result["timer"]["timer"] == "gpu"
    assert "The GPU's timer goes in steps of" in read_text(browser, "traps")


def test_a_lost_gpu_keeps_what_was_measured_and_tells_its_law(browser, profile_page):
    open_page(browser, profile_page, "at: { 4500: ({ lose }) => lose() }")
    result = measure(browser)
    assert "lost the GPU (it was unplugged)" in result["problem"]
    assert not result["complete"]
    assert sum(result["epochs"]) > 8
    assert result["law"]["seconds"]["triangles"] == pytest.approx(5e-8, rel=0.1)
    assert "What was measured is kept" in read_text(browser, "notice")
    assert not browser.evaluate("$('save').disabled")


def test_a_gpu_lost_at_once_leaves_what_it_counted(browser, profile_page):
    open_page(browser, profile_page, "at: { 300: ({ lose }) => lose() }")
    result = measure(browser)
    assert len(result["draws"]) == 135
    assert result["law"] is None
    assert "All counters of 135 draws are the exact ones." in read_text(browser, "answer")
    assert "Too little was timed to say what a triangle costs." in read_text(browser, "answer")


def test_a_hidden_page_waits_and_draws_its_round_again(browser, profile_page):
    slow = "slower: (drawn) => (drawn === 4000 ? 50 : 1)"
    open_page(browser, profile_page, f"at: {{ 4000: () => hide() }}, {slow}")
    result = measure(browser)
    for each in result["times"].values():
        assert max(each["samples_s"]) < 1.1 * min(each["samples_s"])
    assert result["complete"]
    assert result["hidden"]
    assert {len(each["samples_s"]) for each in result["times"].values()} == {sum(result["epochs"])}
    assert "it waits until it is in front again" in browser.evaluate("hide.said")
    assert "The page was hidden for a while" in read_text(browser, "traps")
    assert browser.evaluate("$('notice').hidden")


def test_a_gpu_that_becomes_hot_ends_with_a_sentence(browser, profile_page):
    open_page(browser, profile_page, "slower: (drawn) => 1 + drawn / 6000")
    result = measure(browser)
    assert "The device's speed changed by a factor of" in result["problem"]
    assert not result["complete"]
    assert "The device's speed changed by a factor of" in read_text(browser, "notice")


def test_a_slow_device_is_measured_in_fewer_parts_and_it_says_so(browser, profile_page):
    open_page(browser, profile_page, "scale: 200")
    result = measure(browser)
    assert result["limited"]
    assert 4 <= len(result["epochs"]) < 12
    assert result["law"]["seconds"]["triangles"] == pytest.approx(200 * 5e-8, rel=0.1)
    assert "The time limit of 4 minutes ended it after" in read_text(browser, "traps")


def test_a_far_too_slow_device_is_told_so(browser, profile_page):
    open_page(browser, profile_page, "scale: 20000")
    result = measure(browser)
    assert result["law"] is None
    assert "ended it before a first round" in read_text(browser, "answer")


def test_counters_that_differ_are_said(browser, profile_page):
    open_page(browser, profile_page, "wrong: 7")
    assert measure(browser)["differing"] == 1
    said = "Counters differ from the exact ones in 1 of 135 draws."
    assert said in read_text(browser, "answer")
    assert said in browser.evaluate("state.profile.refused = true; answerOf(state.result)")


def test_a_browser_that_makes_other_draws_is_refused(browser, profile_page):
    open_page(browser, profile_page)
    browser.evaluate("state.page.grids[1].checksums[5] += 1; null")
    assert measure(browser)["draws"] == []
    assert "their checksums differ" in read_text(browser, "notice")


def test_a_stop_keeps_what_was_counted(browser, profile_page):
    open_page(browser, profile_page, "at: { 3000: () => { $('stop').click(); } }")
    result = measure(browser)
    assert not result["complete"]
    assert not result["limited"]
    assert "Stopped. What was measured is kept." in read_text(browser, "notice")


def test_without_webgpu_it_says_which_browsers_have_it(browser, profile_page):
    browser.open(profile_page, MEASUREMENT_ENDED)
    assert "WebGPU is in Chrome" in read_text(browser, "notice")
    assert read_text(browser, "answer") == "Nothing was measured."
    assert browser.evaluate("$('save').disabled")


def test_names_that_are_markup_run_no_script(browser, profile_page):
    open_page(browser, profile_page, f"describe: {json.dumps(MARKUP)}")
    browser.evaluate(
        f"const {{ draws, terms, scenes }} = state.page, markup = {json.dumps(MARKUP)};"
        "for (const draw of draws) draw.name += markup;"
        "for (const term of Object.values(terms)) term.noun += markup;"
        "scenes[markup] = scenes.city; null"
    )
    measure(browser)
    assert MARKUP in read_text(browser, "answer")
    assert MARKUP in read_text(browser, "terms")
    assert MARKUP in read_text(browser, "words")
    assert not browser.evaluate("'hacked' in window")
    assert browser.evaluate("document.querySelectorAll('img, b').length") == 0


def test_a_page_is_of_a_run_or_of_none(harness, monkeypatch):
    for arguments in ((), ("somewhere", "--profile")):
        assert_refused(
            harness("page", *arguments), "give its folder, or --profile alone", code=BAD_INPUT
        )
    monkeypatch.setattr("harness.workers.worker.Worker", inline)
    monkeypatch.setattr("harness.page.page_data.SCENES", {})
    out, _ = require_ok(harness("page", "--profile", "--out", "p.html"))
    assert "page: p.html; open it in a browser" in out
    assert "What a triangle costs on this device" in Path("p.html").read_text()


@pytest.mark.parametrize("work", [0, 64])
def test_a_draws_arithmetic_reaches_its_shader(waiting, work):
    waiting.evaluate("globalThis.GPUBufferUsage = {}; null")
    painter = "{ buffer: (content) => content, group() {}, hasTimer: false }"
    frame = f"{{ size: 8, points: [], owner: [], work: {work} }}"
    drawing = f"new Drawing({painter}, {frame}, [])"
    assert waiting.evaluate(f"new Uint32Array({drawing}.buffers[3].buffer)[2]") == work


def test_noise_makes_no_draw_shorter_than_nothing(waiting, synthetic):
    epochs = synthetic["epochs"].tolist()
    nothing = {ends: [0.0] * len(TERMS) for ends in ("seconds", "low", "high")}
    given = json.dumps({"law": nothing, "epochs": epochs, "empty_s": 1.0})
    found = waiting.evaluate(ASPECTS % given)
    assert all(ratio > 0 for each in found for ratio in each["ratios"])


def test_swiftshader_counts_what_the_page_expects(gpu_browser, profile_page):
    gpu_browser.open(profile_page, REPORT_READY, fragment="wait")
    differing = gpu_browser.evaluate(f"{WORLD}; differencesOf([1, 40, 60, 75, 90, 110])")
    assert differing == [0] * 12
