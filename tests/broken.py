"""Third-party triangulators that fail in different ways."""

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


def exhaust_memory(polygon: Polygon) -> None:
    arrays = [np.zeros(1 << 27) for _ in range(1000)]
    raise AssertionError(len(arrays))


def kill_parent(polygon: Polygon) -> None:
    os.kill(os.getppid(), signal.SIGKILL)
    time.sleep(3600)


def flood_stdout(polygon: Polygon) -> None:
    os.write(1, b"x" * 1_000_000)
    os._exit(1)


def exit_success(polygon: Polygon) -> None:
    sys.exit(0)


def exit_hard(polygon: Polygon) -> None:
    os._exit(0)


def raise_interrupt(polygon: Polygon) -> None:
    raise KeyboardInterrupt


class CustomBaseException(BaseException):
    """An exception that `except Exception` does not catch."""


def raise_base_exception(polygon: Polygon) -> None:
    raise CustomBaseException("enough")


def raise_error(polygon: Polygon) -> None:
    raise RuntimeError("no idea")


def return_none(polygon: Polygon) -> None:
    return None


def return_nan(polygon: Polygon) -> np.ndarray:
    return np.full((3, 3), np.nan)


def return_out_of_range(polygon: Polygon) -> np.ndarray:
    return np.array([[0, 1, 1000]])


def return_coordinates(polygon: Polygon) -> np.ndarray:
    return np.array(polygon.exterior.coords)


def return_overlapping(polygon: Polygon) -> np.ndarray:
    return np.array([[0, 1, 2], [0, 1, 2], [0, 1, 2], [0, 1, 2]])


def return_too_few(polygon: Polygon) -> np.ndarray:
    return np.array([[0, 1, 2]])


def fork(polygon: Polygon) -> np.ndarray:
    """Return a valid triangulation, but leave a child process with copies of all open files."""
    if os.fork() == 0:
        time.sleep(3600)
    return triangulate_clockwise(polygon)


def crash_at_large(polygon: Polygon) -> np.ndarray:
    """Return a valid triangulation, but crash the process if the area exceeds 100."""
    if polygon.area > 100.0:
        ctypes.string_at(0)
    return triangulate_clockwise(polygon)


def triangulate_clockwise(polygon: Polygon) -> np.ndarray:
    """Return a valid triangulation with clockwise triangles and another integer type."""
    from triangulators import triangulate

    return triangulate(polygon, "ear-clipping")[:, ::-1].astype(np.uint64)


def return_two_triangles(polygon: Polygon) -> np.ndarray:
    return triangulate_clockwise(polygon)[:2]
