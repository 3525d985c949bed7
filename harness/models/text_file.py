"""A text in which the words for the corners of triangles are replaced, and nothing else."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.models.mesh import centred, tolerance_of
from harness.stored.output import Output

Ints = NDArray[np.int64]

SHARE = 1e-6
"""Of a model's size, the most that the decimals of a text may leave open."""


class TextFile:
    """The bytes of a text, and what is to stand in them instead."""

    def __init__(self, path: Path) -> None:
        self.data = path.read_bytes()
        self._pieces: list[tuple[int, int, bytes]] = []

    def replace(self, spans: Ints, old: Ints, new: Ints, words: list[bytes]) -> None:
        """Let triangles `old` (m, 3) of vertices be `new`.

        spans : (m, 3, 2) where the words of each corner begin and end; words : (n,) each vertex's
        """
        for row in np.flatnonzero((old != new).any(axis=1)).tolist():
            for (first, last), vertex in zip(spans[row].tolist(), new[row].tolist(), strict=True):
                self._pieces.append((first, last, words[vertex]))

    def write(self, out: Path) -> list[Path]:
        """Write the text; returns the files."""
        parts: list[bytes] = []
        done = 0
        for first, last, word in sorted(self._pieces):
            parts += [self.data[done:first], word]
            done = last
        return write_bytes(out, b"".join([*parts, self.data[done:]]))


def write_bytes(out: Path, data: bytes) -> list[Path]:
    """Write a file, whole or not at all; returns it."""
    with Output(out) as output:
        with output.file() as file:
            file.write(data)
        return output.publish()


def text_step(words: Iterable[bytes]) -> float:
    """Return what numbers written so leave open: one of their last decimal."""
    return 10.0 ** -max((len(word.partition(b".")[2].rstrip()) for word in words), default=0)


def text_tolerance(positions: NDArray[np.float64], step: float) -> float:
    """Return by how much a face may be bent whose positions (n, 3) were written in a text."""
    local = centred(positions)
    largest = float(np.abs(local[np.isfinite(local)]).max(initial=0.0))
    return max(tolerance_of(local), min(step, SHARE * largest))


def numbered(rows: NDArray[np.generic]) -> tuple[Ints, Ints]:
    """Return the first of equal rows, (k,), and (n,) which of these each row is."""
    _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first, number.reshape(-1)
