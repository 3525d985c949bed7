"""What every rasteriser can be asked, how a device is described, and the order of submission.

A rasteriser lives in a worker process of its own, because its drivers read their settings from
the environment once, when they are loaded, and because a driver that crashes must cost one case.
So nothing here may import a GL library at module level.
"""

from __future__ import annotations

import importlib.util
import os
import string
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriser, UsageError, unknown
from harness.machine import system
from harness.rasterisers.counters import Counter
from harness.settings import MOST_WORK, ORDERS, SAMPLES, Order
from scenes.spec import install

if TYPE_CHECKING:
    from harness.frame import Frame
    from scenes.scene import Viewing

Triangles = NDArray[np.int32]
Counters = dict[str, NDArray[np.int64]]
"""Counter name -> (p,) one exact integer a polygon of the frame, or () where the device only
gives a total."""


@dataclass(frozen=True)
class Options:
    """How a frame is drawn, apart from its triangles; recorded with every case.

    samples : samples a pixel, 1 (no multisampling), 4 or 8
    work : iterations of arithmetic a fragment, so that cost moves from set-up to shading
    order : order of submission; "native" is the triangulator's, "walk" from neighbour to
        neighbour, each turned so that its new vertex comes last, "vertex-cache" fan after fan as
        an optimiser for vertex caches gives it (Tipsify), "morton" along a space-filling curve
        over the triangles' centres, "shuffled" random with `seed`
    """

    samples: int = 1
    work: int = 0
    order: Order = "native"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.samples not in SAMPLES:
            raise UsageError(f"{self.samples} samples a pixel: choose 1, 4 or 8")
        if not 0 <= self.work <= MOST_WORK:
            raise UsageError(f"work {self.work} is outside 0..{MOST_WORK} iterations")
        if self.order not in ORDERS:
            raise unknown("order", self.order, ORDERS)


@dataclass(frozen=True)
class Device:
    """One thing a rasteriser can run on.

    name : as given to --device, e.g. "llvmpipe", "gpu0"
    software : True where a CPU does the rasterising
    environment : variables that must be set before the driver is loaded
    details : vendor, renderer, version strings as the driver reports them, and the like
    """

    name: str
    software: bool
    environment: Mapping[str, str] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)

    def require_environment(self) -> None:
        """Raise NoRasteriser if a variable of the environment is not set."""
        for key, value in self.environment.items():
            if os.environ.get(key) != value:
                raise NoRasteriser(f"{self.name} needs {key}={value} before its driver loads")


@dataclass(frozen=True)
class Sample:
    """Seconds that a batch of equal draws took.

    wall : by the wall clock
    gpu : by the GPU's timer, None where the device has none
    cpu : that all threads of this process were on a core
    waited : that its threads waited for one, None where the system does not tell
    """

    wall: float
    gpu: float | None = None
    cpu: float | None = None
    waited: float | None = None


class Stopwatch:
    """Times a batch from where it is made to `stop`, by the clocks of a `Sample` but the GPU's."""

    _queues = system.WaitedFor()

    def __init__(self) -> None:
        # What takes longest to read is outside of what is timed.
        self._waited = self._queues.read()
        self._cpu = time.process_time()
        self._wall = time.perf_counter()

    def stop(self) -> Sample:
        """Return the seconds since."""
        wall = time.perf_counter() - self._wall
        cpu = time.process_time() - self._cpu
        before, after = self._waited, self._queues.read()
        waited = None
        if before is not None and after is not None:
            waited = 1e-9 * sum(total - before.get(thread, 0) for thread, total in after.items())
        return Sample(wall=wall, cpu=cpu, waited=waited)


class Drawing(ABC):
    """One triangulation of one frame, uploaded and ready to be drawn again and again."""

    @abstractmethod
    def sample(self, repeats: int) -> Sample:
        """Draw `repeats` times, wait until the device has finished, and return the time of all."""

    def close(self) -> None:  # noqa: B027 - most is freed when nothing refers to it
        """Free what the drawing holds on the device."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Rasteriser(ABC):
    """Turns triangles into pixels on one device.

    Class attributes say what it can do: `name`; `counters`, the names `count` returns;
    `new_counters`, how those are shown that no built-in rasteriser has; `timed`, whether `prepare`
    works. Construct it only inside a worker process whose environment has been set to the
    device's.

    An implementation fills in `_count` and, where it can, `_prepare`; they get the triangles
    checked and in the order of submission.
    """

    name: ClassVar[str]
    counters: ClassVar[tuple[str, ...]] = ()
    new_counters: ClassVar[tuple[Counter, ...]] = ()
    timed: ClassVar[bool] = True

    shades: ClassVar[bool] = False
    """Whether it shades fragments, so that samples a pixel and work a fragment mean something."""

    lacking: ClassVar[str] = "neither multisampling nor fragment work"
    """What of `Options` it cannot do, said where nothing is left to draw."""

    cuts: ClassVar[bool] = False
    """Whether it draws nothing out of a frame's scissor, as map tiles need it."""

    deep: ClassVar[bool] = False
    """Whether it has a depth test that it counts with; then it counts `depth_ties`, too."""

    known: ClassVar[tuple[str, ...]] = ("cpu",)
    """Names of the devices it can run on somewhere, whether or not they work here."""

    module: ClassVar[str] = ""
    """What must be installed, by the extra of the rasteriser's name."""

    remedies: ClassVar[Mapping[str, str]] = {}
    """What makes a device work here, by its name without a number; "": any other."""

    device: Device

    @classmethod
    def knows(cls, name: str) -> bool:
        """Whether `name` is a device of this rasteriser on some machine.

        One that knows gpu0 knows gpu1, gpu2, ..., too.
        """
        numbered = name.startswith("gpu") and name[3:].isdigit()
        return name in cls.known or (numbered and "gpu0" in cls.known)

    @classmethod
    def find(cls, name: str) -> Device | None:
        """Return the device called `name`, or None where it does not work here."""
        return next((device for device in cls.devices() if device.name == name), None)

    @classmethod
    def supports(cls, options: Options) -> bool:
        """Whether it can draw with `options`."""
        return cls.shades or (options.samples == 1 and options.work == 0)

    @classmethod
    def remedy(cls, name: str | None = None) -> str:
        """Say in a clause how to make the device `name`, or any device, work here."""
        if cls.module and importlib.util.find_spec(cls.module) is None:
            return f"run: {install(cls.name)}"
        told = cls.remedies.get((name or "").rstrip(string.digits)) or cls.remedies.get("")
        choose = f"choose one of: {', '.join(cls.known)}" if name else "see `raster-harness doctor`"
        return told or choose

    @classmethod
    @abstractmethod
    def devices(cls) -> list[Device]:
        """List what it can run on here, best first; [] where there is none.

        Loads no driver into the calling process.
        """

    @abstractmethod
    def __init__(self, device: Device) -> None:
        """Open the device.

        Raises
        ------
        harness.errors.NoRasteriser
            if it cannot be opened, or turns out to be another device than was asked for
        """

    def count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        """Count, exactly, what drawing `triangles` (m, 3) over `frame.points` costs.

        Raises
        ------
        harness.errors.UsageError
            if the device cannot draw the frame that large, or with these options
        ValueError
            if `triangles` is not an integer (m, 3) array of vertices of the frame
        """
        return self._count(frame, self._ready(frame, triangles, options), options)

    def prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        """Upload `triangles` for timing; nothing is counted while it is drawn.

        Raises
        ------
        harness.errors.UsageError
            as for `count`, or if the rasteriser is not timed
        """
        if not self.timed:
            raise UsageError(f"rasteriser {self.name} has no time to measure")
        return self._prepare(frame, self._ready(frame, triangles, options), options)

    def _ready(self, frame: Frame, triangles: Triangles, options: Options) -> Triangles:
        if not self.supports(options):
            raise UsageError(f"{self.name} has {self.lacking}; use opengl for these")
        if frame.scissor is not None and not self.cuts:
            raise UsageError(f"{self.name} cannot cut at a tile's edge; use opengl for tiles")
        if frame.depths is not None and not self.deep:
            raise UsageError(
                f"{self.name} cannot force the depth test before shading; use opengl, or depth=none"
            )
        return submission(frame, triangles, options)

    def close(self) -> None:  # noqa: B027 - most have nothing to close
        """Close the device."""

    @abstractmethod
    def _count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters: ...

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        raise NotImplementedError


CPU = Device(name="cpu", software=True)


class OnCpu(Rasteriser):
    """A rasteriser of our own that needs no driver, on every machine."""

    @classmethod
    def devices(cls) -> list[Device]:
        """The CPU."""
        return [CPU]

    def __init__(self, device: Device = CPU) -> None:
        self.device = device


def per_polygon(frame: Frame, triangles: Triangles, values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sum (m,) values, one a triangle, to (p,), one a polygon of the frame."""
    totals = np.zeros(len(frame.offsets) - 1, np.int64)
    np.add.at(totals, frame.owner(triangles), values)
    return totals


def batches(frame: Frame, triangles: Triangles, most: int = 2**32) -> list[Triangles]:
    """Split `triangles` so that no batch shades `most` lanes, that no counter of 32 bits wraps.

    With a depth test a batch is a view, of at most 2^28 pixels.

    A triangle touches at most the quads of its bounding box.
    """
    from harness.frame import SUBPIXEL

    corners = frame.points[triangles].astype(np.int64)
    sides = (corners.max(axis=1) - corners.min(axis=1)) // SUBPIXEL + 4
    lanes: NDArray[np.int64] = np.cumsum(sides.prod(axis=1))
    if frame.depths is not None:  # a view hides only what is drawn in the same batch
        return [triangles[rows] for rows in frame.draws(triangles)]
    if not len(lanes) or lanes[-1] < most:
        return [triangles]
    return np.split(triangles, np.flatnonzero(np.diff(lanes // (most // 2))) + 1)


def submission(frame: Frame, triangles: Triangles, options: Options) -> Triangles:
    """Check `triangles` (m, 3) and return them, contiguous, in the order of submission.

    Tiles and views stay one after another; within each, triangles are ordered. Of a model's views
    the native order is the model's, or front to back.

    Raises
    ------
    ValueError
        if `triangles` is not an integer (m, 3) array of vertices of the frame
    """
    array = np.asarray(triangles)
    if array.ndim != 2 or array.shape[1] != 3 or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(f"triangles must be an integer (m, 3) array, not {array.shape}")
    if len(array) and not (array.min() >= 0 and array.max() < len(frame.points)):
        raise ValueError(f"a triangle names a vertex outside 0..{len(frame.points) - 1}")
    if frame.viewing is not None and options.order == "native":
        view = np.searchsorted(frame.viewing.first, frame.owner(array), side="right")
        array = array[np.lexsort((_places(frame, frame.viewing, array), view))]
    elif frame.tiles is None:
        array = _ordered(frame, array, options)
    else:
        tiles = [_ordered(frame, array[rows], options) for rows in frame.draws(array)]
        array = np.concatenate(tiles)
    return np.ascontiguousarray(array, np.int32)


def _places(frame: Frame, viewing: Viewing, array: Triangles) -> NDArray[np.int64]:
    """(m,) where each triangle, piece by piece in `array`, is in the order of its view.

    The k-th triangle of a face takes the place of the k-th that the model has there.
    """
    if viewing.near_first and viewing.depths is not None:
        return np.asarray(viewing.depths[array].astype(np.int64).sum(axis=1))
    owner = frame.owner(array)
    ordered = np.argsort(owner, kind="stable")
    number = np.empty(len(array), np.int64)
    number[ordered] = np.arange(len(array)) - np.searchsorted(owner[ordered], owner[ordered])
    starts = viewing.rank_starts
    last = np.diff(starts)[owner] - 1
    return np.asarray(viewing.ranks[starts[owner] + np.minimum(number, last)])


def _ordered(frame: Frame, array: Triangles, options: Options) -> Triangles:
    if options.order == "walk":
        from triangulators.geometry.order import walk

        return walk(array, len(frame.points))
    if options.order == "vertex-cache":
        from triangulators.geometry.order import vertex_cache_order

        return vertex_cache_order(array, len(frame.points))
    if options.order == "morton":
        return array[np.argsort(_morton(frame, array), kind="stable")]
    if options.order == "shuffled":
        return np.random.default_rng(options.seed).permutation(array)
    return array


def _morton(frame: Frame, triangles: Triangles) -> NDArray[np.uint64]:
    """Interleave the bits of each triangle's centre: (m,) positions along a Z-order curve."""
    centre = frame.points[triangles].astype(np.int64).sum(axis=1) // 3
    octets = np.maximum(centre, 0).astype("<u4")[..., None].view(np.uint8)
    bits = np.unpackbits(octets, axis=-1, bitorder="little")  # (m, 2, 32), those of x first
    mixed = np.packbits(bits.swapaxes(1, 2).reshape(-1, 64), axis=-1, bitorder="little")
    return mixed.view("<u8")[:, 0]


def check_size(width: int, height: int, most: int) -> None:
    """Raise UsageError if a viewport is larger than the device draws."""
    if max(width, height) > most:
        raise UsageError(
            f"{width}x{height} px is more than the device's {most}; lower --resolution"
        )


@cache
def shader(name: str) -> str:
    """Return the text of a file in shaders/, e.g. "draw.wgsl"."""
    return files("harness.rasterisers").joinpath("shaders", name).read_text(encoding="utf-8")
