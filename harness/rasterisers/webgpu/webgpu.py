"""WebGPU through wgpu: Vulkan, Metal, Direct3D 12 or OpenGL, whatever the machine has.

Its shaders, shaders/count.wgsl and shaders/draw.wgsl, are those of the measuring page too.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriser, UsageError
from harness.frame import SUBPIXEL, Frame, bare_frame, on_coarser_grid
from harness.rasterisers.base import (
    Counters,
    Device,
    Drawing,
    Image,
    Options,
    Rasteriser,
    Triangles,
)
from harness.rasterisers.opengl.buffers import batches
from harness.rasterisers.reference import SHADED, predict
from harness.rasterisers.shader_texts import shader
from harness.rasterisers.webgpu import adapters
from harness.rasterisers.webgpu.passes import FORMAT, Pass, Target, Timed
from scenes.spec import install

TWELVE = 12
"""What the pixels of one quad add to its counter together; see shaders/count.wgsl."""

MOST_LANES = 2**30
"""Of one counting draw: its counters stay below 3 * 2**30."""

KEEP_ALPHA = 7
"""Write red, green and blue: llvmpipe forgets what storage writes it has collected for a tile when
an opaque triangle covers the tile; a draw that keeps alpha is not opaque to it."""
WRITE_ALL = 15

STEPS = (1, 2, 4, 8, 16)
"""Of the grids that the standards below WebGPU allow, in 1/256 px."""

PROBE_PX, PROBES = 64, 80
"""Viewport and triangles by which the device's grid is found."""

LIMITS = ("max-texture-dimension-2d", "max-buffer-size", "max-storage-buffer-binding-size")

IMMEDIATE = ("nvidia", "amd", "radeon", "intel")
"""GPUs that shade triangles as they come. Others collect a pass first, and leave out what a later
opaque triangle of it hides: they get one pass a draw instead of instances."""


class WebGPU(Rasteriser):
    """WebGPU without a window; helper lanes are not seen by its shaders but follow from quads."""

    name = "webgpu"
    shades = True
    lacking = "one sample a pixel"
    counters: ClassVar[tuple[str, ...]] = SHADED
    cuts = True
    known: ClassVar[tuple[str, ...]] = ("gpu0", "lavapipe", "llvmpipe", "swiftshader", "warp")

    @classmethod
    def devices(cls) -> list[Device]:
        """List GPUs, then adapters that run on the CPU."""
        return list(adapters.probe()[0])

    @classmethod
    def supports(cls, options: Options) -> bool:
        """Whether it can draw with `options`: how samples lie in a pixel is not told."""
        return options.samples == 1

    @classmethod
    def remedy(cls, name: str | None = None) -> str:
        """Say how to get a device."""
        if importlib.util.find_spec("wgpu") is None:
            return f"run: {install('webgpu')}"
        if name == "lavapipe":
            return f"run: {adapters.egl.INSTALL_VULKAN}"
        if name == "llvmpipe":
            return f"run: {adapters.egl.INSTALL}"
        if name == "swiftshader":
            return "run: apt-get install -y chromium, which brings it along"
        return "WebGPU finds no such adapter; install its vendor's driver, or choose another"

    def __init__(self, device: Device) -> None:
        adapter = _find_adapter(device)
        limits = {name: adapter.limits[name] for name in LIMITS}
        self._has_timer = "timestamp-query" in adapter.features
        features = ["timestamp-query"] if self._has_timer else []
        self._device = adapter.request_device_sync(
            required_features=features, required_limits=limits
        )
        self._period_ns = _timestamp_period(self._device.queue)
        self._targets: WeakValueDictionary[tuple[int, int], Target] = WeakValueDictionary()
        self.max_size = int(limits["max-texture-dimension-2d"])
        self._step = 1
        self._draw = self._pipeline(
            "draw", WRITE_ALL, [(8, "vertex", ["sint32x2"]), (4, "vertex", ["uint32"])]
        )
        self._tally = self._pipeline(
            "count", KEEP_ALPHA, [(28, "instance", ["sint32x4", "sint32x2", "uint32"])]
        )
        step = self._find_step()
        self._step = step or 1
        bits = None if step is None else (SUBPIXEL // step).bit_length() - 1
        told = device.details
        self.device = replace(
            device,
            details={
                **told,
                "renderer": told["device"],
                "version": f"WebGPU on {told['backend_type']} {told['description']}".strip(),
                "max_size": self.max_size,
                "subpixel_bits": bits,
                "step": self._step,
                "timer": self._has_timer,
            },
        )

    def close(self) -> None:
        """Give the device back."""
        self._device.destroy()

    def _find_step(self) -> int | None:
        """Return the step of the grid that the device snaps vertices to, in 1/256 px.

        Ours has a step of 1; what WebGPU stands on may have one of 16. The first step on which it
        counts some triangles as the reference does is the one; None if there is none.
        """
        rng = np.random.default_rng(7)
        corners = rng.integers(SUBPIXEL, (PROBE_PX - 1) * SUBPIXEL, (3 * PROBES, 2))
        rows = np.arange(3 * PROBES, dtype=np.int32).reshape(-1, 3)
        for step in STEPS:
            points = on_coarser_grid(corners.astype(np.int32), step)
            frame = bare_frame(PROBE_PX, points, 3)
            counted = self._count(frame, rows, Options())
            exact = predict(points, rows)
            if all((counted[name] == exact[name]).all() for name in SHADED):
                return step
        return None

    def _count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        frame = self._on_grid(frame)
        target = self._target(frame)
        polygons = len(frame.offsets) - 1
        totals = np.zeros((polygons, 3), np.int64)
        for part in batches(frame, triangles, MOST_LANES):
            totals += self._tally_once(target, frame, part).reshape(polygons, 3)
        fragments = totals[:, 0]
        quads, whole = np.rint(totals[:, 1:] / (TWELVE, 4)).astype(np.int64).T
        values = (fragments, quads, 4 * quads - fragments, quads - whole)
        return dict(zip(SHADED, values, strict=True))

    def _tally_once(self, target: Target, frame: Frame, part: Triangles) -> NDArray[np.uint32]:
        corners = frame.points[part].reshape(len(part), 6)
        rows = np.column_stack([corners, frame.owner(part)]).astype(np.int32)
        triangles = self._buffer(rows, "VERTEX")
        counts = self._buffer(np.zeros(3 * (len(frame.offsets) - 1), np.uint32), "STORAGE")
        size = self._buffer(_size(frame), "UNIFORM")
        group = self._group(self._tally, size, counts)
        encoder = self._device.create_command_encoder()
        with Pass(encoder, target) as render:
            render.set_pipeline(self._tally)
            render.set_bind_group(0, group)
            render.set_vertex_buffer(0, triangles)
            if frame.scissor is not None:
                render.set_scissor_rect(*frame.scissor)
            render.draw(3, len(part))
        self._device.queue.submit([encoder.finish()])
        found = np.frombuffer(self._device.queue.read_buffer(counts), np.uint32).copy()
        for buffer in (triangles, counts, size):
            buffer.destroy()
        return found[: 3 * (len(frame.offsets) - 1)]

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        return self._timed(frame, triangles, options.work)

    def _image(self, frame: Frame, triangles: Triangles, options: Options) -> Image:
        with self._timed(frame, triangles, options.work) as drawing:
            drawing.target.clear(self._device)
            drawing.sample(1)
            picture = drawing.target.read(self._device)
        return picture[::-1].copy()

    def _on_grid(self, frame: Frame) -> Frame:
        """Return the frame on the device's own grid, where it is drawn as it is counted."""
        if self._step == 1:
            return frame
        return replace(frame, points=on_coarser_grid(frame.points, self._step))

    def _timed(self, frame: Frame, triangles: Triangles, work: int) -> Timed:
        frame = self._on_grid(frame)
        numbers = np.arange(len(frame.offsets) - 1, dtype=np.uint32)
        view = np.zeros(4, np.float32)
        view[:2] = _size(frame)
        view.view(np.uint32)[2] = work
        buffers = {
            "points": self._buffer(frame.points.astype(np.int32), "VERTEX"),
            "polygons": self._buffer(np.repeat(numbers, np.diff(frame.offsets)), "VERTEX"),
            "indices": self._buffer(triangles.astype(np.uint32), "INDEX"),
            "view": self._buffer(view, "UNIFORM"),
        }
        return Timed(
            self._device,
            self._draw,
            self._group(self._draw, buffers["view"]),
            self._target(frame),
            buffers,
            frame.draws(triangles),
            scissor=frame.scissor or (0, 0, frame.width, frame.height),
            one_pass=not self.device.software and _is_immediate(self.device.details),
            period_ns=self._period_ns if self._has_timer else None,
        )

    def _target(self, frame: Frame) -> Target:
        """Return a picture to draw into, shared with whoever uses one of that size now."""
        if max(frame.width, frame.height) > self.max_size:
            raise UsageError(
                f"{frame.width}x{frame.height} px is more than the device's {self.max_size}; "
                "lower --resolution"
            )
        key = (frame.width, frame.height)
        target = self._targets.get(key)
        if target is None:
            target = self._targets[key] = Target(self._device, *key)
        return target

    def _buffer(self, array: NDArray[Any], usage: str) -> Any:
        """Upload an array; an empty one gets four bytes, for WebGPU binds no empty buffers."""
        content = np.ascontiguousarray(array if array.size else np.zeros(1, np.uint32))
        return self._device.create_buffer_with_data(
            data=content, usage=f"{usage}|COPY_SRC" if usage == "STORAGE" else usage
        )

    def _group(self, pipeline: Any, *buffers: Any) -> Any:
        entries = [
            {"binding": number, "resource": {"buffer": buffer, "offset": 0, "size": buffer.size}}
            for number, buffer in enumerate(buffers)
        ]
        layout = pipeline.get_bind_group_layout(0)
        return self._device.create_bind_group(layout=layout, entries=entries)

    def _pipeline(self, name: str, mask: int, buffers: list[tuple[int, str, list[str]]]) -> Any:
        """Build the pipeline of a file in shaders/.

        buffers : bytes of an element, "vertex" or "instance", and formats of its attributes
        """
        module = self._device.create_shader_module(code=shader(f"{name}.wgsl"))
        entries = {"draw": "shade", "count": "count"}
        return self._device.create_render_pipeline(
            layout="auto",
            vertex={"module": module, "entry_point": "place", "buffers": _layouts(buffers)},
            primitive={"topology": "triangle-list", "cull_mode": "none"},
            fragment={
                "module": module,
                "entry_point": entries[name],
                "targets": [{"format": FORMAT, "write_mask": mask}],
            },
        )


def _find_adapter(device: Device) -> Any:
    """Return the adapter that `device` describes.

    Raises
    ------
    NoRasteriser
        if wgpu is not installed, or has no such adapter in this process
    """
    try:
        import wgpu
    except (ImportError, OSError) as error:
        raise NoRasteriser(f"webgpu: {error}; run: {install('webgpu')}") from error
    for adapter in wgpu.gpu.enumerate_adapters_sync():
        if all(adapter.info[name] == device.details[name] for name in ("device", "backend_type")):
            return adapter
    raise NoRasteriser(
        f"asked for {device.name}, but WebGPU has no adapter '{device.details['device']}' on "
        f"{device.details['backend_type']}; {WebGPU.remedy(device.name)}"
    )


def _timestamp_period(queue: Any) -> float:
    """Return the nanoseconds of a timestamp's step, which wgpu tells in its own interface alone."""
    from wgpu.backends.wgpu_native import lib

    return float(lib.wgpuQueueGetTimestampPeriod(queue._internal))


def _is_immediate(details: Mapping[str, Any]) -> bool:
    told = f"{details['vendor']} {details['device']}".lower()
    return any(vendor in told for vendor in IMMEDIATE)


def _layouts(buffers: list[tuple[int, str, list[str]]]) -> list[dict[str, Any]]:
    sizes = {"sint32x4": 16, "sint32x2": 8, "uint32": 4}
    layouts = []
    location = 0
    for stride, step, formats in buffers:
        attributes = []
        offset = 0
        for kind in formats:
            attributes.append({"format": kind, "offset": offset, "shader_location": location})
            offset += sizes[kind]
            location += 1
        layouts.append({"array_stride": stride, "step_mode": step, "attributes": attributes})
    return layouts


def _size(frame: Frame) -> NDArray[np.float32]:
    return np.array([SUBPIXEL * frame.width, SUBPIXEL * frame.height], np.float32)
