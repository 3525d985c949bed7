"""What each compiled kernel takes to compile, the longest first.

In a fresh cache, over a city's footprints. Seconds are processor time, and a kernel's own: what it
calls is counted where it is compiled itself.

    python scripts/compile_costs.py                 the six default triangulators, on a city
    python scripts/compile_costs.py greedy refined  others
"""

import argparse
import os
import tempfile
import time
from collections import defaultdict
from typing import Any

os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="compile-costs-")

from numba.core import event

from harness.measuring.plan import DEFAULT_TRIANGULATORS
from scenes import load
from triangulators import Skipped, triangulate, triangulate_many, vertices
from triangulators.criteria import predict
from triangulators.verify import verify


class Costs(event.Listener):
    """Adds up the seconds of each function, those of what it had to compile first taken away."""

    def __init__(self) -> None:
        self.own: defaultdict[str, float] = defaultdict(float)
        self.forms: defaultdict[str, int] = defaultdict(int)
        self.total = 0.0
        self._running: list[list[float]] = []

    def on_start(self, event: Any) -> None:  # noqa: ARG002 - Numba's form
        """Note when a function begins to be compiled."""
        self._running.append([time.thread_time(), 0.0])

    def on_end(self, event: Any) -> None:
        """Count what it took, less what was compiled meanwhile."""
        began, inner = self._running.pop()
        whole = time.thread_time() - began
        function = event.data["dispatcher"].py_func
        name = f"{function.__module__.removeprefix('triangulators.')}.{function.__name__}"
        self.own[name] += whole - inner
        self.forms[name] += 1
        if self._running:
            self._running[-1][1] += whole
        else:
            self.total += whole


def main() -> None:
    """Compile what the triangulators need for a city, and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=list(DEFAULT_TRIANGULATORS))
    parser.add_argument("--scene", default="city")
    parser.add_argument("--most", type=int, default=15, help="kernels to list")
    options = parser.parse_args()
    costs = Costs()
    event.register("numba:compile", costs)
    polygons = load(options.scene).polygons
    for name in options.names:
        before = costs.total
        triangulate_many(polygons, name, threads=1)
        for polygon in polygons[:50]:
            try:
                triangles = triangulate(polygon, name)
            except Skipped:
                continue
            verify(polygon, triangles)
            predict(vertices(polygon), triangles)
        print(f"{costs.total - before:6.1f} s  {name}")
    print(f"{costs.total:6.1f} s  in all, {sum(costs.forms.values())} compiled forms")
    for name in sorted(costs.own, key=lambda name: -costs.own[name])[: options.most]:
        print(f"{costs.own[name]:6.2f} s  {name} ({costs.forms[name]})")


if __name__ == "__main__":
    main()
