"""Compare what devices count with the exact reference, over all triangulations that runs kept.

    PYTHONPATH=. python scripts/equal.py RUN... --on webgpu:llvmpipe webgpu:lavapipe page

A device is RASTERISER:DEVICE; `page` is the measuring page in Chromium, on SwiftShader. Prints a
row for each device and run: triangles, polygons, and in how many polygons a counter differs; ends
with 1 if any does. `make equal` makes the runs first.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from harness.compare.matching import latest
from harness.frame import Frame
from harness.measuring import tasks
from harness.measuring.worker import Worker
from harness.page import write_page
from harness.rasterisers import Options, find_device
from harness.rasterisers.base import Counters, per_polygon
from harness.rasterisers.reference import predict
from harness.stored import drawings
from harness.stored.drawings import view_of
from harness.stored.folder import Run, read_run
from tests.chromium import REPORT_READY, WEBGPU_FLAGS, Chromium

COMPARED = ("fragments", "quads")
COUNT_ALL = """
(async () => {
  const { device, info } = await openDevice();
  const painter = new Painter(device, info, state.page.shaders);
  const total = { triangles: 0, polygons: 0, differing: 0, step: await findStep(painter) };
  for (const view of state.page.views) {
    const frame = frameOf(view, total.step ?? 1);
    for (const each of Object.values(view.cases)) {
      const rows = decode(each.rows, Uint32Array);
      const counters = await painter.count(frame, rows);
      const expected = total.step === 1 ? { fragments: decode(each.fragments, Uint32Array), quads: decode(each.quads, Uint32Array) }
        : countExactly(frame, rows);
      total.triangles += rows.length / 3;
      total.polygons += frame.polygons;
      total.differing += differingOf(counters, expected);
    }
  }
  globalThis.counted = JSON.stringify(total);
})().catch((error) => { globalThis.counted = JSON.stringify({ problem: String(error) }); });
null
"""  # noqa: E501


def main() -> None:
    """Count, compare, print and exit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--on", nargs="+", required=True)
    given = parser.parse_args()
    worst = 0
    print(f"{'device':<22} {'run':<24} {'triangles':>12} {'polygons':>10} {'differing':>10}")
    for device in given.on:
        triangles = 0
        for folder in given.runs:
            run = latest(read_run(folder))
            found = _on_page(run) if device == "page" else _on_device(run, *device.split(":"))
            print(f"{device:<22} {folder.name:<24} {_numbers(*found)}", flush=True)
            triangles += found[0]
            worst += found[2]
        print(f"{device:<22} {'all':<24} {triangles:>12,}", flush=True)
    sys.exit(worst > 0)


def _numbers(triangles: int, polygons: int, differing: int) -> str:
    return f"{triangles:>12,} {polygons:>10,} {differing:>10,}"


def _frames(run: Run) -> Iterator[tuple[Frame, dict[str, np.ndarray]]]:
    """Yield each view's frame with its triangulations."""
    for view in dict.fromkeys(view_of(record) for record in run.records):
        kept = drawings.read(run, view)
        assert kept is not None
        assert kept.ring_ends is not None
        shape = (kept.source, kept.points, kept.offsets, kept.ring_ends)
        yield Frame(view.resolution, view.resolution, 1.0, view, *shape), kept.triangles


def _expected(frame: Frame, rows: np.ndarray) -> Counters:
    counted = predict(frame.points, rows)
    return {name: per_polygon(frame, rows, counted[name]) for name in COMPARED}


def _on_device(run: Run, rasteriser: str, name: str) -> tuple[int, int, int]:
    device = find_device(rasteriser, name)
    triangles = polygons = differing = 0
    with Worker(name, device.environment) as worker:
        for frame, made in _frames(run):
            for rows in made.values():
                given = (rasteriser, device, frame, rows, Options())
                drawn = worker.call(tasks.count, *given, timeout_s=600)
                expected = _expected(frame, rows)
                wrong = np.zeros(len(frame.offsets) - 1, bool)
                for counter in COMPARED:
                    wrong |= drawn[counter] != expected[counter]
                triangles += len(rows)
                polygons += len(wrong)
                differing += int(wrong.sum())
    return triangles, polygons, differing


def _on_page(run: Run) -> tuple[int, int, int]:
    browser = Chromium(WEBGPU_FLAGS)
    try:
        with tempfile.TemporaryDirectory() as folder:
            page = write_page(run, Path(folder) / "page.html")
            browser.open(page, REPORT_READY, "wait")
            browser.evaluate(COUNT_ALL)
            while (counted := browser.evaluate("globalThis.counted ?? null")) is None:
                time.sleep(1)
            total = json.loads(counted)
            assert "problem" not in total, total
            if total["step"] != 1:
                print(f"its grid is {total['step']}/256 px: expected is what is counted on it")
    finally:
        browser.close()
    return total["triangles"], total["polygons"], total["differing"]


if __name__ == "__main__":
    main()
