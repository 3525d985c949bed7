"""Interface of rasterisers, devices, drawings, and the submission order of triangles.

A rasteriser runs in a worker process, because drivers read their settings from the environment
once, when loaded, and a driver's crash must cost only one case. Importing this module loads no GL
library, so that a worker can set the environment first.
"""

from __future__ import annotations

import importlib.util
import os
import string
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriserError, UsageError, make_unknown_name_error
from harness.machine import system
from harness.rasterisers.counters import Counter
from harness.settings import MAX_LOOKUPS, MAX_WORK, ORDERS, SAMPLES, Order
from scenes.spec import format_install_command

if TYPE_CHECKING:
    from harness.frame import Frame, Viewing

Triangles = NDArray[np.int32]
Counters = dict[str, NDArray[np.int64]]
"""Exact counts by name, e.g. "quads": for each polygon, (p,), or the frame's total, ()."""


@dataclass(frozen=True, order=True)
class Options:
    """Options of drawing a frame, recorded with every case.

    samples : samples per pixel, 1 (no multisampling), 4 or 8
    work : iterations of arithmetic per fragment, to shift the cost from set-up to shading
    texture : trilinear lookups per fragment in a mip-mapped texture, 0 for none
    order : submission order; "native": the triangulator's; "walk": from neighbour to neighbour,
        each triangle rotated so that the new vertex comes last; "vertex-cache": optimised for
        vertex caches, fan by fan (Tipsify); "morton": along a space-filling curve over the
        triangles' centres; "shuffled": random with `seed`
    """

    samples: int = 1
    work: int = 0
    order: Order = "native"
    seed: int = 0
    texture: int = 0

    def __post_init__(self) -> None:
        if self.samples not in SAMPLES:
            raise UsageError(f"unsupported {self.samples} samples per pixel (choose from 1, 4, 8)")
        if not 0 <= self.work <= MAX_WORK:
            raise UsageError(f"work {self.work} is out of range (0 to {MAX_WORK} iterations)")
        if not 0 <= self.texture <= MAX_LOOKUPS:
            raise UsageError(f"{self.texture} texture lookups: out of range (0 to {MAX_LOOKUPS})")
        if self.order not in ORDERS:
            raise make_unknown_name_error("order", self.order, ORDERS)

    def to_json(self) -> dict[str, Any]:
        """Return the options by name; omit a `texture` of 0, which older records do not have."""
        values = asdict(self)
        return values if self.texture else {n: v for n, v in values.items() if n != "texture"}


@dataclass(frozen=True)
class Device:
    """A device that can run a rasteriser.

    name : as given to --device, e.g. "llvmpipe", "gpu0"
    software : True if a CPU rasterises
    environment : variables that must be set before the driver is loaded
    details : vendor, renderer and version strings of the driver, and similar properties
    """

    name: str
    software: bool
    environment: Mapping[str, str] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)

    def require_environment(self) -> None:
        """Raise NoRasteriserError unless this process has the variables of `environment`."""
        for key, value in self.environment.items():
            if os.environ.get(key) != value:
                raise NoRasteriserError(f"{self.name}: set {key}={value} before the driver loads")


@dataclass(frozen=True)
class Sample:
    """Seconds that a batch of equal draws took.

    wall : wall-clock time
    gpu : time by the GPU's timer, or None without a timer
    cpu : CPU time of all threads of this process
    waited : time that the threads waited for a core, or None if the system does not report it
    """

    wall: float
    gpu: float | None = None
    cpu: float | None = None
    waited: float | None = None


class Stopwatch:
    """A stopwatch that runs from construction to `stop` and reads all clocks except the GPU's."""

    _queues = system.RunQueueClock()

    def __init__(self) -> None:
        # The clock that takes longest to read is read first, outside the measured interval.
        self._waited = self._queues.read()
        self._cpu = time.process_time()
        self._wall = time.perf_counter()

    def stop(self) -> Sample:
        """Return the seconds since construction."""
        wall = time.perf_counter() - self._wall
        cpu = time.process_time() - self._cpu
        before, after = self._waited, self._queues.read()
        waited = None
        if before is not None and after is not None:
            waited = 1e-9 * sum(total - before.get(thread, 0) for thread, total in after.items())
        return Sample(wall=wall, cpu=cpu, waited=waited)


class Drawing(ABC):
    """A triangulation of a frame, uploaded and ready to be drawn repeatedly."""

    @abstractmethod
    def sample(self, repeats: int) -> Sample:
        """Draw `repeats` times, wait for the device, and return the total time."""

    def close(self) -> None:  # noqa: B027 - most resources are freed with their last reference
        """Free the drawing's resources on the device."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Rasteriser(ABC):
    """A rasteriser of triangles on a device.

    Class attributes declare capabilities: `name`; `counters`, the names that `draw_and_count`
    returns; `new_counters`, the display properties of counters that no built-in rasteriser has;
    `timed`, whether `prepare` works. Construct a rasteriser only inside a worker process with the
    device's environment.

    An implementation overrides `_draw_and_count`, which may count without drawing, and, if it can
    be timed, `_prepare`; both get validated triangles in submission order.
    """

    name: ClassVar[str]
    counters: ClassVar[tuple[str, ...]] = ()
    new_counters: ClassVar[tuple[Counter, ...]] = ()
    timed: ClassVar[bool] = True

    shades_fragments: ClassVar[bool] = False  # required by `Options.samples` and `Options.work`
    supports_texture: ClassVar[bool] = False  # required by `Options.texture`

    # Completes the message "NAME does not support these options (it has ...)".
    limitation: ClassVar[str] = "neither multisampling nor fragment work nor textures"

    draws_indexed: ClassVar[bool] = False  # if so, vertex batches are counted as well
    supports_scissor: ClassVar[bool] = False  # required by map tiles, `Frame.scissor`
    supports_depth: ClassVar[bool] = False  # a rasteriser that counts then also counts `depth_ties`
    device_names: ClassVar[tuple[str, ...]] = ("cpu",)  # whether or not they work here
    module: ClassVar[str] = ""  # Python module that the extra with the rasteriser's name installs

    # Instructions to make a device work, by its name without the number, e.g. "gpu"; the entry ""
    # is for all other devices.
    remedies: ClassVar[Mapping[str, str]] = {}

    device: Device

    @classmethod
    def is_device_name(cls, name: str) -> bool:
        """Return whether a device is supported, on any machine; gpu0 includes gpu1, gpu2, ..."""
        numbered = name.startswith("gpu") and name[3:].isdigit()
        return name in cls.device_names or (numbered and "gpu0" in cls.device_names)

    @classmethod
    def find(cls, name: str) -> Device | None:
        """Return the device called `name`, or None if missing on this machine."""
        return next((device for device in cls.devices() if device.name == name), None)

    @classmethod
    def supports(cls, options: Options) -> bool:
        """Return whether `options` are supported."""
        is_shaded = cls.shades_fragments or (options.samples == 1 and options.work == 0)
        return is_shaded and (cls.supports_texture or options.texture == 0)

    @classmethod
    def remedy(cls, name: str | None = None) -> str:
        """Return an instruction that makes the device `name`, or any device, usable."""
        if cls.module and importlib.util.find_spec(cls.module) is None:
            return f"run: {format_install_command(cls.name)}"
        remedy = cls.remedies.get((name or "").rstrip(string.digits)) or cls.remedies.get("")
        choose = f"choose from {', '.join(cls.device_names)}"
        return remedy or (choose if name else "see `raster-harness doctor`")

    @classmethod
    @abstractmethod
    def devices(cls) -> list[Device]:
        """List the devices that work here, in order of preference, without loading drivers."""

    @abstractmethod
    def __init__(self, device: Device) -> None:
        """Open the device; raise NoRasteriserError if that fails or another device opens."""

    def draw_and_count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        """Draw `triangles` (m, 3), rows of three vertices of `frame.points`, and count the work.

        Returns exact counts of the rasteriser's `counters`, e.g. shaded quads, for each polygon.

        Raises
        ------
        harness.errors.UsageError
            if the device does not support the frame's size or the options
        ValueError
            if `triangles` is not an integer (m, 3) array of vertices of the frame
        """
        return self._draw_and_count(
            frame, self._check_and_order(frame, triangles, options), options
        )

    def prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        """Upload `triangles` to be drawn repeatedly for timing, without counting.

        Raises
        ------
        harness.errors.UsageError
            as for `draw_and_count`, or if the rasteriser is not timed
        """
        if not self.timed:
            raise UsageError(
                f"{self.name} only counts and cannot be timed; choose another rasteriser"
            )
        return self._prepare(frame, self._check_and_order(frame, triangles, options), options)

    def _check_and_order(self, frame: Frame, triangles: Triangles, options: Options) -> Triangles:
        if not self.supports(options):
            raise UsageError(
                f"{self.name} does not support these options (it has {self.limitation}); use opengl"
            )
        if frame.scissor is not None and not self.supports_scissor:
            raise UsageError(f"{self.name} does not support map tiles (scissor); use opengl")
        if frame.depths is not None and not self.supports_depth:
            raise UsageError(
                f"{self.name} does not test depth before shading; use opengl, or depth=none"
            )
        return order_submission(frame, triangles, options)

    def close(self) -> None:  # noqa: B027 - most rasterisers have nothing to close
        """Close the device."""

    @abstractmethod
    def _draw_and_count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters: ...

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        raise NotImplementedError


CPU = Device(name="cpu", software=True)


class CpuRasteriser(Rasteriser):
    """A built-in CPU rasteriser, which needs no driver and works on every machine."""

    @classmethod
    def devices(cls) -> list[Device]:
        """Return the CPU."""
        return [CPU]

    def __init__(self, device: Device = CPU) -> None:
        self.device = device


def sum_per_polygon(
    frame: Frame, triangles: Triangles, values: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the sum of `values` (m,), one per triangle, over each polygon's triangles, (p,)."""
    totals = np.zeros(len(frame.grid), np.int64)
    np.add.at(totals, frame.find_owners(triangles), values)
    return totals


def split_batches(frame: Frame, triangles: Triangles, max_lanes: int = 2**32) -> list[Triangles]:
    """Split `triangles` (m, 3) so that a batch shades fewer than `max_lanes` lanes (4 per quad).

    Devices count with 32 bits. A triangle is assumed to shade its bounding box. With a depth test
    each view is one batch, of at most 2^28 pixels.
    """
    from harness.grid import SUBPIXEL

    corners = frame.points[triangles].astype(np.int64)
    sides = (corners.max(axis=1) - corners.min(axis=1)) // SUBPIXEL + 4
    lanes: NDArray[np.int64] = np.cumsum(sides.prod(axis=1))
    if frame.depths is not None:  # triangles occlude each other only within a batch
        return [triangles[rows] for rows in frame.split_by_draw(triangles)]
    if not len(lanes) or lanes[-1] < max_lanes:
        return [triangles]
    return np.split(triangles, np.flatnonzero(np.diff(lanes // (max_lanes // 2))) + 1)


def order_submission(frame: Frame, triangles: Triangles, options: Options) -> Triangles:
    """Check `triangles` (m, 3) and return a contiguous array in the order `options.order`.

    Only the triangles within a tile or view are reordered. The order "native" of a view is that of
    the model's file, or front to back if `Viewing.front_to_back`.
    """
    array = np.asarray(triangles)
    if array.ndim != 2 or array.shape[1] != 3 or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(f"triangles must be an integer (m, 3) array, not {array.shape}")
    if len(array) and not (array.min() >= 0 and array.max() < len(frame.points)):
        raise ValueError(f"triangles: vertex index out of range (0 to {len(frame.points) - 1})")
    if frame.viewing is not None and options.order == "native":
        view = np.searchsorted(frame.viewing.piece_offsets, frame.find_owners(array), side="right")
        array = array[np.lexsort((_rank_in_view(frame, frame.viewing, array), view))]
    else:
        draws = [_apply_order(frame, array[rows], options) for rows in frame.split_by_draw(array)]
        array = np.concatenate(draws)
    return np.ascontiguousarray(array, np.int32)


def _rank_in_view(frame: Frame, viewing: Viewing, array: Triangles) -> NDArray[np.int64]:
    """Return keys (m,) by which triangles are sorted within their view.

    With `viewing.front_to_back` the key is the sum of the vertices' depths; otherwise the position
    in the model's file of the face's triangle with the same number, or of the last if it has fewer.
    """
    if viewing.front_to_back and viewing.depths is not None:
        return np.asarray(viewing.depths[array].astype(np.int64).sum(axis=1))
    owner = frame.find_owners(array)
    ordered = np.argsort(owner, kind="stable")
    number = np.empty(len(array), np.int64)
    number[ordered] = np.arange(len(array)) - np.searchsorted(owner[ordered], owner[ordered])
    offsets = viewing.rank_offsets
    last = np.diff(offsets)[owner] - 1
    return np.asarray(viewing.ranks[offsets[owner] + np.minimum(number, last)])


def _apply_order(frame: Frame, array: Triangles, options: Options) -> Triangles:
    if options.order in ("walk", "vertex-cache"):
        from triangulators.geometry.order import put_in_walk_order, sort_for_vertex_cache

        reorder = put_in_walk_order if options.order == "walk" else sort_for_vertex_cache
        return reorder(array, len(frame.points))
    if options.order == "morton":
        return array[np.argsort(_compute_morton_codes(frame, array), kind="stable")]
    if options.order == "shuffled":
        return np.random.default_rng(options.seed).permutation(array)
    return array


def _compute_morton_codes(frame: Frame, triangles: Triangles) -> NDArray[np.uint64]:
    """Return the Morton codes (m,) of the triangles' centres: positions on a Z-order curve."""
    centre = frame.points[triangles].astype(np.int64).sum(axis=1) // 3
    octets = np.maximum(centre, 0).astype("<u4")[..., None].view(np.uint8)
    bits = np.unpackbits(octets, axis=-1, bitorder="little")  # (m, 2, 32), bits of x first
    mixed = np.packbits(bits.swapaxes(1, 2).reshape(-1, 64), axis=-1, bitorder="little")
    return mixed.view("<u8")[:, 0]


def check_size(width: int, height: int, max_size: int) -> None:
    """Raise UsageError if a viewport exceeds the device's maximum size."""
    if max(width, height) > max_size:
        raise UsageError(
            f"viewport: {width}x{height} px exceeds the device's maximum of {max_size}; "
            "lower --resolution"
        )


@cache
def read_shader(name: str) -> str:
    """Return the text of a file in shaders/, e.g. "draw.wgsl"."""
    return files("harness.rasterisers").joinpath("shaders", name).read_text(encoding="utf-8")
