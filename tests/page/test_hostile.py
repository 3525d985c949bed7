"""Markup in every field of a run and of an imported result does not run scripts."""

import json
from typing import Any

from harness.page.page_data import make_page_content, write_page
from harness.page.result import import_result
from harness.report.page import write_report
from harness.results.run_folder import read_run
from tests.chromium import MEASUREMENT_ENDED, Chromium
from tests.page.conftest import read_result
from tests.records import get_rows

MARKUP = '</script><img src=x onerror="window.hacked = 1"><b>'
PLAIN = {"key", "status", "scene_hash", "fit", "timer", "verdict", "created", "order", "hash"}
"""Fields with a fixed set of values or digits, in which other text is refused."""

HOVER = """(() => {
  const count = PLOT.getOption().series.length;
  for (let seriesIndex = 0; seriesIndex < count; seriesIndex++)
    PLOT.dispatchAction({ type: "showTip", seriesIndex, dataIndex: 0 });
})()"""


def add_markup(value: Any, field: str = "") -> Any:
    if isinstance(value, dict):
        return {name: add_markup(item, name) for name, item in value.items()}
    if isinstance(value, list):
        return [add_markup(item, field) for item in value]
    return value + MARKUP if isinstance(value, str) and field not in PLAIN else value


def require_safe(browser: Chromium) -> None:
    """Require markup as text in the page, no element made from it, and no effect of a script."""
    assert MARKUP in browser.evaluate("document.body.textContent")
    assert not browser.evaluate("'hacked' in window")
    assert browser.evaluate("document.querySelectorAll('img').length") == 0


def hover(browser: Chromium, plot: str) -> None:
    """Show the tooltip of the first mark of each series."""
    browser.evaluate(HOVER.replace("PLOT", plot))
    browser.evaluate("new Promise((done) => setTimeout(done, 50))")


def test_report_of_a_run_runs_no_script(browser, small_run, tmp_path):
    (tmp_path / "run.json").write_text(json.dumps(add_markup(small_run.facts)))
    lines = [json.dumps(add_markup(record)) + "\n" for record in get_rows(small_run)]
    (tmp_path / "cases.jsonl").write_text("".join(lines))
    (tmp_path / "polygons").symlink_to(small_run.path / "polygons")
    browser.open(write_report(read_run(tmp_path)))
    require_safe(browser)
    assert browser.evaluate("document.querySelectorAll('b').length") == 0
    hover(browser, "chart.plot")
    require_safe(browser)


def test_report_of_an_imported_result_runs_no_script(browser, saved, tmp_path):
    def change(result: dict[str, Any]) -> None:
        for view in result["views"]:
            for part in ("cases", "times"):
                view[part] = {
                    name if name.startswith("(") else name + MARKUP: entry
                    for name, entry in view[part].items()
                }
            for case in view["cases"].values():
                case["record"] = add_markup(case["record"])
            view["scene"] += MARKUP
        for part in ("page", "browser", "device"):
            result[part] = add_markup(result[part])

    folder = import_result(read_result(saved(change)), tmp_path / "run", f"phone{MARKUP}")
    browser.open(write_report(read_run(folder)))
    require_safe(browser)
    assert browser.evaluate("document.querySelectorAll('b').length") == 0


def test_measuring_page_and_tooltips_run_no_script(browser, small_run, tmp_path, saved):
    page = tmp_path / "page.html"
    write_page(make_page_content(small_run), page)
    browser.open(page, MEASUREMENT_ENDED)
    content = json.loads(saved().read_text())["result"]
    name = json.dumps(f"delaunay{MARKUP}")
    browser.evaluate(f"""(() => {{
      const renamed = (each) => Object.fromEntries(Object.entries(each)
        .map(([key, value]) => [key === "delaunay" ? {name} : key, value]));
      const result = {content};
      for (const view of result.views) {{
        view.cases = renamed(view.cases); view.times = renamed(view.times);
      }}
      state.page.looks = renamed(state.page.looks);
      state.result = result;
      show();
    }})()""")
    assert browser.evaluate("state.plot.getOption().series.length") > 3
    hover(browser, "state.plot")
    assert "predicted" in browser.evaluate("document.body.textContent")
    require_safe(browser)
