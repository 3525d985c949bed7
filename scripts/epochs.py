"""How often drawings of the same triangulation are called different: A/A pairs at several budgets.

    PYTHONPATH=. python scripts/epochs.py [--scene city] [--pairs 200] [--budgets 0.3,2,10]

The same triangulation is drawn under several names, all timed together, as a run does it. Each pair
of names is a comparison whose right answer is "no difference shown". One more name draws 1 % of the
triangles twice: its right answer is "slower". Prints, for each budget, how many of the pairs were
called different, with epochs and without, and how often the additional work was found.
"""

from __future__ import annotations

import argparse
import os
from itertools import combinations

import numpy as np

from harness.figures.ratios import UNDECIDED, Ratio, paired_ratio
from harness.frame import View, make_frame
from harness.measuring import tasks
from harness.measuring.timing import Times, TimingSettings
from harness.rasterisers import Options, find_device
from scenes import load
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
    given = parser.parse_args()
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
        pairs, wrong, without, found, sizes = 0, 0, 0, 0, []
        seed = 0
        while pairs < given.pairs:
            group = tasks.time_group(
                given.rasteriser, device, candidates, Options(), settings, test, seed
            )
            seed += 1
            for a, b in combinations([f"same {k}" for k in range(NAMES)], 2):
                pairs += 1
                wrong += _ratio(group[a], group[b]).verdict != UNDECIDED
                plain = paired_ratio(group[a].samples_s, group[b].samples_s)
                without += plain.verdict != UNDECIDED
            found += _ratio(group["more"], group["same 0"]).verdict == "slower"
            sizes.append((len(group["more"].epochs), len(group["more"].samples_s)))
        epochs, rounds = np.median(sizes, axis=0)
        print(
            f"{budget:>8g} {pairs:>6} {wrong / pairs:>7.1%} {rounds:>7.0f} {without / pairs:>8.1%} "
            f"{found:>4} of {seed} ({epochs:.0f} epochs)",
            flush=True,
        )


def _ratio(first: Times, second: Times) -> Ratio:
    return paired_ratio(first.samples_s, second.samples_s, first.epochs)


if __name__ == "__main__":
    main()
