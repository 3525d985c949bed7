from pathlib import Path

from tests.chromium import Chromium
from tests.report.conftest import write_many


def test_ten_thousand_cases_load_in_two_seconds(browser: Chromium, tmp_path: Path):
    folder = write_many(tmp_path / "big", devices=10)
    times = []
    for _ in range(3):
        browser.open(folder / "report.html")
        times.append(int(browser.evaluate("document.documentElement.dataset.ready")))
    assert browser.evaluate("state.report.cases.length") == 10_000
    print(f"\nready after {times} ms")
    assert min(times) < 2000, times
