"""The protobuf wire format, as far as vector tiles need it.

Source: the encoding that the Protocol Buffers documentation defines; wire types 0, 1, 2 and 5.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
"""Wire types."""

_FIXED = {FIXED64: 8, FIXED32: 4}
_MORE, _LOW = 0x80, 0x7F


def fields(data: memoryview) -> Iterator[tuple[int, int, Any]]:
    """Yield (number, wire type, value) of each field of a message; an int, or a memoryview.

    Raises ValueError where the message ends in a field, or has a wire type that there is not.

    >>> [(number, kind, value) for number, kind, value in fields(memoryview(b"\\x78\\x02"))]
    [(15, 0, 2)]
    """
    place, end = 0, len(data)
    while place < end:
        key, place = _varint(data, place)
        kind = key & 7
        if kind == VARINT:
            value, place = _varint(data, place)
            yield key >> 3, kind, value
            continue
        if kind == BYTES:
            size, place = _varint(data, place)
        elif kind in _FIXED:
            size = _FIXED[kind]
        else:
            raise ValueError(f"wire type {kind} is none of protobuf's")
        if place + size > end:
            raise ValueError(f"a field of {size} bytes is cut off")
        yield key >> 3, kind, data[place : place + size]
        place += size


def _varint(data: memoryview, place: int) -> tuple[int, int]:
    """The number that begins at `place`, and where the next field begins."""
    value = shift = 0
    while shift < 70:
        if place >= len(data):
            raise ValueError("a number is cut off")
        byte = data[place]
        place += 1
        value |= (byte & _LOW) << shift
        if byte < _MORE:
            return value, place
        shift += 7
    raise ValueError("a number has more than ten bytes")


def packed(values: NDArray[np.int64]) -> bytes:
    """Numbers from 0 to 2^32 - 1 as a packed field.

    >>> list(packed(np.array([9, 300])))
    [9, 172, 2]
    """
    lengths = 1 + sum((values >= 1 << bits).astype(np.int64) for bits in (7, 14, 21, 28))
    ends = np.cumsum(lengths)
    place = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - lengths, lengths)
    parts = (np.repeat(values, lengths) >> (7 * place)) & _LOW
    more = place < np.repeat(lengths, lengths) - 1
    return (parts | np.where(more, _MORE, 0)).astype(np.uint8).tobytes()


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
    ends = np.flatnonzero(content < _MORE)
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
        part = content[starts[more] + byte].astype(np.int64) & _LOW
        values[more] |= part << (7 * byte)
    return values & 0xFFFFFFFF
