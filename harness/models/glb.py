"""Writes binary glTF (GLB).

Source: Khronos, "glTF 2.0 Specification", section 4.4.
"""

import os
import shutil
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from harness.errors import UsageError
from scenes.readers.gltf import JSON, MAGIC

MAX_BYTES = 2**32 - 1
"""Largest GLB file: the header holds its length in 32 bits."""

_COPIED_BYTES = 1 << 20


def write_glb(stream: IO[bytes], chunks: Sequence[tuple[bytes, IO[bytes]]], out: Path) -> None:
    """Write chunks, (type, content), to a GLB file; `out` is its name for messages."""
    lengths = [content.seek(0, os.SEEK_END) for _, content in chunks]
    total = 12 + sum(8 + length + -length % 4 for length in lengths)
    if total > MAX_BYTES:
        raise UsageError(
            f"{out} would be {total / 2**30:.1f} GiB, and GLB ends at 4 GiB: "
            "write .gltf, or fewer polygons with limit"
        )
    stream.write(struct.pack("<4sII", MAGIC, 2, total))
    for (kind, content), length in zip(chunks, lengths, strict=True):
        stream.write(struct.pack("<I4s", length + -length % 4, kind))
        content.seek(0)
        shutil.copyfileobj(content, stream, _COPIED_BYTES)
        stream.write((b" " if kind == JSON else b"\0") * (-length % 4))
