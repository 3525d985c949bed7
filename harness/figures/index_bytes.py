"""What triangles add to map tiles: index data as a tile format has it, and its size when packed.

Source: MapLibre Tile specification, version 1, "Tessellation Data" and "Encoding Byte": a stream of
triangles a polygon, and one of vertices, three a triangle, each counted from the first vertex of
its own polygon; the second as zigzag differences of consecutive values (Delta); both as varints.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame

GZIP, ZSTD = 9, 19
"""Levels of packing; Brotli's is its best, 11, too: a tile is packed once and sent often."""


def index_data(triangles: NDArray[np.int32], offsets: NDArray[np.int64]) -> bytes:
    """Return the two streams of a tile's triangles (m, 3), one after the other.

    offsets : (p + 1,) polygon k has the vertices offsets[k]:offsets[k + 1]

    Triangles keep their order within a polygon; polygons are in the tile's order.
    """
    owner = np.searchsorted(offsets, triangles[:, 0], side="right") - 1
    order = np.argsort(owner, kind="stable")
    local = (triangles - offsets[owner][:, None])[order].astype(np.int64).ravel()
    counts = np.bincount(owner, minlength=len(offsets) - 1)
    return packed(counts) + packed(zigzag(np.diff(local, prepend=0)))


def triangles_of(data: bytes, offsets: NDArray[np.int64]) -> NDArray[np.int32]:
    """Undo `index_data`: (m, 3) triangles, polygon by polygon."""
    values = varints(data)
    counts, steps = np.split(values, [len(offsets) - 1])
    local = np.cumsum(unzigzag(steps)).reshape(-1, 3)
    return (local + np.repeat(offsets[:-1], counts)[:, None]).astype(np.int32)


def packers() -> dict[str, Callable[[bytes], bytes]]:
    """Return what packs tiles, by name; brotli and zstd where their packages are installed."""
    found: dict[str, Callable[[bytes], bytes]] = {"gzip": _gzip}
    for name, package, make in (("brotli", "brotli", _brotli), ("zstd", "zstandard", _zstd)):
        try:
            found[name] = make(import_module(package))
        except ImportError:
            continue
    return found


def _gzip(data: bytes) -> bytes:
    stream = zlib.compressobj(GZIP, wbits=31)
    return stream.compress(data) + stream.flush()


def _brotli(package: Any) -> Callable[[bytes], bytes]:
    pack: Callable[[bytes], bytes] = package.compress
    return pack


def _zstd(package: Any) -> Callable[[bytes], bytes]:
    pack: Callable[[bytes], bytes] = package.ZstdCompressor(level=ZSTD).compress
    return pack


def index_sizes(frame: Frame, triangles: NDArray[np.int32]) -> dict[str, int]:
    """Return the bytes of all tiles' index data, by the names of figures; tiles are packed alone.

    triangles : (m, 3) rows of the frame's points, tile by tile
    """
    assert frame.tiles is not None
    pack = packers()
    sizes = dict.fromkeys(
        ["index_bytes_raw", "index_bytes", *(f"index_bytes_{n}" for n in pack)], 0
    )
    bounds = zip(frame.tiles, frame.tiles[1:], frame.draws(triangles), strict=False)
    for first, last, rows in bounds:
        offsets = frame.offsets[first : last + 1]
        data = index_data(triangles[rows], offsets)
        vertices = int(offsets[-1] - offsets[0])
        sizes["index_bytes_raw"] += triangles[rows].size * (2 if vertices <= 2**16 else 4)
        sizes["index_bytes"] += len(data)
        for name, function in pack.items():
            sizes[f"index_bytes_{name}"] += len(function(data))
    return sizes


def packed(values: NDArray[np.int64]) -> bytes:
    """Numbers from 0 to 2^32 - 1 as a packed field.

    >>> list(packed(np.array([9, 300])))
    [9, 172, 2]
    """
    lengths = 1 + sum((values >= 1 << bits).astype(np.int64) for bits in (7, 14, 21, 28))
    ends = np.cumsum(lengths)
    place = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - lengths, lengths)
    parts = (np.repeat(values, lengths) >> (7 * place)) & 0x7F
    more = place < np.repeat(lengths, lengths) - 1
    return (parts | np.where(more, 0x80, 0)).astype(np.uint8).tobytes()


def zigzag(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of both signs as numbers that are not negative: 0, -1, 1, -2 as 0, 1, 2, 3."""
    return (values << 1) ^ (values >> 63)


def unzigzag(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Undo `zigzag`.

    >>> unzigzag(zigzag(np.array([0, -1, 1, -70]))).tolist()
    [0, -1, 1, -70]
    """
    return (values >> 1) ^ -(values & 1)


def varints(data: bytes) -> NDArray[np.int64]:
    """All numbers of a packed field at once, as uint32 in int64.

    Raises ValueError if the last one is cut off, or one has more than ten bytes.

    >>> varints(b"\\x09\\xac\\x02").tolist()
    [9, 300]
    """
    content = np.frombuffer(data, np.uint8)
    if data.isascii():  # each is one byte, as most tags are
        return content.astype(np.int64)
    ends = np.flatnonzero(content < 0x80)
    if len(content) and (not len(ends) or ends[-1] != len(content) - 1):
        raise ValueError("a number is cut off")
    starts = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    lengths = ends - starts + 1
    longest = int(lengths.max(initial=0))
    if longest > 10:
        raise ValueError("a number has more than ten bytes")
    values = np.zeros(len(ends), np.int64)
    for byte in range(min(longest, 5)):
        more = byte < lengths
        part = content[starts[more] + byte].astype(np.int64) & 0x7F
        values[more] |= part << (7 * byte)
    return values & 0xFFFFFFFF
