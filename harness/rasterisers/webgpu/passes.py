"""What WebGPU draws into and with: a picture, a pass over it, a drawing that is timed."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from harness.rasterisers.base import Drawing, Image, Sample

FORMAT = "rgba8unorm"


class Target:
    """A picture to draw into, freed when nothing refers to it any more."""

    def __init__(self, device: Any, width: int, height: int) -> None:
        self.size = (width, height)
        self.texture = device.create_texture(
            size=(width, height, 1), format=FORMAT, usage="RENDER_ATTACHMENT|COPY_SRC"
        )
        self.view = self.texture.create_view()

    def clear(self, device: Any) -> None:
        """Set all pixels to 0."""
        encoder = device.create_command_encoder()
        with Pass(encoder, self, load="clear"):
            pass
        device.queue.submit([encoder.finish()])

    def read(self, device: Any) -> Image:
        """Return the pixels, (height, width, 4), the row of the frame's y = 0 first."""
        width, height = self.size
        layout = {"bytes_per_row": 4 * width, "rows_per_image": height}
        data = device.queue.read_texture({"texture": self.texture}, layout, (width, height, 1))
        return np.frombuffer(data, np.uint8).reshape(height, width, 4)


class Pass:
    """A render pass over a target, whose earlier content stays."""

    def __init__(
        self,
        encoder: Any,
        target: Target,
        timestamps: Mapping[str, Any] | None = None,
        load: str = "load",
    ) -> None:
        attachment = {
            "view": target.view,
            "load_op": load,
            "store_op": "store",
            "clear_value": (0, 0, 0, 0),
        }
        self._pass = encoder.begin_render_pass(
            color_attachments=[attachment],
            **({"timestamp_writes": dict(timestamps)} if timestamps else {}),
        )

    def __enter__(self) -> Any:
        return self._pass

    def __exit__(self, *_: object) -> None:
        self._pass.end()


class Timed(Drawing):
    """One triangulation in buffers of the device, drawn again and again."""

    def __init__(
        self,
        device: Any,
        pipeline: Any,
        group: Any,
        target: Target,
        buffers: Mapping[str, Any],
        draws: Sequence[slice],
        *,
        scissor: tuple[int, int, int, int],
        one_pass: bool,
        period_ns: float | None,
    ) -> None:
        self.target = target
        self.one_pass = one_pass
        self._device = device
        self._pipeline = pipeline
        self._group = group
        self._buffers = buffers
        self._draws = draws
        self._scissor = scissor
        self._period_ns = period_ns
        if period_ns is not None:
            self._queries = device.create_query_set(type="timestamp", count=2)
            self._answers = device.create_buffer(size=16, usage="QUERY_RESOLVE|COPY_SRC")

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
        start = time.perf_counter()
        for command in commands:
            self._device.queue.submit([command])
        _wait(self._device)
        wall = time.perf_counter() - start
        if self._period_ns is None:
            return Sample(wall=wall)
        begin, end = np.frombuffer(self._device.queue.read_buffer(self._answers), np.uint64)
        return Sample(wall=wall, gpu=(int(end) - int(begin)) * self._period_ns * 1e-9)

    def _encode(self, draws: Sequence[slice], instances: int, *, first: bool, last: bool) -> Any:
        """Return one pass's commands, with a timestamp before the first and after the last."""
        encoder = self._device.create_command_encoder()
        stamps: dict[str, Any] = {}
        if self._period_ns is not None and (first or last):
            stamps["query_set"] = self._queries
            stamps |= {"beginning_of_pass_write_index": 0} if first else {}
            stamps |= {"end_of_pass_write_index": 1} if last else {}
        with Pass(encoder, self.target, stamps) as render:
            render.set_pipeline(self._pipeline)
            render.set_bind_group(0, self._group)
            render.set_vertex_buffer(0, self._buffers["points"])
            render.set_vertex_buffer(1, self._buffers["polygons"])
            render.set_index_buffer(self._buffers["indices"], "uint32")
            render.set_scissor_rect(*self._scissor)
            for rows in draws:
                render.draw_indexed(3 * (rows.stop - rows.start), instances, 3 * rows.start)
        if stamps and last:
            encoder.resolve_query_set(self._queries, 0, 2, self._answers, 0)
        return encoder.finish()

    def close(self) -> None:
        """Free the buffers."""
        for buffer in self._buffers.values():
            buffer.destroy()
        if self._period_ns is not None:
            self._queries.destroy()
            self._answers.destroy()


def _wait(device: Any) -> None:
    """Wait until the device is done; what the standard offers returns some 100 us too late."""
    device._poll_wait()
