"""What rasterisers on OpenGL share: which devices there are, opening one, uploading a frame."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any, ClassVar

import glcontext  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriser
from harness.frame import SUBPIXEL, Frame
from harness.rasterisers import context, egl
from harness.rasterisers.base import Device, Rasteriser, Triangles
from harness.rasterisers.context import Context


class GLRasteriser(Rasteriser):
    """A rasteriser on OpenGL through EGL, without a window.

    `context` is the open context, `ctx` moderngl's view of it; `device` is completed with what
    the driver says about itself.
    """

    known: ClassVar[tuple[str, ...]] = ("gpu0", "llvmpipe", "softpipe", "zink")

    @classmethod
    def devices(cls) -> list[Device]:
        """List GPUs, then llvmpipe, softpipe and zink on lavapipe, as far as they open."""
        return list(egl.probe()[0])

    @classmethod
    def knows(cls, name: str) -> bool:
        """Whether `name` is one of these; gpu0, gpu1, ... are."""
        return name in cls.known or (name.startswith("gpu") and name[3:].isdigit())

    @classmethod
    def remedy(cls, name: str | None = None) -> str:
        """Say how to get a device."""
        if name and name.startswith("gpu"):
            return "EGL finds no such GPU; install its vendor's driver, or choose llvmpipe"
        if name == "zink":
            return f"run: {egl.INSTALL_VULKAN}"
        return f"run: {egl.INSTALL}"

    def __init__(self, device: Device) -> None:
        for key, value in device.environment.items():
            if os.environ.get(key) != value:
                raise NoRasteriser(f"{device.name} needs {key}={value} before its driver loads")
        self.context = Context(self._open(device))
        self.ctx = self.context.ctx
        strings = self.context.strings()
        if not self._matches(device, strings["renderer"]):
            self.context.close()
            raise NoRasteriser(
                f"asked for {device.name}, but OpenGL opened '{strings['renderer']}'; "
                f"{self.remedy(device.name)}"
            )
        if self.ctx.version_code < context.MODERN:
            self.context.require(*context.OLDER_EXTENSIONS)
        self.device = replace(
            device,
            software=egl.is_software(strings["renderer"]),
            details={
                **device.details,
                **strings,
                "subpixel_bits": self.context.integer(context.SUBPIXEL_BITS),
                "max_size": self.context.max_size,
                "max_samples": self.context.max_samples,
            },
        )
        self.context.check("opening the device")

    def _open(self, device: Device) -> Any:
        """Create a context, an object with glcontext's methods."""
        try:
            return glcontext.get_backend_by_name("egl")(
                mode="standalone",
                glversion=330,
                device_index=device.details["egl_index"],
                libgl="libGL.so.1",
                libegl="libEGL.so.1",
            )
        except Exception as error:  # glcontext raises plain Exception
            raise NoRasteriser(f"{device.name}: {error}; {self.remedy(device.name)}") from error

    def _matches(self, device: Device, renderer: str) -> bool:
        return egl.matches(device.name, renderer)

    def close(self) -> None:
        """Close the context."""
        self.context.activate()
        self.context.close()


class Upload:
    """A frame's points and triangles in buffers of the device.

    points : (n,) ivec2, in 1/256 px; polygons : (n,) uint, the number of each point's polygon;
    indices : (3 m,) int
    """

    def __init__(self, owner: Context, frame: Frame, triangles: Triangles) -> None:
        self.owner = owner
        self.size = (frame.width, frame.height)
        self.triangles = len(triangles)
        numbers = np.arange(len(frame.offsets) - 1, dtype=np.uint32)
        self.points = owner.buffer(np.ascontiguousarray(frame.points, np.int32))
        self.polygons = owner.buffer(np.repeat(numbers, np.diff(frame.offsets)))
        self.indices = owner.buffer(triangles)

    def close(self) -> None:
        """Free the buffers."""
        self.owner.activate()
        for buffer in (self.points, self.polygons, self.indices):
            buffer.release()


def batches(frame: Frame, triangles: Triangles) -> list[Triangles]:
    """Split `triangles` so that no batch can count past the 32 bits of a counter on the device.

    A triangle touches at most the quads of its bounding box.
    """
    corners = frame.points[triangles].astype(np.int64)
    sides = (corners.max(axis=1) - corners.min(axis=1)) // SUBPIXEL + 4
    lanes: NDArray[np.int64] = np.cumsum(sides.prod(axis=1))
    if not len(lanes) or lanes[-1] < 2**32:
        return [triangles]
    return np.split(triangles, np.flatnonzero(np.diff(lanes // 2**31)) + 1)
