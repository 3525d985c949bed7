"""The HTML page in a real browser: nothing on its console, nothing asked of any network."""

from __future__ import annotations

from pathlib import Path

from harness.compare.comparison import compare_runs
from harness.compare.html import to_html
from harness.stored.folder import read_run
from tests.chromium import LOADED
from tests.compare.scenarios import SCENARIOS


def test_the_page_is_quiet_and_self_contained(browser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    SCENARIOS["real-regression"].make()
    page = tmp_path / "page.html"
    page.write_text(to_html(compare_runs(read_run(Path("base")), read_run(Path("head")))))
    browser.open(page, LOADED)
    assert browser.errors == []
    assert browser.requests == [page.as_uri()]
    assert browser.evaluate("document.querySelectorAll('svg').length") == 2
    assert browser.evaluate("document.querySelector('h1').className") == "regression"


def test_this_test_would_notice(browser, tmp_path):
    page = tmp_path / "bad.html"
    page.write_text('<!DOCTYPE html><title>bad</title><img alt="">')
    browser.open(page, LOADED)
    assert browser.errors == []
    browser.evaluate("console.error('noticed')")
    ask = "document.images[0].src = 'http://127.0.0.1:9/a.png'; document.images[0].decode()"
    assert browser.evaluate(f"{ask}.catch(() => 'failed')") == "failed"
    assert any("noticed" in line for line in browser.errors)
    assert "http://127.0.0.1:9/a.png" in browser.requests
