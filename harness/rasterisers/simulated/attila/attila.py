"""The design `attila`: a whole GPU, from the command processor to memory.

It has vertex work, set-up, a recursive rasteriser, hierarchical Z, unified shaders and caches. One
configuration is its authors'; in each of three others one part is made to bind.

Each draw is a process of its own, which begins with empty caches and queues.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from harness.errors import HarnessError, UsageError
from harness.figures.counters import CYCLES
from harness.frame import Frame
from harness.rasterisers.base import Counters, Options, Triangles
from harness.rasterisers.reference import SHADED
from harness.rasterisers.simulated.attila import program
from harness.rasterisers.simulated.building import Lacking
from harness.rasterisers.simulated.design import Design

SIDES = (64, 128, 256, 512, 1024)
"""Sides in pixels of a viewport that moves no vertex: ATTILA maps a vertex to -1 to 1 and back in
float, which is exact for 1/256 px where the side is a power of two and 24 bits hold the place."""

BINDING: Mapping[str, program.Settings] = {
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
    counters = (
        *SHADED,
        *(*STATISTICS, "busiest_pipe_quads"),
    )

    @classmethod
    def problem(cls) -> Lacking | None:
        """What lacks."""
        return program.problem()

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._folder, built_from = program.program()
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
        said = program.run(self._folder, drawn, BINDING[bound])
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
