"""How deep a geometry is nested, seen before it is parsed.

GEOS reads collections in collections by recursion, without a limit, so some bytes a level are
enough to end the process with a signal.
"""

from __future__ import annotations

import struct

import numpy as np

DEEPEST = 100
"""Levels of the deepest geometry that is parsed: far more than any has, and safe on any stack."""

_HEADER = 9
"""Bytes of a nested geometry at least: byte order, type, number of parts."""
_POINT, _LINE, _POLYGON, _ARC = 1, 2, 3, 8
_HOLDERS = (4, 5, 6, 7, 9, 10, 11, 12)
"""Types made of geometries: multi-points to collections, and those of curves."""


def text_too_deep(text: str) -> bool:
    """Whether WKT is nested deeper than `DEEPEST`.

    >>> text_too_deep("POLYGON ((0 0, 1 0, 1 1, 0 0))"), text_too_deep("(" * 101)
    (False, True)
    """
    if text.count("(") <= DEEPEST:
        return False
    letters = np.frombuffer(text.encode(), dtype=np.uint8)
    levels = (letters == ord("(")).astype(np.int64) - (letters == ord(")"))
    return int(np.cumsum(levels).max()) > DEEPEST


def too_deep(wkb: bytes) -> bool:
    """Whether (E)WKB is nested deeper than `DEEPEST`. What is not WKB is not; its parser says so.

    >>> level = bytes.fromhex("010700000001000000")
    >>> too_deep(99 * level), too_deep(101 * level + bytes.fromhex("0101000000") + bytes(16))
    (False, True)
    """
    if len(wkb) <= DEEPEST * _HEADER:
        return False
    left: list[int] = []  # parts still to come, of each geometry that is open
    at, order = 0, "<"
    try:
        while len(left) <= DEEPEST:
            order = {0: ">", 1: "<"}.get(wkb[at], order)
            code = struct.unpack_from(order + "I", wkb, at + 1)[0]
            at += 9 if code & 0x20000000 else 5  # with an SRID
            kind, flat = (code & 0xFFFF) % 1000, (code & 0xFFFF) // 1000
            heights = bool(code & 0x80000000) or flat in (1, 3)
            measures = bool(code & 0x40000000) or flat in (2, 3)
            point = 8 * (2 + heights + measures)
            if kind in _HOLDERS:
                left.append(struct.unpack_from(order + "I", wkb, at)[0])
                at += 4
            else:
                at = _after(wkb, at, order, kind, point)
                if left:
                    left[-1] -= 1
            while left and left[-1] == 0:
                left.pop()
                if left:
                    left[-1] -= 1
            if not left:
                return False
    except (struct.error, IndexError):  # cut short, before it is too deep
        return False
    return True


def _after(wkb: bytes, at: int, order: str, kind: int, point: int) -> int:
    """Where a geometry without parts ends, whose coordinates begin at `at`."""
    if kind == _POINT:
        return at + point
    lines = 1
    if kind == _POLYGON:
        lines = struct.unpack_from(order + "I", wkb, at)[0]
        at += 4
    elif kind not in (_LINE, _ARC):
        raise IndexError
    for _ in range(lines):
        at += 4 + point * struct.unpack_from(order + "I", wkb, at)[0]
    return at
