"""What the drawings that are timed leave behind, of every rasteriser: (height, width, 4) RGBA."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.frame import Frame
from harness.measuring import tasks
from harness.rasterisers import Device, Image, Options, Rasteriser, Triangles


def image(name: str, device: Device, frame: Frame, triangles: Triangles, options: Options) -> Image:
    """Draw on the device, in the process that has it open; top row first."""
    return image_of(tasks._opened(name, device), frame, triangles, options)


def image_of(rasteriser: Rasteriser, frame: Frame, triangles: Triangles, options: Options) -> Image:
    if hasattr(rasteriser, "image"):
        return rasteriser.image(frame, triangles, options)
    with rasteriser.prepare(frame, triangles, options) as drawing:
        read = {"webgpu": _of_webgpu, "pyrender": _of_pyrender}.get(rasteriser.name, _of_compute)
        return read(drawing, frame)


def _of_webgpu(drawing: Any, frame: Frame) -> Image:
    gpu, size = drawing.gpu, (frame.width, frame.height, 1)
    pixels = np.zeros((frame.height, frame.width, 4), np.uint8)
    layout = {"bytes_per_row": 4 * frame.width, "rows_per_image": frame.height}
    encoder = gpu.create_command_encoder()
    cleared = {"view": drawing.target.view, "load_op": "clear", "store_op": "store"}
    encoder.begin_render_pass(color_attachments=[{**cleared, "clear_value": (0, 0, 0, 0)}]).end()
    gpu.queue.submit([encoder.finish()])
    drawing.sample(1)
    data = gpu.queue.read_texture({"texture": drawing.target.texture}, layout, size)
    pixels[:] = np.frombuffer(data, np.uint8).reshape(pixels.shape)[::-1]
    return pixels


def _of_pyrender(drawing: Any, _: Frame) -> Image:
    return [drawing.draw(scene) for scene in drawing.scenes][-1]


def _of_compute(drawing: Any, frame: Frame) -> Image:
    texture = drawing.picture.texture
    texture.write(np.zeros((frame.height, frame.width), np.uint32))
    drawing.sample(1)
    pixels = np.frombuffer(texture.read(), np.uint8)
    return pixels.reshape(frame.height, frame.width, 4)[::-1].copy()
