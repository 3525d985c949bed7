"""WebGPU through wgpu: Vulkan, Metal, Direct3D 12 or OpenGL, whatever the machine has.

Its shaders, shaders/count.wgsl and shaders/draw.wgsl, are those of the measuring page too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriser
from harness.frame import SUBPIXEL, Frame, bare_frame, on_coarser_grid
from harness.rasterisers import devices
from harness.rasterisers.base import (
    Counters,
    Device,
    Drawing,
    Options,
    Rasteriser,
    Sample,
    Stopwatch,
    Triangles,
    batches,
    check_size,
    shader,
)
from harness.rasterisers.reference import SHADED, predict
from scenes.spec import install

FORMAT = "rgba8unorm"

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

DRAWN = [
    {"array_stride": size, "attributes": [{"format": kind, "offset": 0, "shader_location": place}]}
    for place, (kind, size) in enumerate((("sint32x2", 8), ("uint32", 4)))
]
"""The draw's buffers: a vertex's point, and its polygon."""

COUNTED = [
    {
        "array_stride": 28,
        "step_mode": "instance",
        "attributes": [
            {"format": "sint32x4", "offset": 0, "shader_location": 0},
            {"format": "sint32x2", "offset": 16, "shader_location": 1},
            {"format": "uint32", "offset": 24, "shader_location": 2},
        ],
    }
]
"""The counting draw's: a triangle's three points, and its polygon."""

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
    module = "wgpu"
    remedies: ClassVar[Mapping[str, str]] = {
        "lavapipe": f"run: {devices.INSTALL_VULKAN}",
        "llvmpipe": f"run: {devices.INSTALL}",
        "swiftshader": "run: apt-get install -y chromium, which brings it along",
        "": "WebGPU finds no such adapter; install its vendor's driver, or choose another",
    }

    @classmethod
    def devices(cls) -> list[Device]:
        """List GPUs, then adapters that run on the CPU."""
        return list(devices.of_webgpu()[0])

    @classmethod
    def supports(cls, options: Options) -> bool:
        """Whether it can draw with `options`: how samples lie in a pixel is not told."""
        return options.samples == 1

    def __init__(self, device: Device) -> None:
        adapter = _find_adapter(device)
        limits = {name: adapter.limits[name] for name in LIMITS}
        features = {"timestamp-query"} & set(adapter.features)
        self.gpu = adapter.request_device_sync(
            required_features=list(features), required_limits=limits
        )
        from wgpu.backends.wgpu_native import lib  # the standard does not tell a timestamp's step

        period_ns = float(lib.wgpuQueueGetTimestampPeriod(self.gpu.queue._internal))
        self.period_ns = period_ns if features else None
        self._target: Any = None
        self.max_size = int(limits["max-texture-dimension-2d"])
        self._step = 1
        self.draw = self._pipeline("draw", "shade", WRITE_ALL, DRAWN)
        self._tally = self._pipeline("count", "count", KEEP_ALPHA, COUNTED)
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
                "subpixel_bits": bits,
                "step": self._step,
            },
        )

    def close(self) -> None:
        """Give the device back."""
        self.gpu.destroy()

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
        polygons = len(frame.offsets) - 1
        totals = np.zeros((polygons, 3), np.int64)
        for part in batches(frame, triangles, MOST_LANES):
            totals += self._tally_once(frame, part).reshape(polygons, 3)
        fragments = totals[:, 0]
        quads, whole = np.rint(totals[:, 1:] / (TWELVE, 4)).astype(np.int64).T
        values = (fragments, quads, 4 * quads - fragments, quads - whole)
        return dict(zip(SHADED, values, strict=True))

    def _tally_once(self, frame: Frame, part: Triangles) -> NDArray[np.uint32]:
        corners = frame.points[part].reshape(len(part), 6)
        rows = np.column_stack([corners, frame.owner(part)]).astype(np.int32)
        triangles = self.buffer(rows, "VERTEX")
        counts = self.buffer(np.zeros(3 * (len(frame.offsets) - 1), np.uint32), "STORAGE|COPY_SRC")
        size = self.buffer(_size(frame), "UNIFORM")
        encoder = self.gpu.create_command_encoder()
        render = begin_pass(encoder, self.target(frame))
        render.set_pipeline(self._tally)
        render.set_bind_group(0, self.group(self._tally, size, counts))
        render.set_vertex_buffer(0, triangles)
        if frame.scissor is not None:
            render.set_scissor_rect(*frame.scissor)
        render.draw(3, len(part))
        render.end()
        self.gpu.queue.submit([encoder.finish()])
        found = np.frombuffer(self.gpu.queue.read_buffer(counts), np.uint32).copy()
        return found[: 3 * (len(frame.offsets) - 1)]

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        return _Timed(self, self._on_grid(frame), triangles, options.work)

    def _on_grid(self, frame: Frame) -> Frame:
        """Return the frame on the device's own grid, where it is drawn as it is counted."""
        return replace(frame, points=on_coarser_grid(frame.points, self._step))

    def target(self, frame: Frame) -> Any:
        """Return a view of a texture to draw into; the last one, if of that size.

        Raises
        ------
        UsageError
            if it is too large
        """
        check_size(frame.width, frame.height, self.max_size)
        size = (frame.width, frame.height, 1)
        if self._target is None or self._target.texture.size != size:
            usage = "RENDER_ATTACHMENT|COPY_SRC"
            self._target = self.gpu.create_texture(
                size=size, format=FORMAT, usage=usage
            ).create_view()
        return self._target

    def buffer(self, array: NDArray[Any], usage: str) -> Any:
        """Upload an array; an empty one gets four bytes, for WebGPU binds no empty buffers."""
        content = np.ascontiguousarray(array if array.size else np.zeros(1, np.uint32))
        return self.gpu.create_buffer_with_data(data=content, usage=usage)

    def group(self, pipeline: Any, *buffers: Any) -> Any:
        """Bind buffers to a pipeline, by their number."""
        entries = [
            {"binding": number, "resource": {"buffer": buffer, "offset": 0, "size": buffer.size}}
            for number, buffer in enumerate(buffers)
        ]
        layout = pipeline.get_bind_group_layout(0)
        return self.gpu.create_bind_group(layout=layout, entries=entries)

    def _pipeline(self, name: str, entry: str, mask: int, buffers: Sequence[Any]) -> Any:
        """Build the pipeline of a file in shaders/ whose fragment shader is `entry`."""
        module = self.gpu.create_shader_module(code=shader(f"{name}.wgsl"))
        return self.gpu.create_render_pipeline(
            layout="auto",
            vertex={"module": module, "entry_point": "place", "buffers": buffers},
            primitive={"topology": "triangle-list", "cull_mode": "none"},
            fragment={
                "module": module,
                "entry_point": entry,
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


def _size(frame: Frame) -> NDArray[np.float32]:
    return np.array([SUBPIXEL * frame.width, SUBPIXEL * frame.height], np.float32)


def begin_pass(encoder: Any, target: Any, timestamps: Mapping[str, Any] | None = None) -> Any:
    """Begin a render pass over the target, whose earlier content stays."""
    attachment = {"view": target, "load_op": "load", "store_op": "store"}
    return encoder.begin_render_pass(color_attachments=[attachment], timestamp_writes=timestamps)


class _Timed(Drawing):
    """One triangulation in buffers of the device, drawn again and again."""

    def __init__(self, owner: WebGPU, frame: Frame, triangles: Triangles, work: int) -> None:
        numbers = np.arange(len(frame.offsets) - 1, dtype=np.uint32)
        view = np.zeros(4, np.float32)
        view[:2] = _size(frame)
        view.view(np.uint32)[2] = work
        self._points = owner.buffer(frame.points.astype(np.int32), "VERTEX")
        self._polygons = owner.buffer(np.repeat(numbers, np.diff(frame.offsets)), "VERTEX")
        self._indices = owner.buffer(triangles.astype(np.uint32), "INDEX")
        self._view = owner.buffer(view, "UNIFORM")
        self._pipeline = owner.draw
        self._group = owner.group(owner.draw, self._view)
        self.gpu = owner.gpu
        self._draws = frame.draws(triangles)
        self._scissor = frame.scissor or (0, 0, frame.width, frame.height)
        self.target = owner.target(frame)
        told = "{vendor} {device}".format_map(owner.device.details).lower()
        self.one_pass = not owner.device.software and any(name in told for name in IMMEDIATE)
        self.period_ns = owner.period_ns
        if self.period_ns is not None:
            self._queries = self.gpu.create_query_set(type="timestamp", count=2)
            self._answers = self.gpu.create_buffer(size=16, usage="QUERY_RESOLVE|COPY_SRC")

    def sample(self, repeats: int) -> Sample:
        """Draw `repeats` times.

        As instances in one pass on a GPU that shades triangles as they come. Others collect
        triangles before they shade, and leave out what a later one hides: each draw is submitted
        by itself there.
        """
        instances = repeats if self.one_pass else 1
        passes = [self._draws] if self.one_pass else [[rows] for rows in self._draws] * repeats
        commands = [
            self._encode(draws, instances, first=number == 0, last=number == len(passes) - 1)
            for number, draws in enumerate(passes)
        ]
        watch = Stopwatch()
        for command in commands:
            self.gpu.queue.submit([command])
        self.gpu._poll_wait()  # what the standard offers returns some 100 us too late
        sample = watch.stop()
        if self.period_ns is None:
            return sample
        begin, end = np.frombuffer(self.gpu.queue.read_buffer(self._answers), np.uint64)
        return replace(sample, gpu=(int(end) - int(begin)) * self.period_ns * 1e-9)

    def _encode(self, draws: Sequence[slice], instances: int, *, first: bool, last: bool) -> Any:
        """Return one pass's commands, with a timestamp before the first and after the last."""
        encoder = self.gpu.create_command_encoder()
        stamps: dict[str, Any] = {}
        if self.period_ns is not None:
            stamps |= {"beginning_of_pass_write_index": 0} if first else {}
            stamps |= {"end_of_pass_write_index": 1} if last else {}
        stamps |= {"query_set": self._queries} if stamps else {}
        render = begin_pass(encoder, self.target, stamps or None)
        render.set_pipeline(self._pipeline)
        render.set_bind_group(0, self._group)
        render.set_vertex_buffer(0, self._points)
        render.set_vertex_buffer(1, self._polygons)
        render.set_index_buffer(self._indices, "uint32")
        render.set_scissor_rect(*self._scissor)
        for rows in draws:
            render.draw_indexed(3 * (rows.stop - rows.start), instances, 3 * rows.start)
        render.end()
        if stamps and last:
            encoder.resolve_query_set(self._queries, 0, 2, self._answers, 0)
        return encoder.finish()
