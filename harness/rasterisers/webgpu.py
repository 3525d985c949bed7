"""WebGPU through wgpu, on Vulkan, Metal, Direct3D 12 or OpenGL.

The measuring page uses the same shaders, shaders/count.wgsl and shaders/draw.wgsl.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriserError
from harness.frame import Frame, make_bare_frame
from harness.grid import SUBPIXEL, round_points
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
    check_size,
    read_shader,
    split_batches,
)
from harness.rasterisers.reference import SHADED, count_per_triangle
from scenes.spec import format_install_command

FORMAT = "rgba8unorm"

QUAD_COUNT_SCALE = 12  # sum of the covered pixels of a quad in a counter; see shaders/count.wgsl
MAX_LANES = 2**30  # lanes of a counting draw, 2**28 quads: counters stay at or below 3 * 2**30

# Channels written while counting, all except alpha: llvmpipe discards a tile's collected storage
# writes when an opaque triangle covers the tile, and a draw that keeps alpha is not opaque.
KEEP_ALPHA = 7
WRITE_ALL = 15  # channels written while drawing
GRID_STEPS = (1, 2, 4, 8, 16)  # steps of the vertex grids that backends allow, in 1/256 px
PROBE_PX, PROBES = 64, 80  # viewport and triangles for detecting the device's grid

DRAW_BUFFERS = [
    {
        "array_stride": size,
        "attributes": [{"format": kind, "offset": 0, "shader_location": location}],
    }
    for location, (kind, size) in enumerate((("sint32x2", 8), ("uint32", 4)))
]
"""Vertex buffers for drawing: a vertex's point, and its polygon."""

COUNT_BUFFERS = [
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
"""Vertex buffer for counting: a triangle's three points, and its polygon."""

LIMITS = ("max-texture-dimension-2d", "max-buffer-size", "max-storage-buffer-binding-size")

# Words in the names of GPUs that shade triangles immediately. Other GPUs collect a pass first and
# skip triangles that later opaque triangles hide, so they get a pass per draw, not instances.
IMMEDIATE = ("nvidia", "amd", "radeon", "intel")


class WebGPU(Rasteriser):
    """Rasteriser on WebGPU, without a window; helper lanes are 4 * quads - fragments."""

    name = "webgpu"
    shades_fragments = True
    draws_indexed = True
    limitation = "one sample per pixel and no textures"
    counters: ClassVar[tuple[str, ...]] = SHADED
    supports_scissor = True
    device_names = ("gpu0", "lavapipe", "llvmpipe", "swiftshader", "warp")
    module = "wgpu"
    remedies: ClassVar[Mapping[str, str]] = {
        "lavapipe": f"run: {devices.INSTALL_VULKAN}",
        "llvmpipe": f"run: {devices.INSTALL}",
        "swiftshader": "run: apt-get install -y chromium, which includes SwiftShader",
        "": "install the vendor's driver, or choose another device",
    }

    @classmethod
    def devices(cls) -> list[Device]:
        """List GPUs, then adapters that run on the CPU."""
        return list(devices.list_webgpu_devices()[0])

    @classmethod
    def supports(cls, options: Options) -> bool:
        """Return whether `options` have no texture and one sample, as positions are unspecified."""
        return options.samples == 1 and options.texture == 0

    def __init__(self, device: Device) -> None:
        adapter = _find_adapter(device)
        limits = {name: adapter.limits[name] for name in LIMITS}
        features = {"timestamp-query"} & set(adapter.features)
        self.gpu = adapter.request_device_sync(
            required_features=list(features), required_limits=limits
        )
        from wgpu.backends.wgpu_native import lib  # WebGPU has no function for the timestamps' unit

        period_ns = float(lib.wgpuQueueGetTimestampPeriod(self.gpu.queue._internal))
        self.period_ns = period_ns if features else None
        self._target: Any = None
        self.max_size = int(limits["max-texture-dimension-2d"])
        self._step = 1
        self.draw = self._build_pipeline("draw", "shade", WRITE_ALL, DRAW_BUFFERS)
        self._count_pipeline = self._build_pipeline("count", "count", KEEP_ALPHA, COUNT_BUFFERS)
        step = self._find_step()
        self._step = step or 1
        bits = None if step is None else (SUBPIXEL // step).bit_length() - 1
        details = device.details
        self.device = replace(
            device,
            details={
                **details,
                "renderer": details["device"],
                "version": f"WebGPU on {details['backend_type']} {details['description']}".strip(),
                "subpixel_bits": bits,
                "step": self._step,
            },
        )

    def close(self) -> None:
        """Release the device."""
        self.gpu.destroy()

    def _find_step(self) -> int | None:
        """Return the step, in 1/256 px, at which counters equal the reference's, or None."""
        rng = np.random.default_rng(7)
        corners = rng.integers(SUBPIXEL, (PROBE_PX - 1) * SUBPIXEL, (3 * PROBES, 2))
        rows = np.arange(3 * PROBES, dtype=np.int32).reshape(-1, 3)
        for step in GRID_STEPS:
            points = round_points(corners.astype(np.int32), step)
            frame = make_bare_frame(PROBE_PX, points, 3)
            counted = self._draw_and_count(frame, rows, Options())
            expected = count_per_triangle(points, rows)
            if all((counted[name] == expected[name]).all() for name in SHADED):
                return step
        return None

    def _draw_and_count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        frame = self._snap_to_grid(frame)
        polygons = len(frame.grid)
        totals = np.zeros((polygons, 4), np.int64)
        for part in split_batches(frame, triangles, MAX_LANES):
            totals += self._count_batch(frame, part).reshape(polygons, 4)
        fragments, covering = totals[:, 0], totals[:, 3]
        quads, full = np.rint(totals[:, 1:3] / (QUAD_COUNT_SCALE, 4)).astype(np.int64).T
        values = (fragments, quads, 4 * quads - fragments, quads - full, covering)
        return dict(zip(SHADED, values, strict=True))

    def _count_batch(self, frame: Frame, part: Triangles) -> NDArray[np.uint32]:
        """Draw triangles (m, 3); return four counters for each polygon, see shaders/count.wgsl."""
        corners = frame.points[part].reshape(len(part), 6)
        rows = np.column_stack([corners, frame.find_owners(part)]).astype(np.int32)
        triangles = self.create_buffer(rows, "VERTEX")
        counts = self.create_buffer(np.zeros(4 * len(frame.grid), np.uint32), "STORAGE|COPY_SRC")
        covering = self.create_buffer(np.zeros(len(part) // 32 + 1, np.uint32), "STORAGE")
        size = self.create_buffer(_get_size_in_subpixels(frame), "UNIFORM")
        encoder = self.gpu.create_command_encoder()
        render = begin_pass(encoder, self.get_target(frame))
        render.set_pipeline(self._count_pipeline)
        render.set_bind_group(
            0, self.create_bind_group(self._count_pipeline, size, counts, covering)
        )
        render.set_vertex_buffer(0, triangles)
        if frame.scissor is not None:
            render.set_scissor_rect(*frame.scissor)
        render.draw(3, len(part))
        render.end()
        self.gpu.queue.submit([encoder.finish()])
        totals = np.frombuffer(self.gpu.queue.read_buffer(counts), np.uint32).copy()
        return totals[: 4 * len(frame.grid)]

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        return _UploadedTriangles(self, self._snap_to_grid(frame), triangles, options.work)

    def _snap_to_grid(self, frame: Frame) -> Frame:
        """Return the frame on the device's grid, on which drawing and counting agree."""
        return frame.with_points(round_points(frame.points, self._step))

    def get_target(self, frame: Frame) -> Any:
        """Return a view of a texture to draw into; reuse the last texture if the size is equal."""
        check_size(frame.width, frame.height, self.max_size)
        size = (frame.width, frame.height, 1)
        if self._target is None or self._target.texture.size != size:
            usage = "RENDER_ATTACHMENT|COPY_SRC"
            self._target = self.gpu.create_texture(
                size=size, format=FORMAT, usage=usage
            ).create_view()
        return self._target

    def create_buffer(self, array: NDArray[Any], usage: str) -> Any:
        """Upload an array; an empty array becomes four bytes, as WebGPU has no empty bindings."""
        content = np.ascontiguousarray(array if array.size else np.zeros(1, np.uint32))
        return self.gpu.create_buffer_with_data(data=content, usage=usage)

    def create_bind_group(self, pipeline: Any, *buffers: Any) -> Any:
        """Return a bind group of a pipeline with `buffers` as bindings 0, 1, ..."""
        entries = [
            {"binding": number, "resource": {"buffer": buffer, "offset": 0, "size": buffer.size}}
            for number, buffer in enumerate(buffers)
        ]
        layout = pipeline.get_bind_group_layout(0)
        return self.gpu.create_bind_group(layout=layout, entries=entries)

    def _build_pipeline(self, name: str, entry: str, mask: int, buffers: Sequence[Any]) -> Any:
        module = self.gpu.create_shader_module(code=read_shader(f"{name}.wgsl"))
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
    try:
        import wgpu
    except (ImportError, OSError) as error:
        raise NoRasteriserError(
            f"webgpu: {error}; run: {format_install_command('webgpu')}"
        ) from error
    for adapter in wgpu.gpu.enumerate_adapters_sync():
        if all(adapter.info[name] == device.details[name] for name in ("device", "backend_type")):
            return adapter
    raise NoRasteriserError(
        f"{device.name}: WebGPU adapter '{device.details['device']}' on "
        f"{device.details['backend_type']} not found; {WebGPU.remedy(device.name)}"
    )


def _get_size_in_subpixels(frame: Frame) -> NDArray[np.float32]:
    return np.array([SUBPIXEL * frame.width, SUBPIXEL * frame.height], np.float32)


def begin_pass(encoder: Any, target: Any, timestamps: Mapping[str, Any] | None = None) -> Any:
    """Begin a render pass that loads and retains the target's content."""
    attachment = {"view": target, "load_op": "load", "store_op": "store"}
    return encoder.begin_render_pass(color_attachments=[attachment], timestamp_writes=timestamps)


class _UploadedTriangles(Drawing):
    def __init__(self, owner: WebGPU, frame: Frame, triangles: Triangles, work: int) -> None:
        numbers = np.arange(len(frame.grid), dtype=np.uint32)
        view = np.zeros(4, np.float32)
        view[:2] = _get_size_in_subpixels(frame)
        view.view(np.uint32)[2] = work
        self._points = owner.create_buffer(frame.points.astype(np.int32), "VERTEX")
        self._polygons = owner.create_buffer(np.repeat(numbers, frame.grid.vertex_counts), "VERTEX")
        self._indices = owner.create_buffer(triangles.astype(np.uint32), "INDEX")
        self._view = owner.create_buffer(view, "UNIFORM")
        self._pipeline = owner.draw
        self._group = owner.create_bind_group(owner.draw, self._view)
        self.gpu = owner.gpu
        self._draws = frame.split_by_draw(triangles)
        self._scissor = frame.scissor or (0, 0, frame.width, frame.height)
        self.target = owner.get_target(frame)
        label = "{vendor} {device}".format_map(owner.device.details).lower()
        self.one_pass = not owner.device.software and any(name in label for name in IMMEDIATE)
        self.period_ns = owner.period_ns
        if self.period_ns is not None:
            self._queries = self.gpu.create_query_set(type="timestamp", count=2)
            self._answers = self.gpu.create_buffer(size=16, usage="QUERY_RESOLVE|COPY_SRC")

    def sample(self, repeats: int) -> Sample:
        """Draw `repeats` times, in one pass of instances if possible (see `IMMEDIATE`)."""
        instances = repeats if self.one_pass else 1
        passes = [self._draws] if self.one_pass else [[rows] for rows in self._draws] * repeats
        commands = [
            self._encode(draws, instances, first=number == 0, last=number == len(passes) - 1)
            for number, draws in enumerate(passes)
        ]
        watch = Stopwatch()
        for command in commands:
            self.gpu.queue.submit([command])
        self.gpu._poll_wait()  # the standard's function returns about 100 us late
        sample = watch.stop()
        if self.period_ns is None:
            return sample
        begin, end = np.frombuffer(self.gpu.queue.read_buffer(self._answers), np.uint64)
        return replace(sample, gpu=(int(end) - int(begin)) * self.period_ns * 1e-9)

    def _encode(self, draws: Sequence[slice], instances: int, *, first: bool, last: bool) -> Any:
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
