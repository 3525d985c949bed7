"""What a part's file says of itself, whatever it holds, and what it takes to make one."""

from __future__ import annotations

import contextlib
import ctypes
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import psutil

from harness.errors import UsageError, of_system
from harness.machine import environment
from harness.scaling.parts import Part
from scenes import SceneError

_code_version = cache(environment.code_version)

AT_A_TIME = 12_500
"""Rows that are in memory at a time; a process has 450 MB with them."""


@dataclass(frozen=True)
class Done:
    """A part that is in the folder.

    counts : [kind, reason, polygons] of what was dropped, repaired or failed
    proven : polygons whose optimum is proven
    certified : fields of `Certified`, where that was asked for
    about : the part's key, input and options, and the code's version
    seconds, cpu_seconds, peak_bytes : what it took, by the clock and of the cores, and the most
        memory its process had; None where the file was there already
    notes : what was done to the file as a whole
    """

    polygons: int
    vertices: int
    triangles: int
    proven: int
    counts: list[list[Any]]
    certified: dict[str, Any] | None
    about: dict[str, Any]
    seconds: float | None = None
    cpu_seconds: float | None = None
    peak_bytes: int | None = None
    notes: list[str] = field(default_factory=list)

    def counted(self) -> Counter[tuple[str, str]]:
        """Return `counts` by kind and reason."""
        return Counter({(kind, reason): count for kind, reason, count in self.counts})


def about(part: Part, options: Mapping[str, Any], code: str) -> dict[str, Any]:
    """Return what a part's file says of where it comes from."""
    rows = None if part.rows is None else list(part.rows)
    return {
        "key": part.key,
        "source": part.source,
        "identity": part.identity,
        "rows": rows,
        "options": dict(options),
        "code": code,
    }


def lasting(done: Done) -> dict[str, Any]:
    """Return what the file says: nothing that differs from one execution to the next."""
    passing = ("seconds", "cpu_seconds", "peak_bytes")
    return {name: value for name, value in asdict(done).items() if name not in passing}


def make_part(
    place: Path, code: str, read: Callable[[Path], Done | None], make: Callable[[], Done]
) -> Done:
    """Make a part's file at `place`, unless it is there; returns what it says, and what it took.

    read : what a file says of itself; None where it is no such file, or is damaged
    make : makes the file

    Raises
    ------
    UsageError
        if the part cannot be read or the file cannot be written, or this process has other code
    """
    begun, used = time.perf_counter(), time.process_time()
    require_code(code)
    if (there := read(place)) is not None:
        return there
    try:
        done = make()
    except SceneError as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        if (there := read(place)) is not None:  # somebody else has made it meanwhile
            return there
        raise UsageError(of_system(error)) from error
    release()
    seconds, cpu_seconds = time.perf_counter() - begun, time.process_time() - used
    return replace(done, seconds=seconds, cpu_seconds=cpu_seconds, peak_bytes=peak())


def require_code(code: str) -> None:
    """Raise UsageError if this process has other code than whoever gave the task."""
    own = _code_version()
    if own != code:
        raise UsageError(
            f"this worker has another version of raster-harness ({own}, not {code}): "
            "install the same on all machines"
        )


def release() -> None:
    """Give memory back to the system that libraries keep for later."""
    with contextlib.suppress(ImportError):
        import pyarrow as pa

        pa.default_memory_pool().release_unused()
    with contextlib.suppress(OSError, AttributeError):  # glibc alone has it
        ctypes.CDLL(None).malloc_trim(0)


def peak() -> int:
    """Return the most memory in bytes that this process ever had."""
    used = psutil.Process().memory_info()
    try:
        import resource
    except ImportError:  # Windows
        return int(getattr(used, "peak_wset", used.rss))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
