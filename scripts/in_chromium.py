"""Open a measuring page in headless Chromium on SwiftShader, measure, and save the result.

    PYTHONPATH=. python scripts/in_chromium.py PAGE.html SAVED.json [--pace usual]

`raster-harness page` writes PAGE.html, and `raster-harness import` reads SAVED.json.
`docs/how-to/contribute-a-device.md` describes the same steps by hand.
"""

import argparse
import time
from pathlib import Path

from tests.chromium import MEASUREMENT_ENDED, REPORT_READY, WEBGPU_FLAGS, Chromium

POLL_INTERVAL_S = 5.0


def main() -> None:
    """Measure and save."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("page", type=Path)
    parser.add_argument("saved", type=Path)
    parser.add_argument("--pace", default="usual", choices=("quick", "usual", "long"))
    options = parser.parse_args()
    browser = Chromium(WEBGPU_FLAGS)
    try:
        browser.open(options.page, REPORT_READY, "wait")
        browser.evaluate(f"$('pace').value = '{options.pace}'; start(); null")
        while not browser.evaluate(MEASUREMENT_ENDED):
            time.sleep(POLL_INTERVAL_S)
        options.saved.write_text(browser.evaluate("savedText()"), encoding="utf-8")
    finally:
        browser.close()


if __name__ == "__main__":
    main()
