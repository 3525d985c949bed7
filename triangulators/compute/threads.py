"""Work that is shared out among threads; compiled code lets them run at the same time."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def shared_out(work: Callable[[int], Result], slices: int) -> list[Result]:
    """Return `work(0)` to `work(slices - 1)`; a single slice needs no thread."""
    if slices == 1:
        return [work(0)]
    with ThreadPoolExecutor(cores()) as pool:
        return list(pool.map(work, range(slices)))
