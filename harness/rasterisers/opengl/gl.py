"""What rasterisers on OpenGL share: which devices there are, and opening the one asked for."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any, ClassVar

import glcontext  # type: ignore[import-untyped]

from harness.errors import NoRasteriser
from harness.rasterisers.base import Device, Rasteriser
from harness.rasterisers.opengl import context, egl
from harness.rasterisers.opengl.context import Context
from triangulators.devices import is_software, matches


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
            software=is_software(strings["renderer"]),
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
        return matches(device.name, renderer)

    def close(self) -> None:
        """Close the context."""
        self.context.activate()
        self.context.close()
