"""Triangulators that go wrong in every way a third party's may."""

import ctypes
import os
import signal
import sys
import time

import numpy as np
from shapely import Polygon


def segfault(polygon: Polygon) -> None:
    ctypes.string_at(0)


def hang(polygon: Polygon) -> None:
    time.sleep(3600)


def devour(polygon: Polygon) -> None:
    hoard = [np.zeros(1 << 27) for _ in range(1000)]
    raise AssertionError(len(hoard))


def kills_its_parent(polygon: Polygon) -> None:
    os.kill(os.getppid(), signal.SIGKILL)
    time.sleep(3600)


def shouts(polygon: Polygon) -> None:
    os.write(1, b"x" * 1_000_000)
    os._exit(1)


def exits(polygon: Polygon) -> None:
    sys.exit(0)


def exits_hard(polygon: Polygon) -> None:
    os._exit(0)


def interrupts(polygon: Polygon) -> None:
    raise KeyboardInterrupt


class NoException(BaseException):
    """What `except Exception` lets through."""


def raises_no_exception(polygon: Polygon) -> None:
    raise NoException("enough")


def raises(polygon: Polygon) -> None:
    raise RuntimeError("no idea")


def returns_nothing(polygon: Polygon) -> None:
    return None


def returns_nan(polygon: Polygon) -> np.ndarray:
    return np.full((3, 3), np.nan)


def returns_out_of_range(polygon: Polygon) -> np.ndarray:
    return np.array([[0, 1, 1000]])


def returns_coordinates(polygon: Polygon) -> np.ndarray:
    return np.array(polygon.exterior.coords)


def returns_overlapping(polygon: Polygon) -> np.ndarray:
    return np.array([[0, 1, 2], [0, 1, 2], [0, 1, 2], [0, 1, 2]])


def returns_too_little(polygon: Polygon) -> np.ndarray:
    return np.array([[0, 1, 2]])


def forks(polygon: Polygon) -> np.ndarray:
    """Right, but each time a process is left behind that holds copies of everything open."""
    if os.fork() == 0:
        time.sleep(3600)
    return right(polygon)


def dies_at_large(polygon: Polygon) -> np.ndarray:
    """Right, but a polygon of more than 100 areas ends its process."""
    if polygon.area > 100.0:
        ctypes.string_at(0)
    return right(polygon)


def right(polygon: Polygon) -> np.ndarray:
    """A triangulation by somebody else, clockwise and of another integer type."""
    from triangulators import triangulate

    return triangulate(polygon, "ear-clipping")[:, ::-1].astype(np.uint64)


def forgets_the_rest(polygon: Polygon) -> np.ndarray:
    """Give the first two triangles."""
    return right(polygon)[:2]
