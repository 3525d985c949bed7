"""The design `attila`: a whole desktop GPU of 2006, modelled by its authors cycle by cycle.

It has vertex work, set-up, a recursive rasteriser, hierarchical Z, unified shaders and caches, from
the command processor to memory. One configuration is its authors'; in each of three others one part
is made to bind. The simulator is built as it was published, and runs over a trace of OpenGL.

Each draw is a process of its own, which begins with empty caches and queues.
"""

import csv
import gzip
import os
import re
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from harness.errors import HarnessError, UsageError
from harness.frame import Frame
from harness.rasterisers.base import Counters, Options, Triangles
from harness.rasterisers.counters import CYCLES
from harness.rasterisers.reference import SHADED
from harness.rasterisers.simulated import Design
from harness.rasterisers.simulated.building import Sources, built, digest, version

SOURCES = Sources(
    "RASTER_HARNESS_ATTILA",
    "clone attila-gpu/attila-sim, check out commit a64b572, build nothing in it, "
    "and let the variable name the folder",
    ("src", "test/config"),
    "17620373f4eb3e78a9dd9b2e63fb74a21a34218a94e6ce8564bc7a2148862a46",
    ("g++", "make", "bison", "flex"),
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

SIDES = (64, 128, 256, 512, 1024)
"""Sides in pixels of a viewport that moves no vertex: ATTILA maps a vertex to -1 to 1 and back in
float, which is exact for 1/256 px where the side is a power of two and 24 bits hold the place."""

BINDING: Mapping[str, Settings] = {
    "shipped": {},
    "shading": {"GPU": {"NumFragmentShaders": 1}},
    "fill": {"GPU": {"NumStampPipes": 1}, "RASTERIZER": {"StampsPerCycle": 1}},
    "setup": {"RASTERIZER": {"SetupStartLatency": 512}},
}
"""What each configuration changes of the one that was shipped, which has four shaders, four pipes
that each write a quad a cycle, and two set-up units that each begin a triangle in four cycles.

shading : one shader, so that fragments wait for it
fill : one pipe, and what it writes is blended with what is there, so that each pixel is read, too
setup : a unit begins a triangle in 512 cycles
"""

STATISTICS = {
    "traversal_cycles": ("UtilizationCycles_TT",),
    "empty_quads": ("Stamps0Fragment_TT",),
    "shaded_vertices": ("ShadedVertices_FFU",),
    "colour_misses": tuple(f"MissesAlloc_FC_CW-SU{pipe}" for pipe in range(4))
    + tuple(f"MissesFetch_FC_CW-SU{pipe}" for pipe in range(4)),
    "colour_bytes": tuple(
        f"{way}Bytes_CW-SU{pipe}" for way in ("Read", "Write") for pipe in range(4)
    ),
}
"""A counter by unit -> the simulator's statistics that add up to it; an absent pipe has none."""

STATES = ("Draw_CP", "EndGeometry_CP", "EndFragment_CP")
"""What the command processor does from the first vertex of a draw to its last pixel: it counts a
cycle in each. Clearing before and swapping after are states of their own."""


@dataclass(frozen=True)
class Parameters:
    """bound : which part of the GPU is made to bind, if any."""

    bound: str = "shipped"


class Attila(Design):
    """ATTILA, a whole GPU."""

    name = "attila"
    parameters = Parameters
    choices: ClassVar[dict[str, tuple[Any, ...]]] = {"bound": tuple(BINDING)}
    counters = (*SHADED, *STATISTICS, "busiest_pipe_quads")
    sources = SOURCES

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._folder, built_from = program()
        self.details = {
            "renderer": "ATTILA, a simulated GPU",
            "version": "a64b572",
            "design": asdict(parameters),
            "built": built_from,
        }

    def count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        """Draw all triangles of the frame at once; every count is () of the whole draw."""
        if frame.width not in SIDES or frame.height not in SIDES:
            raise UsageError(
                f"attila draws {frame.width} x {frame.height} px not exactly: choose a resolution "
                f"of {', '.join(map(str, SIDES))}"
            )
        if not len(triangles):
            return {name: np.int64(0) for name in (*self.counters, CYCLES)}  # type: ignore[misc]
        bound = self._parameters.bound
        drawn = trace(frame, triangles, blended=bound == "fill")
        said = run(self._folder, drawn, BINDING[bound])
        covered = [round(said[f"Stamps{lanes}Fragment_TT"]) for lanes in range(5)]
        quads = sum(covered[1:])
        fragments = sum(lanes * number for lanes, number in enumerate(covered))
        pipes = [said.get(f"OperatedFragments_CW-SU{pipe}", 0.0) for pipe in range(4)]
        if sum(pipes) != quads:
            raise HarnessError(f"attila: {quads} quads traversed, {sum(pipes):.0f} were written")
        found = {
            "fragments": fragments,
            "quads": quads,
            "helper_lanes": 4 * quads - fragments,
            "partial_quads": sum(covered[1:4]),
            "busiest_pipe_quads": max(pipes),
            CYCLES: sum(said[state] for state in STATES),
        }
        for name, parts in STATISTICS.items():
            found[name] = sum(said.get(part, 0.0) for part in parts)
        return {name: np.asarray(round(value), np.int64) for name, value in found.items()}


def trace(frame: Frame, triangles: Triangles, *, blended: bool) -> str:
    """Return the text of an OpenGL program that draws `triangles` (m, 3) once, as ATTILA reads it.

    A place is a whole number of 1/256 px: eight decimals write it without rounding.
    """
    size = f"{frame.width}.0,0.0,{frame.height}.0"
    lines = [
        "GLI0.t",
        "glMatrixMode(GL_MODELVIEW)",
        "glLoadIdentity()",
        f"glOrtho(0.0,{size},-1.0,1.0)",
        f"glViewport(0,0,{frame.width},{frame.height})",
        "glClearColor(0.0,0.0,0.0,1.0)",
        "glClear(GL_COLOR_BUFFER_BIT)",
    ]
    if blended:
        lines += ["glEnable(GL_BLEND)", "glBlendFunc(GL_SRC_ALPHA,GL_ONE_MINUS_SRC_ALPHA)"]
    lines += ["glBegin(GL_TRIANGLES)", "glColor4f(1.0,0.5,0.25,0.5)"]
    places = (frame.points[triangles.ravel()] / 256).tolist()
    lines += [f"glVertex3f({x:.8f},{y:.8f},0.0)" for x, y in places]
    lines += ["glEnd()", "glFlush()", "wglSwapBuffers(0x00000000) = TRUE"]
    return "\n".join(lines) + "\n"


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
