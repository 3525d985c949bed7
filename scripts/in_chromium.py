"""Opens a measuring page in headless Chromium, on SwiftShader, measures, and saves the result.

    PYTHONPATH=. python scripts/in_chromium.py PAGE.html SAVED.json [--pace usual]

PAGE.html is written by `raster-harness page`, SAVED.json is read by `raster-harness import`: what a
person does by hand in `docs/how-to/contribute-a-device.md`.
"""

import argparse
import time
from pathlib import Path

from tests.chromium import MEASURED, REPORT_READY, WEBGPU_FLAGS, Chromium

POLLED_S = 5.0


def main() -> None:
    """Measure and save."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("page", type=Path)
    parser.add_argument("saved", type=Path)
    parser.add_argument("--pace", default="usual", choices=("quick", "usual", "long"))
    given = parser.parse_args()
    browser = Chromium(WEBGPU_FLAGS)
    try:
        browser.open(given.page, REPORT_READY, "wait")
        browser.evaluate(f"$('pace').value = '{given.pace}'; start(); null")
        while not browser.evaluate(MEASURED):
            time.sleep(POLLED_S)
        given.saved.write_text(browser.evaluate("savedText()"), encoding="utf-8")
    finally:
        browser.close()


if __name__ == "__main__":
    main()
