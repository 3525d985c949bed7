"""The HTML page in a real browser: nothing on its console, nothing asked of any network."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from harness.compare import compare_runs
from harness.compare.html import to_html
from harness.store import read_run
from tests.compare.scenarios import SCENARIOS

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--enable-logging=stderr",
    "--log-level=0",
    "--window-size=1000,1400",
)
BY_ITSELF = "not an origin"


@pytest.fixture(scope="module")
def browser() -> str:
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        why = f"no browser here; install one of: {', '.join(BROWSERS)}"
        # On a desk that is for the developer to see, in CI it would hide that nothing was tested.
        pytest.fail(why) if os.environ.get("CI") else pytest.skip(why)
    return found


def visit(browser: str, page: Path, folder: Path) -> tuple[list[str], list[str], str]:
    """Open `page`; returns its console's lines, the addresses asked for, and the final DOM."""
    log = folder / "net.json"
    profile = [f"--user-data-dir={folder / 'profile'}", f"--log-net-log={log}"]
    done = subprocess.run(
        [browser, *FLAGS, *profile, "--dump-dom", page.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    content = json.loads(log.read_text())
    asked = [
        url
        for event in content["events"]
        if (url := str(event.get("params", {}).get("url", "")))
        and not url.startswith(("file:", "data:"))
        # What the browser asks for itself, e.g. the time, comes from no page.
        and event["params"].get("initiator", BY_ITSELF) != BY_ITSELF
    ]
    return console, asked, done.stdout


def test_the_page_is_quiet_and_self_contained(browser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    SCENARIOS["real-regression"].make()
    page = tmp_path / "page.html"
    page.write_text(to_html(compare_runs(read_run(Path("base")), read_run(Path("head")))))
    console, asked, dom = visit(browser, page, tmp_path)
    assert console == []
    assert asked == []
    assert dom.count("<svg") == 2
    assert 'class="regression"' in dom


def test_this_test_would_notice(browser, tmp_path):
    page = tmp_path / "bad.html"
    page.write_text(
        '<!DOCTYPE html><title>bad</title><img src="http://127.0.0.1:9/a.png">'
        "<script>console.error('noticed')</script>"
    )
    console, asked, _ = visit(browser, page, tmp_path)
    assert any("noticed" in line for line in console)
    assert "http://127.0.0.1:9/a.png" in asked
