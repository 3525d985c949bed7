"""Wavefront OBJ: vertices and n-gon faces."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenes.readers.opening import LONGEST, numbered_lines
from scenes.scene import SceneError


def parse(path: Path) -> tuple[NDArray[np.float64], list[NDArray[np.int64]]]:
    """(n, 3) vertices and, for each face, the indices of its vertices from 0.

    Indices that point at nothing are left for the caller to find. Raises SceneError, with the
    line's number, for a line that is not OBJ.
    """
    vertices: list[list[float]] = []
    faces: list[NDArray[np.int64]] = []
    for number, line in _continued(path):
        words = line.split()
        try:
            if words[:1] == ["v"]:
                x, y, z = map(float, words[1:4])
                vertices.append([x, y, z])
            elif words[:1] == ["f"]:
                faces.append(_face(words[1:], len(vertices)))
        except ValueError as error:
            text = line.strip()[:60]
            raise SceneError(f"{path} line {number} is not OBJ: {text!r}") from error
    if not faces:
        raise SceneError(f"{path} holds no face: give a model with faces")
    return np.array(vertices, dtype=float).reshape(-1, 3), faces


def _continued(path: Path) -> Iterator[tuple[int, str]]:
    """Lines with those that follow a backslash; the number is that of the last one."""
    parts: list[str] = []
    number = length = 0
    for number, line in numbered_lines(path):
        text = line.rstrip("\r\n")
        length += len(text)
        if text.endswith("\\") and length < LONGEST:
            parts.append(text[:-1])
            continue
        yield number, " ".join([*parts, text])
        parts, length = [], 0
    if parts:
        yield number, " ".join(parts)


def _face(words: list[str], count: int) -> NDArray[np.int64]:
    """ "7/1/3" is vertex 7, counted from 1; "-1" is the last one so far."""
    given = [int(word.partition("/")[0]) for word in words]
    return np.array([i - 1 if i > 0 else count + i if i < 0 else -1 for i in given], dtype=np.int64)
