import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.frame import View
from harness.measuring.pool import MeasuringPool
from harness.measuring.timing import TimingSettings
from harness.metrics.groups import read_columns
from harness.page.page_data import make_profile_content, write_page
from harness.page.result import COUNTERS, FORMAT, RECORD_FIELDS, Result, import_result
from harness.page.saved import VERSION, read_saved
from harness.results.run_folder import Run, read_run, select_latest
from tests.chromium import MEASUREMENT_ENDED, REPORT_READY, Chromium
from tests.measuring.test_run import inline, make_plan
from tests.measuring.test_run import measure as measure_run
from tests.paths import ROOT
from tests.profile.charging import COSTS
from tests.records import get_rows

NAMES = ("ear-clipping", "delaunay", "optimal:half-perimeter")
ROUNDS = 12


def read_result(file: Path) -> Result:
    return read_saved(file, {FORMAT: Result})


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a run of a city of 20 buildings in two views, counted by the reference."""
    folder = tmp_path_factory.mktemp("page") / "city"
    views = (View(128), View(64, 30.0))
    timing = TimingSettings(budget_s=0.02, warm_up_s=0.01, epochs=2)
    fields = {"triangulators": NAMES, "rasterisers": ("reference",), "timing": timing}
    measure_run(make_plan(Path("city:buildings=20"), views=views, **fields), folder)
    return select_latest(read_run(folder))


def make_result(run: Run) -> dict[str, Any]:
    """Return the result of a measuring page: counters of the run, times in 12 rounds, 6 epochs."""
    rng = np.random.default_rng(0)
    views: dict[tuple[int, float], dict[str, Any]] = {}
    for typed, record in zip(run.records, get_rows(run), strict=True):
        view_fields = {name: record[name] for name in ("resolution", "rotation", "fit", "scene")}
        control_times = {
            name: {"repeats": 3, "samples_s": rng.normal(1e-3, 1e-5, ROUNDS).tolist()}
            for name in ("(empty)", "(reference)", "(the base again)")
        }
        view = views.setdefault(
            (record["resolution"], record["rotation"]),
            {**view_fields, "cases": {}, "times": control_times, "epochs": [2] * 6},
        )
        columns = read_columns(run, typed)
        assert columns is not None
        name = record["triangulator"]
        view["cases"][name] = {
            "record": {field: record[field] for field in RECORD_FIELDS if field in record},
            "counters": {column: columns[column].astype(int).tolist() for column in COUNTERS},
            "differing": 0,
        }
        samples = rng.normal(2e-3, 2e-5, ROUNDS).tolist()
        view["times"][name] = {"repeats": 4, "samples_s": samples}
    return {
        "format": FORMAT,
        "version": VERSION,
        "page": {"harness": "0.1.0", "scene": "city:buildings=20", "created": "2026-01-01"},
        **json.loads((ROOT / "tests/page/apple.json").read_text()),
        "views": list(views.values()),
    }


def write_saved(result: Any, file: Path, format_name: str = FORMAT) -> Path:
    text = json.dumps(result)
    envelope = {
        "format": format_name,
        "version": VERSION,
        "sha256": hashlib.sha256(text.encode()).hexdigest(),
        "result": text,
    }
    file.write_text(json.dumps(envelope))
    return file


@pytest.fixture
def saved(small_run: Run, tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes the file of a page, changed by a function of the result."""

    def write(change: Callable[[dict[str, Any]], None] = lambda result: None) -> Path:
        result = make_result(small_run)
        change(result)
        return write_saved(result, tmp_path / "saved.json")

    return write


@pytest.fixture
def imported(saved: Callable[..., Path], tmp_path: Path) -> Callable[..., Run]:
    def import_(change: Callable[[dict[str, Any]], None], run: Run | None = None) -> Run:
        out = tmp_path / f"imported-{len(list(tmp_path.iterdir()))}"
        return read_run(import_result(read_result(saved(change)), out, "phone", run))

    return import_


@pytest.fixture(scope="session")
def profile_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page that profiles a device, with eight polygons for the advice."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.page.page_data.SCENES", {"city:buildings=12": "city"})
        patch.setattr("harness.profile.advice.SCENE_POLYGONS", 8)
        pool = MeasuringPool(inline, timeout_s=60)  # type: ignore[arg-type]
        content = make_profile_content(pool)
    file = tmp_path_factory.mktemp("profile") / "profile.html"
    write_page(content, file)
    return file


@pytest.fixture(scope="session")
def profiled(browser: Chromium, profile_page: Path) -> dict[str, Any]:
    """Return the result and texts of an undisturbed page without a GPU timer."""
    open_page(browser, profile_page, "noise: 1e-6")
    result = measure(browser)
    browser.resize(360, 800)
    parts = ("answer", "words", "thin", "terms", "traps")
    texts = {part: browser.read_text(part) for part in parts}
    texts["widths"] = browser.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    texts["panels"] = browser.evaluate("document.querySelectorAll('#thin svg').length")
    stages = "[...$('terms').rows].map((row) => row.cells[1].textContent)"
    texts["stages"] = browser.evaluate(stages)
    texts["saved"] = browser.evaluate("savedText()")
    texts["coefficients"] = browser.evaluate("state.profile.coefficients")
    browser.send("Emulation.clearDeviceMetricsOverride")
    return {"result": result, **texts}


WORLD = (ROOT / "tests/page/world.js").read_text()


def open_page(browser: Chromium, page: Path, world: str = "") -> None:
    """Open the page without starting it; `world` has fields for `makeWorld`."""
    browser.open(page, REPORT_READY, fragment="wait")
    browser.evaluate(
        f"{WORLD}; PACE.quick = 0.02; $('pace').value = 'quick';"
        f"makeWorld({{ costs: {json.dumps(COSTS)}, {world} }}); null"
    )


def measure(browser: Chromium) -> dict[str, Any]:
    browser.evaluate("start(); null")
    browser.wait(MEASUREMENT_ENDED)
    return json.loads(browser.evaluate("JSON.stringify(state.result)"))
