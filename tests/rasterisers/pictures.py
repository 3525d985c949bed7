"""Pictures of drawings, (height, width, 4) RGBA, and an independent evaluation of coverage."""

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.measuring import tasks
from harness.rasterisers import Device, Options, Rasteriser, Triangles
from harness.rasterisers.reference import count_per_triangle

Image = NDArray[np.uint8]


def draw_image(name: str, device: Device, *case: Any) -> Image:
    """Return the picture, top row first, of a drawing on a device open in this process."""
    return read_image(tasks._get_rasteriser(name, device), *case)


def read_image(kind: Rasteriser, frame: Frame, triangles: Triangles, options: Options) -> Image:
    with kind.prepare(frame, triangles, options) as drawing:
        return READERS.get(kind.name, _of_compute)(drawing, frame)


def _of_opengl(drawing: Any, frame: Frame) -> Image:
    drawing.context.activate()
    source = target = drawing.target
    target.scissor = None
    target.clear(0.0, 0.0, 0.0, 0.0)
    drawing.sample(1)
    target.scissor = None
    if target.samples:
        source = drawing.context.get_framebuffer(frame.width, frame.height)
        drawing.context.ctx.copy_framebuffer(source, target)
    pixels = np.frombuffer(source.read(components=4), np.uint8)
    return pixels.reshape(frame.height, frame.width, 4)[::-1].copy()


def _of_reference(drawing: Any, _: Frame) -> Image:
    drawing.sample(1)
    picture = np.ascontiguousarray(drawing.picture[::-1])
    return picture.view(np.uint8).reshape(*picture.shape, 4)


def _of_webgpu(drawing: Any, frame: Frame) -> Image:
    gpu, size = drawing.gpu, (frame.width, frame.height, 1)
    layout = {"bytes_per_row": 4 * frame.width, "rows_per_image": frame.height}
    encoder = gpu.create_command_encoder()
    cleared = {"view": drawing.target, "load_op": "clear", "store_op": "store"}
    encoder.begin_render_pass(color_attachments=[{**cleared, "clear_value": (0, 0, 0, 0)}]).end()
    gpu.queue.submit([encoder.finish()])
    drawing.sample(1)
    data = gpu.queue.read_texture({"texture": drawing.target.texture}, layout, size)
    return np.frombuffer(data, np.uint8).reshape(frame.height, frame.width, 4)[::-1].copy()


def _of_pyrender(drawing: Any, _: Frame) -> Image:
    drawing.sample(1)  # sets the size
    for scene in drawing.scenes:
        colour, _ = drawing.owner.renderer.render(scene, flags=drawing.flags)
    opaque = np.full(colour.shape[:2], 255, np.uint8)
    return np.dstack([colour, opaque])[..., :4]  # OSMesa's has no alpha


def _of_compute(drawing: Any, frame: Frame) -> Image:
    texture = drawing.context.get_picture(frame.width, frame.height)
    texture.write(np.zeros((frame.height, frame.width), np.uint32))
    drawing.sample(1)
    pixels = np.frombuffer(texture.read(), np.uint8)
    return pixels.reshape(frame.height, frame.width, 4)[::-1].copy()


READERS = {
    "opengl": _of_opengl,
    "osmesa": _of_opengl,
    "reference": _of_reference,
    "webgpu": _of_webgpu,
    "pyrender": _of_pyrender,
}

SIZE = 16


def find_covered(corners) -> np.ndarray:
    """Evaluate the edge functions of one triangle at every pixel centre, (SIZE, SIZE) bool."""
    a, b, c = [(int(x), int(y)) for x, y in corners]
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if area == 0:
        return np.zeros((SIZE, SIZE), bool)
    ring = [a, b, c, a] if area > 0 else [a, c, b, a]
    y, x = 256 * np.indices((SIZE, SIZE)) + 128
    covered = np.ones((SIZE, SIZE), bool)
    for (x0, y0), (x1, y1) in pairwise(ring):
        dx, dy = x1 - x0, y1 - y0
        side = dx * (y - y0) - dy * (x - x0)
        is_top_or_left = dy < 0 or (dy == 0 and dx > 0)
        covered &= side >= 0 if is_top_or_left else side > 0
    return covered


def count_blocks(mask: np.ndarray, side: int) -> int:
    return int(mask.reshape(SIZE // side, side, SIZE // side, side).any(axis=(1, 3)).sum())


def require_exact_counts(corners) -> None:
    """Check all counters of a triangle against an evaluation of every pixel."""
    mask = find_covered(corners)
    points = np.array(corners, np.int32)
    counts = count_per_triangle(points, np.array([[0, 1, 2]], np.int32))
    assert counts["fragments"][0] == mask.sum()
    assert counts["quads"][0] == count_blocks(mask, 2)
    full = mask.reshape(SIZE // 2, 2, SIZE // 2, 2).all(axis=(1, 3)).sum()
    assert counts["partial_quads"][0] == counts["quads"][0] - full
    assert counts["covering_triangles"][0] == mask.any()
    assert counts["blocks"][0] == count_blocks(mask, 4)
    assert 4 * counts["quads"][0] == counts["fragments"][0] + counts["helper_lanes"][0]
    centres = 256 * np.arange(SIZE) + 128
    within = (points.min(axis=0) <= centres[:, None]) & (centres[:, None] <= points.max(axis=0))
    assert counts["bbox_tests"][0] == within.sum(axis=0).prod()
