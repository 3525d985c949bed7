"""Counts frames in a process of its own: `python remote.py RASTERISER DEVICE`, pickles in and out.

Only for devices whose driver must not be loaded into the tests' process.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

from harness.rasterisers import Counters, Options, find_device, get

ROOT = Path(__file__).parents[2]


def counted_elsewhere(
    rasteriser: str, device: str, cases: list, options: Options
) -> list[Counters]:
    """Count each (frame, triangles) of `cases` on a device, in a new process."""
    environment = {**os.environ, **find_device(rasteriser, device).environment}
    environment["PYTHONPATH"] = str(ROOT)
    finished = subprocess.run(
        [sys.executable, __file__, rasteriser, device],
        input=pickle.dumps((cases, options)),
        env=environment,
        stdout=subprocess.PIPE,
        check=False,
        timeout=600,
    )
    assert finished.returncode == 0, f"{rasteriser} on {device} failed"
    return pickle.loads(finished.stdout)


def main(rasteriser: str, device: str) -> None:
    cases, options = pickle.load(sys.stdin.buffer)
    opened = get(rasteriser)(find_device(rasteriser, device))
    results = [opened.count(frame, triangles, options) for frame, triangles in cases]
    opened.close()
    sys.stdout.buffer.write(pickle.dumps(results))


if __name__ == "__main__":
    main(*sys.argv[1:])
