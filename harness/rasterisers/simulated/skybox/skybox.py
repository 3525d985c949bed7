"""The design `skybox`: the raster slice alone, its counters and its cycles.

One slice of one published design: triangles come set up and sorted into tiles, and quads go to a
shader that is a counter. No caches, no depth test, no memory.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.figures.counters import CYCLES
from harness.frame import Frame
from harness.rasterisers.base import Counters, Image, Options, Triangles, per_polygon
from harness.rasterisers.reference import SHADED, colours
from harness.rasterisers.simulated.building import Lacking
from harness.rasterisers.simulated.design import Design
from harness.rasterisers.simulated.skybox import program
from harness.rasterisers.simulated.skybox.edges import Work, work

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
    counters = (
        *SHADED,
        *("tiles", "nodes", "tested_blocks", "beats"),
    )
    cuts = True
    pictured = True

    @classmethod
    def problem(cls) -> Lacking | None:
        """What lacks."""
        return program.problem()

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        built_with = {
            "TILE_LOGSIZE": parameters.tile.bit_length() - 1,
            "BLOCK_LOGSIZE": parameters.block.bit_length() - 1,
            "OUTPUT_QUADS": parameters.output_quads,
        }
        rtl = program.SOURCES.folder() / program.RTL
        self._program, built_from = program.program(rtl, built_with)
        self.details = {
            "renderer": "Skybox's raster slice, simulated",
            "version": built_from["tools"]["verilator"],  # type: ignore[index]
            "design": asdict(parameters),
            "built": built_from,
        }

    def count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        """Draw each of the frame's draws until its last quad is shaded."""
        todo = self._work(frame, triangles)
        found = self._run(frame, todo)
        counts = dict(zip(program.COUNTS, found.counts.T, strict=True))
        counts["helper_lanes"] = 4 * counts["quads"] - counts["fragments"]
        counts["tiles"] = np.bincount(todo.pairs[:, 0], minlength=len(triangles))
        return {
            **{name: per_polygon(frame, triangles, each) for name, each in counts.items()},
            CYCLES: found.cycles.sum(),
        }

    def image(self, frame: Frame, triangles: Triangles) -> Image:
        """Paint the pixels of the quads that come out."""
        quads = self._run(frame, self._work(frame, triangles), keep_quads=True).quads
        picture = np.zeros((frame.height, frame.width), np.uint32)
        paint = colours(frame.owner(triangles))
        owner, place = quads.T
        for bit in range(4):
            covered = place >> bit & 1 == 1
            x = (place[covered] >> 4 & 0x3FFF) * 2 + bit % 2
            y = (place[covered] >> 18) * 2 + bit // 2
            picture[y, x] = paint[owner[covered]]
        picture = np.ascontiguousarray(picture[::-1])
        return picture.view(np.uint8).reshape(*picture.shape, 4)

    def _work(self, frame: Frame, triangles: Triangles) -> Work:
        of = self._parameters
        drawn = (frame.points, triangles, frame.draws(triangles), _window(frame))
        return work(*drawn, of.tile, exact=of.bins == "exact")

    def _run(self, frame: Frame, todo: Work, *, keep_quads: bool = False) -> program.Run:
        of = self._parameters
        return program.run(self._program, todo, _window(frame), of.shader, of.fetch, keep_quads)


def _window(frame: Frame) -> NDArray[np.int64]:
    """First column and row, last column and row of the pixels that are drawn."""
    whole = np.array([0, 0, frame.width - 1, frame.height - 1], np.int64)
    return whole if frame.scissor is None else frame.window
