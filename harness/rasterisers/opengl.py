"""OpenGL on an EGL device or OSMesa: counting with atomic operations, plain drawing for timing."""

import ctypes.util
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import cycle
from typing import Any, ClassVar

import glcontext
import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriserError
from harness.frame import Frame
from harness.grid import SUBPIXEL
from harness.rasterisers import context, devices
from harness.rasterisers.base import (
    Counters,
    Device,
    Drawing,
    Options,
    Rasteriser,
    Sample,
    Triangles,
    split_batches,
    sum_per_polygon,
)
from harness.rasterisers.context import Context, OSMesaContext
from harness.rasterisers.reference import SHADED, count_visible_per_triangle
from triangulators.gpu import is_software, selects_renderer

KEEP_ALPHA = (True, True, True, False)
WRITE_ALL = (True, True, True, True)
"""Colour masks for counting and for drawing; `_count_per_polygon` has the reason."""

INSTALL_OSMESA = "apt-get install -y libosmesa6"

IN_ORDER_RENDERERS = ("softpipe",)  # renderers that finish each triangle before the next


class GLRasteriser(Rasteriser):
    """A rasteriser on OpenGL through EGL, without a window."""

    device_names: ClassVar[tuple[str, ...]] = ("gpu0", "llvmpipe", "softpipe", "zink")
    remedies: ClassVar[Mapping[str, str]] = {
        "gpu": "install the vendor's driver, or choose llvmpipe",
        "zink": f"run: {devices.INSTALL_VULKAN}",
        "": f"run: {devices.INSTALL}",
    }
    drawn_by: ClassVar[str] = ""  # start of the renderer's name, if not the device's name

    @classmethod
    def devices(cls) -> list[Device]:
        """List GPUs, then llvmpipe, softpipe and zink on lavapipe, as far as usable."""
        return list(devices.list_egl_devices()[0])

    def __init__(self, device: Device) -> None:
        device.require_environment()
        try:
            self.context = Context(self._open(device))
        except Exception as error:  # glcontext raises plain Exception
            raise NoRasteriserError(
                f"{device.name}: {error}; {self.remedy(device.name)}"
            ) from error
        self.ctx = self.context.ctx
        info = self.ctx.info
        renderer = info["GL_RENDERER"]
        if not selects_renderer(self.drawn_by or device.name, renderer):
            self.context.close()
            raise NoRasteriserError(
                f"{device.name}: OpenGL opened '{renderer}' instead; {self.remedy(device.name)}"
            )
        if self.ctx.version_code < context.MODERN_VERSION:
            self.context.require_extensions(*context.OLDER_EXTENSIONS)
        self.device = replace(
            device,
            software=is_software(renderer),
            details={
                **device.details,
                "vendor": info["GL_VENDOR"],
                "renderer": renderer,
                "version": info["GL_VERSION"],
                "subpixel_bits": info["GL_SUBPIXEL_BITS"],
            },
        )
        self.context.raise_pending_error("opening the device")

    def _open(self, device: Device) -> Any:
        """Create and return the backend of a `Context`, an object with glcontext's methods."""
        return glcontext.get_backend_by_name("egl")(
            mode="standalone",
            glversion=330,
            device_index=device.details["egl_index"],
            libgl="libGL.so.1",
            libegl="libEGL.so.1",
        )

    def close(self) -> None:
        """Close the context."""
        self.context.activate()
        self.context.close()


class OpenGL(GLRasteriser):
    """Rasteriser on OpenGL 3.3 or later with storage buffers, through EGL, without a window."""

    name = "opengl"
    shades_fragments = True
    supports_texture = True
    draws_indexed = True
    supports_scissor = True
    supports_depth = True
    counters: ClassVar[tuple[str, ...]] = (*SHADED, "samples_passed", *context.STATISTICS)

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self._in_order = self.device.details["renderer"] in IN_ORDER_RENDERERS
        self._programs: dict[tuple[str, ...], Any] = {}
        for counting in (False, True):
            self.get_program(counting=counting)
        self.context.raise_pending_error("building the shaders")

    def get_program(self, *, counting: bool, deep: bool = False, textured: bool = False) -> Any:
        """Return the program for drawing or for counting, with a depth test if `deep`."""
        fragment = "draw.frag"
        if counting:
            fragment = "count_in_order.frag" if self._in_order else "count.frag"
        defines = ["DEPTH"] * deep + ["TEXTURE"] * textured
        key = (fragment, *defines)
        if key not in self._programs:
            self._programs[key] = self.context.build_program("draw.vert", fragment, *defines)
        return self._programs[key]

    def _draw_and_count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        self.context.activate()
        totals = np.zeros((len(frame.grid), len(SHADED)), np.int64)
        targets = {"samples_passed": context.SAMPLES_PASSED, **self.context.statistics}
        driver = dict.fromkeys(targets, 0)
        for part in split_batches(frame, triangles):
            totals += self._count_per_polygon(Mesh(self, frame, part, options, counting=True), part)
            # The driver's queries are for another draw, without the storage writes of counting,
            # because these writes change which work a driver may skip.
            mesh = Mesh(self, frame, part, options)
            mesh.bind()
            for name, result in self.context.count_by_queries(targets, mesh.draw).items():
                driver[name] += result
        self.context.raise_pending_error("counting")
        counters = {name: totals[:, k].copy() for k, name in enumerate(SHADED)}
        fragments, quads, helpers = (counters[name] for name in SHADED[:3])
        if (4 * quads != fragments + helpers).any():
            raise NoRasteriserError(
                f"{self.device.name}: the OpenGL driver does not report helper invocations; "
                "choose another device"
            )
        counters |= {name: np.array(total, np.int64) for name, total in driver.items()}
        if frame.depths is not None:
            ties = count_visible_per_triangle(frame, triangles)["depth_ties"]
            if (
                options.samples == 1
                and abs(fragments.sum() - driver["samples_passed"]) > ties.sum()
            ):
                raise NoRasteriserError(
                    f"{self.device.name}: the OpenGL driver does not test depth before shading; "
                    "choose another device, or depth=none"
                )
            counters["depth_ties"] = sum_per_polygon(frame, triangles, ties)
        return counters

    def _count_per_polygon(self, mesh: "Mesh", triangles: Triangles) -> NDArray[np.int64]:
        """Draw, and return the counters `SHADED` of each polygon, (p, 5).

        The first covered lane of each quad counts the quad and sets the triangle's bit. Shaders of
        `IN_ORDER_RENDERERS` cannot detect helper lanes, so a buffer has each quad's last triangle.
        """
        shape = (len(mesh.frame.grid), len(SHADED))
        counts = self.context.create_buffer(np.zeros(shape, np.uint32))
        counts.bind_to_storage_buffer(0)
        # llvmpipe discards the triangles collected for a tile, including their storage writes,
        # when an opaque triangle covers the tile. A draw that keeps the target's alpha does not
        # count as opaque.
        mesh.target.color_mask = KEEP_ALPHA
        mesh.bind()
        if self._in_order:
            self._draw_in_order(mesh, len(triangles))
        else:
            covering = self.context.create_buffer(np.zeros(len(triangles) // 32 + 1, np.uint32))
            covering.bind_to_storage_buffer(1)
            mesh.draw()
        mesh.target.color_mask = WRITE_ALL
        self.ctx.memory_barrier()
        read = np.frombuffer(counts.read(), np.uint32)[: shape[0] * shape[1]]
        totals: NDArray[np.int64] = read.reshape(shape).astype(np.int64)
        if self._in_order:
            totals[:, 2] = 4 * totals[:, 1] - totals[:, 0]
            totals[:, 3] = totals[:, 1] - totals[:, 3]  # the shader counts full quads
        return totals

    def _draw_in_order(self, mesh: "Mesh", number: int) -> None:
        columns, rows = (mesh.frame.width + 1) // 2, (mesh.frame.height + 1) // 2
        last = self.context.create_buffer(np.zeros(1 + columns * rows, np.uint32))
        last.bind_to_storage_buffer(1)
        mesh.program["columns"] = columns
        mesh.clear_depths()
        # A draw per triangle: softpipe draws no pixels if a shader reads gl_PrimitiveID.
        for triangle in range(number):
            mesh.program["triangle"] = triangle + 1
            mesh.vertices.render(vertices=3, first=3 * triangle)

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        self.context.activate()
        return Mesh(self, frame, triangles, options)


class OSMesa(OpenGL):
    """Rasteriser with the shaders and counters of `opengl`, on OSMesa.

    OSMesa is the off-screen interface of Mesa before 25.1, a software driver.
    """

    name = "osmesa"
    device_names: ClassVar[tuple[str, ...]] = ("osmesa",)
    remedies: ClassVar[Mapping[str, str]] = {
        "": f"run: {INSTALL_OSMESA} (not in Mesa 25.1 and newer)"
    }
    drawn_by: ClassVar[str] = "llvmpipe"

    @classmethod
    def devices(cls) -> list[Device]:
        """Return the only device, if libOSMesa is installed."""
        # The library is located but not opened, as opening it loads a driver.
        installed = ctypes.util.find_library("OSMesa")
        if installed is None:
            return []
        environment = {"GALLIUM_DRIVER": "llvmpipe", "LP_NUM_THREADS": "0"}
        return [Device("osmesa", True, environment, {"library": installed})]

    def _open(self, device: Device) -> Any:
        return OSMesaContext(device.details["library"])


class Mesh(Drawing):
    """Triangles on the device, bound to a program and a framebuffer."""

    def __init__(
        self,
        owner: OpenGL,
        frame: Frame,
        triangles: Triangles,
        options: Options,
        *,
        counting: bool = False,
    ) -> None:
        deep = frame.depths is not None
        self.context = owner.context
        self.software = owner.device.software
        self.frame = frame
        self.options = options
        self.counting = counting
        self.draws = frame.split_by_draw(triangles)
        self.textured = options.texture > 0 and not counting
        self.program = owner.get_program(counting=counting, deep=deep, textured=self.textured)
        size = (frame.width, frame.height)
        self.target = self.context.get_framebuffer(*size, options.samples, deep=deep)
        points, polygons, indices = self.context.upload(frame, triangles)
        content = [(points, "2i", "position"), (polygons, "1u", "polygon")]
        if frame.depths is not None:
            content.append((self.context.create_buffer(frame.depths), "1i", "depth"))
        self.vertices = owner.ctx.vertex_array(self.program, content, indices)

    def sample(self, repeats: int) -> Sample:
        """Draw `repeats` times.

        On a GPU a single call draws all repeats as instances, so that the GPU never waits for a
        call. A software driver collects a frame and would skip what a later draw covers, so it gets
        a call and a flush per draw and map tile. With a depth test each draw is a call that clears
        the depths first, also on a GPU.
        """
        self.context.activate()
        self.program["work"] = self.options.work
        self.bind()
        if not self.software and self.frame.depths is None:
            return self.context.time_draws(1, partial(self.draw, repeats), self.context.flush)
        draws = cycle(self.draws)
        calls = repeats * len(self.draws)
        return self.context.time_draws(
            calls, lambda: self.draw_rows(next(draws)), self.context.flush
        )

    def bind(self) -> None:
        """Make the framebuffer and the viewport current, as `draw` requires."""
        width, height = self.frame.width, self.frame.height
        self.target.use()
        self.target.viewport = (0, 0, width, height)
        self.target.scissor = self.frame.scissor
        self.program["size"] = (SUBPIXEL * width, SUBPIXEL * height)
        if self.textured:
            self.context.texture.use(0)
            self.program["content"] = 0
            self.program["lookups"] = self.options.texture
        ctx = self.context.ctx
        (ctx.disable if self.frame.depths is None else ctx.enable)(ctx.DEPTH_TEST)

    def draw(self, instances: int = 1) -> None:
        """Submit the triangles in one call per tile or view; a call draws `instances` instances."""
        for rows in self.draws:
            self.draw_rows(rows, instances)

    def clear_depths(self) -> None:
        """Clear the depths before a tile or a view, if there is a depth test."""
        if self.frame.depths is not None:
            self.context.clear(context.DEPTH_BUFFER_BIT)

    def draw_rows(self, rows: slice, instances: int = 1) -> None:
        """Submit the triangles `rows` in a call that draws `instances` instances."""
        self.clear_depths()
        if self.counting:
            self.program["start"] = rows.start
        count = 3 * (rows.stop - rows.start)
        self.vertices.render(vertices=count, first=3 * rows.start, instances=instances)
