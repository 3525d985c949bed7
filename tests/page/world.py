"""The profiling page on a GPU that charges known costs; time passes only as it draws."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.chromium import MEASURED, REPORT_READY, Chromium
from tests.paths import ROOT
from tests.profile.charging import COSTS

WORLD = (ROOT / "tests/page/world.js").read_text()


def opened(browser: Chromium, page: Path, world: str = "") -> None:
    """Open the page without having it begin by itself; `world`: fields for `makeWorld`."""
    browser.open(page, REPORT_READY, fragment="wait")
    browser.evaluate(
        f"{WORLD}; PACE.quick = 0.02; $('pace').value = 'quick';"
        f"makeWorld({{ costs: {json.dumps(COSTS)}, {world} }}); null"
    )


def measured(browser: Chromium) -> dict[str, Any]:
    """Start, wait for the end, and return the result."""
    browser.evaluate("start(); null")
    browser.wait(MEASURED)
    return json.loads(browser.evaluate("JSON.stringify(state.result)"))


def told(browser: Chromium, part: str) -> str:
    """Return the text of a part of the page."""
    return browser.evaluate(f"$('{part}').textContent")
