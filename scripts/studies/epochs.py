"""How often drawings of the same triangulation are called different: A/A pairs at several budgets.

    PYTHONPATH=. python scripts/studies/epochs.py [--scene city] [--budgets 2] [--busy]

The same triangulation is drawn under several names, all timed together, as a run does it. Each pair
of names is a comparison whose right answer is "no difference shown". One more name draws 1 % of the
triangles twice: against each of the others its right answer is "slower". Prints, for each budget,
how many of the pairs were called different, with epochs and without, and how often the additional
work was found. Pairs of one group share rounds, so the interval of their share is one of groups.
With --busy, another program that keeps a core busy starts and stops on the way.

--keep FOLDER keeps the rounds of each group, and reads those that it has: a series that was stopped
goes on, and another way to make intervals can be tried on the same rounds.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import threading
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np

from harness.figures.ratios import UNDECIDED, Ratio, paired_ratio
from harness.frame import View, make_frame
from harness.measuring import tasks
from harness.measuring.timing import Times, TimingSettings
from harness.rasterisers import Options, find_device
from scenes import load
from scripts.studies.aa import disturb
from scripts.studies.interval_coverage import share_interval
from triangulators import triangulate

NAMES = 6
"""Names of one triangulation in a group: fifteen pairs."""


def main() -> None:
    """Read the command line, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="city")
    parser.add_argument("--resolution", type=int, default=512)
    parser.add_argument("--rasteriser", default="opengl")
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--budgets", default="0.3,2,10")
    parser.add_argument("--busy", action="store_true")
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    over = threading.Event()
    if given.busy:
        threading.Thread(target=disturb, args=(over, random.Random(0))).start()
    try:
        _measure(given)
    finally:
        over.set()


def _measure(given: argparse.Namespace) -> None:
    frame = make_frame(load(given.scene).polygons, View(given.resolution))
    triangles = frame.join([triangulate(polygon, "delaunay") for polygon in frame.polygons])
    more = np.concatenate([triangles, triangles[::100]])
    candidates = {f"same {k}": (frame, triangles) for k in range(NAMES)} | {"more": (frame, more)}
    device = find_device(given.rasteriser)
    os.environ.update(device.environment)  # as a device's worker has it, before its driver loads
    test = tasks.open_device(given.rasteriser, device).timer
    assert test is not None
    print(
        f"{'budget s':>8} {'pairs':>6} {'epochs':>7} {'rounds':>7} {'without':>8} {'1 % found':>10}"
    )
    for budget in map(float, given.budgets.split(",")):
        settings = TimingSettings(budget_s=budget)
        pairs, more_pairs, without, found, sizes = 0, 0, 0, 0, []
        shares: list[float] = []
        seed = 0
        while pairs < given.pairs:
            group = _kept(
                given.keep and given.keep / f"{given.rasteriser}-{budget:g}s-{seed}.json",
                partial(
                    tasks.time_group,
                    *(given.rasteriser, device, candidates, Options(), settings, test, seed),
                ),
            )
            seed += 1
            wrong = []
            for a, b in combinations([f"same {k}" for k in range(NAMES)], 2):
                wrong.append(_ratio(group[a], group[b]).verdict != UNDECIDED)
                plain = paired_ratio(group[a].samples_s, group[b].samples_s)
                without += plain.verdict != UNDECIDED
            pairs += len(wrong)
            shares.append(float(np.mean(wrong)))
            for k in range(NAMES):
                more_pairs += 1
                found += _ratio(group["more"], group[f"same {k}"]).verdict == "slower"
            sizes.append((len(group["more"].epochs), len(group["more"].samples_s)))
        epochs, rounds = np.median(sizes, axis=0)
        low, high = share_interval(np.array(shares))
        print(
            f"{budget:>8g} {pairs:>6} {np.mean(shares):>7.1%} {rounds:>7.0f} "
            f"{without / pairs:>8.1%} "
            f"{found / more_pairs:>10.1%} ({found} of {more_pairs}; {epochs:.0f} epochs; "
            f"called different: {low:.1%} to {high:.1%}, of {len(shares)} groups)",
            flush=True,
        )


def _kept(file: Path | None, measure: Callable[[], dict[str, Times]]) -> dict[str, Times]:
    """Return the group of the file, measured and written first where there is none."""
    if file is not None and file.exists():
        return {name: Times(**times) for name, times in json.loads(file.read_text()).items()}
    group = measure()
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps({name: asdict(times) for name, times in group.items()}))
    return group


def _ratio(first: Times, second: Times) -> Ratio:
    return paired_ratio(first.samples_s, second.samples_s, first.epochs)


if __name__ == "__main__":
    main()
