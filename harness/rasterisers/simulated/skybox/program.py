"""Builds the simulation of Skybox's raster slice, and runs it over what is to be drawn."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.rasterisers.simulated.building import Lacking, built, digest, lacking, version
from harness.rasterisers.simulated.skybox.edges import Work
from harness.rasterisers.simulated.sources import Sources

HERE = Path(__file__).parent
WRAPPER = (HERE / "top.sv", HERE / "bench.cpp")
TOOLS = ("verilator", "g++", "make")
SOURCES = Sources(
    "RASTER_HARNESS_SKYBOX",
    "clone vortexgpgpu/skybox at commit d06a9982 and let the variable name its folder",
    HERE / "sources.sha256",
)
RTL = Path("hw", "rtl")
COUNTS = ("nodes", "tested_blocks", "beats", "quads", "partial_quads", "fragments")
"""What the program counts of each triangle, in its order."""


class Run(NamedTuple):
    """What a run of the program found.

    counts : (m, 6) of each triangle, columns as `COUNTS`
    cycles : (d,) of each draw
    quads : (q, 2) the triangle, and y / 2, x / 2 and the mask in 14, 14 and 4 bits
    """

    counts: NDArray[np.int64]
    cycles: NDArray[np.int64]
    quads: NDArray[np.uint32]


def problem() -> Lacking | None:
    """Say what lacks to build it, or None."""
    return SOURCES.problem() or lacking(TOOLS)


def program(rtl: Path, parameters: Mapping[str, int]) -> tuple[Path, dict[str, object]]:
    """Return the program of the slice, built if it was not, and what it was built from.

    rtl : the folder hw/rtl of Skybox
    parameters : of the module `top`
    """
    files = [rtl / Path(name).relative_to(RTL) for name in SOURCES.files()]
    facts = {
        "parameters": dict(parameters),
        "tools": {tool: version(tool) for tool in TOOLS[:2]},
    }
    key = digest([*files, *WRAPPER], facts)
    folders = [f"-I{rtl / part}" for part in ("", "libs", "raster")]

    def commands(made: Path) -> list[list[str]]:
        command = ["verilator", "--cc", "--exe", "--build", "--top-module", "top"]
        command += ["-O3", "--x-assign", "0", "--x-initial", "0", "-DNDEBUG"]
        command += ["-Wno-fatal", "-Wno-lint", "-Wno-style"]
        command += ["-CFLAGS", "-std=c++17", "-MAKEFLAGS", "OPT_FAST=-O2"]
        command += [f"-G{name}={value}" for name, value in parameters.items()]
        command += [*folders, str(rtl / "raster" / "VX_raster_pkg.sv"), *map(str, WRAPPER)]
        return [[*command, "-Mdir", str(made), "-o", "skybox"]]

    return built("skybox", key, commands) / "skybox", {**facts, "digest": key}


def run(
    file: Path,
    work: Work,
    window: NDArray[np.int64],
    shader: float = 0.0,
    fetch: int = 0,
    keep_quads: bool = False,
) -> Run:
    """Draw the work and count.

    window : first column and row, last column and row of the pixels that are drawn
    shader : cycles that a quad is shaded for, a multiple of 1/16
    fetch : least cycles from one triangle in a tile to the next
    """
    left, bottom, right, top = window
    sizes = [len(work.pairs), len(work.edges), len(work.ends), round(16 * shader), fetch]
    settings = [*sizes, left, right + 1, bottom, top + 1, keep_quads]
    sent = b"".join(
        np.ascontiguousarray(part, np.int32).tobytes()
        for part in (settings, work.edges, work.ends, work.pairs)
    )
    done = subprocess.run([str(file)], input=sent, capture_output=True)
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip() or f"it ended with {done.returncode}"
        raise HarnessError(said)
    told = np.frombuffer(done.stdout, np.int32)
    counted = len(work.edges) * len(COUNTS)
    counts = told[:counted].reshape(-1, len(COUNTS)).astype(np.int64)
    halves = told[counted : counted + 2 * len(work.ends)]
    quads = told[counted + len(halves) + 1 :].view(np.uint32).reshape(-1, 2)
    return Run(counts, halves.view(np.int64) if len(halves) else np.empty(0, np.int64), quads)
