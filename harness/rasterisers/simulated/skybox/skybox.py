"""The design `skybox`: the raster slice alone, its counters and its cycles.

One slice of one published design, an open GPU written in SystemVerilog, run by Verilator: triangles
come set up and sorted into tiles, and quads go to a shader that is a counter. No caches, no depth
test, no memory.
"""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError, UsageError
from harness.figures.counters import CYCLES
from harness.frame import Frame
from harness.rasterisers.base import Counters, Options, Triangles, per_polygon
from harness.rasterisers.reference import SHADED
from harness.rasterisers.simulated.building import Files, built, digest, version
from harness.rasterisers.simulated.simulated import Design
from harness.rasterisers.simulated.skybox.edges import Work, work

HERE = Path(__file__).parent
WRAPPER = (HERE / "top.sv", HERE / "bench.cpp")
SOURCES = Files(
    "RASTER_HARNESS_SKYBOX",
    "clone vortexgpgpu/skybox at commit d06a9982 and let the variable name its folder",
    HERE / "sources.sha256",
)
RTL = Path("hw", "rtl")
COUNTS = ("nodes", "tested_blocks", "beats", "quads", "partial_quads", "fragments")
"""What the program counts of each triangle, in its order."""

MOST_SHADER, MOST_FETCH = 1024.0, 100_000
"""Cycles a quad, and between triangles."""


@dataclass(frozen=True)
class Parameters:
    """What a designer would turn; the values are those of the published design.

    output_quads : 2x2 quads that leave in one cycle, at most
    tile, block : sides in pixels of the largest and the smallest square that is tested
    bins : whether tiles are taken by a triangle's bounding box, or those that it meets
    shader : cycles that the shader takes for a quad, in sixteenths; 0: it takes all that come
    fetch : least cycles from one triangle in a tile to the next
    """

    output_quads: int = 4
    tile: int = 32
    block: int = 4
    bins: str = "bbox"
    shader: float = 0.0
    fetch: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.shader <= MOST_SHADER or self.shader % 0.0625:
            raise UsageError(
                f"skybox: shader={self.shader:g} is no multiple of 1/16 up to {MOST_SHADER:g}"
            )
        if not 0 <= self.fetch <= MOST_FETCH:
            raise UsageError(f"skybox: fetch={self.fetch} is outside 0..{MOST_FETCH} cycles")


class Skybox(Design):
    """Skybox's raster slice."""

    name = "skybox"
    parameters = Parameters
    choices: ClassVar[dict[str, tuple[Any, ...]]] = {
        "output_quads": (1, 2, 4, 8),
        "tile": (16, 32, 64),
        "block": (4, 8),
        "bins": ("bbox", "exact"),
    }
    counters = (*SHADED, "tiles", "nodes", "tested_blocks", "beats")
    cuts = True
    sources = SOURCES
    tools = ("verilator", "g++", "make")

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        built_with = {
            "TILE_LOGSIZE": parameters.tile.bit_length() - 1,
            "BLOCK_LOGSIZE": parameters.block.bit_length() - 1,
            "OUTPUT_QUADS": parameters.output_quads,
        }
        rtl = SOURCES.folder() / RTL
        self._program, built_from = program(rtl, built_with)
        self.details = {
            "renderer": "Skybox's raster slice, simulated",
            "version": built_from["tools"]["verilator"],  # type: ignore[index]
            "design": asdict(parameters),
            "built": built_from,
        }

    def count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        """Draw each of the frame's draws until its last quad is shaded."""
        of = self._parameters
        whole = np.array([0, 0, frame.width - 1, frame.height - 1], np.int64)
        window = whole if frame.scissor is None else frame.window
        drawn = (frame.points, triangles, frame.draws(triangles), window)
        todo = work(*drawn, of.tile, exact=of.bins == "exact")
        found = run(self._program, todo, window, of.shader, of.fetch)
        counts = dict(zip(COUNTS, found.counts.T, strict=True))
        counts["helper_lanes"] = 4 * counts["quads"] - counts["fragments"]
        counts["tiles"] = np.bincount(todo.pairs[:, 0], minlength=len(triangles))
        return {
            **{name: per_polygon(frame, triangles, each) for name, each in counts.items()},
            CYCLES: found.cycles.sum(),
        }


class Run(NamedTuple):
    """What a run of the program found.

    counts : (m, 6) of each triangle, columns as `COUNTS`
    cycles : (d,) of each draw
    quads : (q, 2) the triangle, and y / 2, x / 2 and the mask in 14, 14 and 4 bits
    """

    counts: NDArray[np.int64]
    cycles: NDArray[np.int64]
    quads: NDArray[np.uint32]


def program(rtl: Path, parameters: Mapping[str, int]) -> tuple[Path, dict[str, object]]:
    """Return the program of the slice, built if it was not, and what it was built from.

    rtl : the folder hw/rtl of Skybox
    parameters : of the module `top`
    """
    files = [rtl / Path(name).relative_to(RTL) for name in SOURCES.files()]
    facts = {
        "parameters": dict(parameters),
        "tools": {tool: version(tool) for tool in Skybox.tools[:2]},
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
