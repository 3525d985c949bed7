"""How often the measuring page calls equal drawings different, and whether it finds 5 % more work.

    PYTHONPATH=. python scripts/page_aa.py RUN --pairs 100 --budget 0.3 --out results/reference/aa/page.csv

Opens the page of a run (one view, two triangulators) in Chromium, on SwiftShader, again and again.
Each time it draws ear clipping's triangles under two names, and once with every twentieth triangle
drawn twice. Writes one row a time, and prints how often an interval left out 1.
"""  # noqa: E501

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import pandas as pd

from harness.compare.matching import latest
from harness.page import write_page
from harness.stored.folder import read_run
from tests.chromium import MEASURED, REPORT_READY, WEBGPU_FLAGS, Chromium

MORE = """
{
  const base = state.page.views[0].cases[state.page.base];
  const rows = decode(base.rows, Uint32Array);
  const more = [...rows];
  for (let t = 0; t < rows.length / 3; t += 20) more.push(rows[3 * t], rows[3 * t + 1], rows[3 * t + 2]);
  const bytes = new Uint8Array(new Uint32Array(more).buffer);
  let text = "";
  for (const byte of bytes) text += String.fromCharCode(byte);
  state.page.views[0].cases["(more)"] = { ...base, rows: btoa(text) };
  state.page.looks["(more)"] = state.page.looks[state.page.base];
  null
}
"""  # noqa: E501
RATIOS = """
JSON.stringify(["(the base again)", "(more)"].map((name) => {
  const view = state.result.views[0];
  return pairedRatio(view.times[name].samples_s, view.times[state.page.base].samples_s, view.epochs);
}))
"""  # noqa: E501


def main() -> None:
    """Measure, write and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--budget", type=float, default=0.3)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        page = write_page(latest(read_run(given.run)), Path(folder) / "page.html")
        browser = Chromium(WEBGPU_FLAGS)
        for number in range(given.pairs):
            browser.open(page, REPORT_READY, "wait")
            browser.evaluate(MORE)
            browser.evaluate(
                f"PACE.quick = {given.budget}; $('pace').value = 'quick'; start(); null"
            )
            browser.wait(MEASURED)
            equal, more = json.loads(browser.evaluate(RATIOS))
            rows.append(
                {"pair": number, "budget_s": given.budget}
                | {f"equal_{key}": value for key, value in equal.items()}
                | {f"more_{key}": value for key, value in more.items()}
            )
            if number % 10 == 9:
                print(_told(pd.DataFrame(rows)), flush=True)
        browser.close()
    if given.out:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        pd.DataFrame(rows).to_csv(given.out, index=False, float_format="%.5g")


def _told(table: pd.DataFrame) -> str:
    different = ((table["equal_low"] > 1) | (table["equal_high"] < 1)).sum()
    found = (table["more_low"] > 1).sum()
    return (
        f"{len(table)} times: equal drawings called different {different}, "
        f"5 % more triangles found {found} (median ratio {table['more_value'].median():.4f})"
    )


if __name__ == "__main__":
    main()
