"""Builds the simulator ATTILA as its authors published it, and runs it over one trace of OpenGL."""

from __future__ import annotations

import csv
import gzip
import os
import re
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from harness.errors import HarnessError
from harness.rasterisers.simulated.building import Lacking, built, digest, lacking, version
from harness.rasterisers.simulated.sources import Tree

TOOLS = ("g++", "make", "bison", "flex")
SOURCES = Tree(
    "RASTER_HARNESS_ATTILA",
    "clone attila-gpu/attila-sim, check out commit a64b572, build nothing in it, "
    "and let the variable name the folder",
    ("src", "test/config"),
    "17620373f4eb3e78a9dd9b2e63fb74a21a34218a94e6ce8564bc7a2148862a46",
)
SHIPPED = Path("test", "config", "bGPU.ini")
"""The configuration that the authors' own regression tests run with."""

FLAGS = (
    "-std=gnu++98 -fpermissive -w",  # written before C++11, and not quite C++98
    "-fno-strict-aliasing",  # it reads floats as integers through pointers
    "-ffp-contract=off",  # or another CPU rounds products and sums at once: other digits
)
RUN_S = 600.0
Settings = Mapping[str, Mapping[str, str | int]]
"""Section -> key -> value, of what differs from SHIPPED."""


def problem() -> Lacking | None:
    """Say what lacks to build it, and what to do."""
    return SOURCES.problem() or lacking(TOOLS)


def program() -> tuple[Path, dict[str, object]]:
    """Return the folder of the simulator and its configuration, and what it was built from."""
    sources = SOURCES.folder()
    facts = {"sources": SOURCES.digest, "flags": FLAGS, "tools": {"g++": version("g++")}}
    key = digest([], facts)
    copy = "cp -r {0}/src {0}/Makefile* . && chmod -R u+w ."
    order = f"make -j{os.cpu_count()} bGPU OLEVEL=2 'EXTRA_CXXFLAGS={' '.join(FLAGS)}'"

    def commands(made: Path) -> list[list[str]]:
        # The first make writes sources that it has not seen when it lists what to link: it fails
        # in the end, and the second one links.
        steps = [
            f"cd {made} && mkdir build && cd build",
            copy.format(sources),
            "mkdir -p lib obj bin src/trace/utils/Gen",
            f"{{ {order} >/dev/null 2>&1; {order} >/dev/null; }}",
            f"mv bin/bGPU-Uni .. && cp {sources / SHIPPED} .. && cd .. && rm -rf build",
        ]
        return [["sh", "-c", " && ".join(steps)]]

    return built("attila", key, commands), {**facts, "digest": key}


def configured(shipped: str, settings: Settings) -> str:
    """Return the text of the configuration with other values for some keys.

    Raises
    ------
    ValueError
        if it has no such section or key
    """
    for section, values in settings.items():
        for key, value in values.items():
            # A section ends where the next line that begins with a bracket is.
            place = rf"(?ms)(^\[{section}\]$(?:(?!^\[).)*?^{key} *= *)[^\n]*$"
            shipped, changed = re.subn(place, rf"\g<1>{value}", shipped, count=1)
            if not changed:
                raise ValueError(f"the configuration has no {key} in [{section}]")
    return shipped


def run(folder: Path, trace: str, settings: Settings) -> dict[str, float]:
    """Draw the one frame of a trace and return the simulator's statistics of it, by name.

    Each run is a process of its own, so that no frame finds caches or queues as another left them.

    Raises
    ------
    HarnessError
        if the simulator ends without them
    """
    with tempfile.TemporaryDirectory(prefix="attila-") as place:
        here = Path(place)
        (here / "trace.txt").write_text(trace)
        (here / "bGPU.ini").write_text(configured((folder / SHIPPED.name).read_text(), settings))
        command = [str(folder / "bGPU-Uni"), "trace.txt", "1", "0"]
        try:
            done = subprocess.run(command, cwd=here, capture_output=True, text=True, timeout=RUN_S)
        except subprocess.TimeoutExpired:
            raise HarnessError(f"attila did not end within {RUN_S:g} s") from None
        table = here / "stats.frames.csv.gz"
        if done.returncode or not table.exists():
            said = (done.stdout + done.stderr).strip().splitlines()[-1:] or [""]
            raise HarnessError(f"attila ended with {done.returncode}: {said[0].strip()}")
        with gzip.open(table, "rt") as file:
            rows = list(csv.reader(file, delimiter=";"))
    if len(rows) != 2:
        raise HarnessError(f"attila drew {len(rows) - 1} frames where one was given")
    return {name: float(value) for name, value in zip(*rows, strict=True) if value}
