"""The design `skybox`: the raster slice alone, its counters and its cycles.

One slice of one published design, an open GPU written in SystemVerilog, run by Verilator: triangles
come set up and sorted into tiles, and quads go to a shader that is a counter. No caches, no depth
test, no memory. What it is fed are edge functions in pixels, and the tiles that may be met.

A counter-clockwise triangle covers a pixel's centre P where, for each edge from A to B,

    E(P) = (B - A) x (P - A) > 0,

or E(P) = 0 and the edge is a left or a bottom one (`harness.rasterisers.spans` has the rule). All
of that is in whole 1/256 px, so "or 0" is made part of the test by taking 1 from E of the other
edges. With P = (256 x + 128, 256 y + 128), the centre of pixel (x, y), and (dx, dy) = B - A,

    E = 256 (a x + b y) + k,   a = -dy,   b = dx,   k = dx (128 - Ay) - dy (128 - Ax) - (0 or 1).

256 (a x + b y) + k >= 0 exactly where a x + b y + floor(k / 256) >= 0, because a x + b y is whole.
So the slice gets a, b and c = floor(k / 256): exact at 1/256 px, with eight bits less.

Whether 32 bits hold: all that the slice works out is a x + b y + c at pixels of tiles that it is
given, and at tiles' far corners. It adds up modulo 2**32, so sums on the way do no harm. The
function is linear: over the rectangle of a triangle's tiles it is largest and smallest at the
rectangle's corners, and those are looked at. At 1024 px |a|, |b| <= 2**18 and distances from the
edge are at most 1024 px, so 2 * 2**18 * 2**10 = 2**29 is the most: 32 bits hold every triangle.
"""

import hashlib
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError, UsageError
from harness.frame import SUBPIXEL, Frame
from harness.rasterisers.base import Counters, Options, Triangles, per_polygon
from harness.rasterisers.counters import CYCLES
from harness.rasterisers.reference import SHADED, tile_box, tile_span
from harness.rasterisers.simulated import Design
from harness.rasterisers.simulated.building import Sources, built, digest, version
from triangulators.compute.kernels import njit

HERE = Path(__file__).parent
WRAPPER = (HERE / "top.sv", HERE / "bench.cpp")
LISTED = (HERE / "sources.sha256").read_bytes()
"""Of each file that is used its digest and its name."""

SOURCES = Sources(
    "RASTER_HARNESS_SKYBOX",
    "clone vortexgpgpu/skybox at commit d06a9982 and let the variable name its folder",
    tuple(line.split()[1].decode() for line in LISTED.splitlines()),
    hashlib.sha256(LISTED).hexdigest(),
    ("verilator", "g++", "make"),
)
RTL = Path("hw", "rtl")
COUNTS = ("nodes", "tested_blocks", "beats", "quads", "partial_quads", "fragments")
"""What the program counts of each triangle, in its order."""

LIMIT = 2**31
"""What a signed number of the slice's 32 bits stays below."""

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
        counted, cycles, _ = run(self._program, todo, window, of.shader, of.fetch)
        counts = dict(zip(COUNTS, counted.T, strict=True))
        counts["helper_lanes"] = 4 * counts["quads"] - counts["fragments"]
        counts["tiles"] = np.bincount(todo.pairs[:, 0], minlength=len(triangles))
        return {
            **{name: per_polygon(frame, triangles, each) for name, each in counts.items()},
            CYCLES: cycles.sum(),
        }


class Work(NamedTuple):
    """What is drawn.

    edges : (m, 3, 3) int32, a, b, c of the three edges of each triangle
    pairs : (n, 3) int32, the triangle and its tile's lower left pixel, in the order of drawing
    ends : (d,) int32, how many pairs there are up to the end of each draw
    """

    edges: NDArray[np.int32]
    pairs: NDArray[np.int32]
    ends: NDArray[np.int32]


def edge_functions(points: NDArray[np.int32], triangles: Triangles) -> NDArray[np.int64]:
    """Return (m, 3, 3): a, b and c of the edges of each triangle, whichever way it winds."""
    corners = points[triangles].astype(np.int64)
    first, second = (corners[:, k] - corners[:, 0] for k in (1, 2))
    clockwise = first[:, 0] * second[:, 1] < first[:, 1] * second[:, 0]
    corners[clockwise] = corners[clockwise][:, ::-1]
    step = np.roll(corners, -1, axis=1) - corners
    dx, dy = step[..., 0], step[..., 1]
    closed = (dy < 0) | ((dy == 0) & (dx > 0))
    half = SUBPIXEL // 2 - corners
    constant = dx * half[..., 1] - dy * half[..., 0] - ~closed
    return np.stack([-dy, dx, constant // SUBPIXEL], axis=-1)


def work(
    points: NDArray[np.int32],
    triangles: Triangles,
    draws: list[slice],
    window: NDArray[np.int64],
    tile: int,
    exact: bool,
) -> Work:
    """Set up the triangles (m, 3) of each draw and put them into tiles of `tile` px.

    Tiles are drawn row by row, each with its triangles in their order, as Skybox's driver sorts
    them. The driver takes all tiles that a bounding box meets; `exact` takes those alone that the
    triangle itself meets, which is not Skybox's. A triangle without area is in no tile.

    Raises
    ------
    UsageError
        if a triangle is too large for the slice's 32 bits
    """
    edges = edge_functions(points, triangles)
    _refuse_overflow(points, triangles, edges, tile)
    parts, ends, total = [], [], 0
    for rows in draws:
        pairs = bins(points, triangles[rows], tile * SUBPIXEL, window // tile, exact)
        pairs = pairs[np.lexsort((pairs[:, 0], pairs[:, 1], pairs[:, 2]))]
        pairs[:, 0] += rows.start
        pairs[:, 1:] *= tile
        parts.append(pairs)
        total += len(pairs)
        ends.append(total)
    pairs = np.concatenate(parts) if parts else np.empty((0, 3), np.int32)
    return Work(edges.astype(np.int32), pairs, np.array(ends, np.int32))


def _refuse_overflow(
    points: NDArray[np.int32], triangles: Triangles, edges: NDArray[np.int64], tile: int
) -> None:
    side = tile * SUBPIXEL
    corners = points[triangles].astype(np.int64)
    low = corners.min(axis=1) // side * tile
    high = ((corners.max(axis=1) - 1) // side + 1) * tile
    most = np.zeros(len(triangles), np.int64)
    for x in (low[:, 0], high[:, 0]):
        for y in (low[:, 1], high[:, 1]):
            values = edges[..., 0] * x[:, None] + edges[..., 1] * y[:, None] + edges[..., 2]
            most = np.maximum(most, np.abs(values).max(axis=1, initial=0))
    most = np.maximum(most, np.abs(edges).max(axis=(1, 2), initial=0))
    if (most >= LIMIT).any():
        number = int(np.argmax(most >= LIMIT))
        extent = np.ptp(corners[number], axis=0).max() / SUBPIXEL
        raise UsageError(
            f"skybox has 32 bits, too few for a triangle of {extent:.0f} px: "
            "choose a resolution of 1024 or less"
        )


@njit(error_model="numpy")
def bins(
    points: NDArray[np.int32],
    triangles: NDArray[np.int32],
    side: int,
    window: NDArray[np.int64],
    exact: bool,
) -> NDArray[np.int32]:
    """Return (n, 3): a triangle, and column and row of a tile of `side` (1/256 px) it is put into.

    window : first column and row, last column and row of the tiles that are drawn
    """
    found = np.empty((64, 3), np.int32)
    corners = np.zeros((3, 2), np.int64)
    number = 0
    for t in range(len(triangles)):
        left, right, bottom, top = tile_box(points, triangles[t], side, window, corners)
        for row in range(bottom, top + 1):
            low, high = left, right
            if exact:
                low, high = tile_span(corners, row, side, left, right)
            for column in range(low, high + 1):
                if number == len(found):
                    larger = np.empty((2 * number, 3), np.int32)
                    larger[:number] = found
                    found = larger
                found[number] = t, column, row
                number += 1
    return found[:number].copy()


def program(rtl: Path, parameters: Mapping[str, int]) -> tuple[Path, dict[str, object]]:
    """Return the program of the slice, built if it was not, and what it was built from.

    rtl : the folder hw/rtl of Skybox
    parameters : of the module `top`
    """
    files = [rtl / Path(name).relative_to(RTL) for name in SOURCES.parts]
    facts = {
        "parameters": dict(parameters),
        "tools": {tool: version(tool) for tool in SOURCES.tools[:2]},
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
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint32]]:
    """Draw the work; return counts, cycles and, if `keep_quads`, quads.

    window : first column and row, last column and row of the pixels that are drawn
    shader, fetch : as in `Parameters`

    Counts (m, 6) are of each triangle, columns as `COUNTS`, cycles (d,) of each draw; quads (q, 2)
    are the triangle, and y / 2, x / 2 and the mask in 14, 14 and 4 bits.
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
    return counts, np.frombuffer(halves.tobytes(), np.int64), quads
