"""What Linux, macOS and Windows do each in their own way: process groups, signals, limits, files.

Modules and calls that some of them lack are looked for when they are needed and never imported
elsewhere.
"""

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
from platformdirs import user_cache_path

HANGUP: signal.Signals | None = getattr(signal, "SIGHUP", None)
"""What a process gets when its terminal closes; Windows has no such signal."""

STOPPING = tuple(number for number in (signal.SIGINT, signal.SIGTERM, HANGUP) if number is not None)
"""Signals that ask a program to end."""

BINARY: int = getattr(os, "O_BINARY", 0)
"""Flag of os.open without which Windows turns each newline into two bytes."""


def cache_file(name: str) -> Path:
    """Return a file of the user's cache, beside the model database (`RASTER_HARNESS_CACHE`)."""
    given = os.environ.get("RASTER_HARNESS_CACHE")
    folder = Path(given).parent if given else user_cache_path("raster-harness", appauthor=False)
    return folder / name


@contextlib.contextmanager
def stopped_by(stop: Callable[[int, Any], None], wanted: Callable[[Any], bool]) -> Iterator[None]:
    """Have `stop` called for the signals of `STOPPING` whose handler until now is `wanted`."""
    before = {
        number: signal.signal(number, stop)
        for number in STOPPING
        if wanted(signal.getsignal(number))
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def stopped_after() -> Iterator[None]:
    """Hold back what stops the program until the block has ended; then it is KeyboardInterrupt."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread is told of signals
        return
    came: list[int] = []
    with stopped_by(lambda number, _: came.append(number), lambda before: before != signal.SIG_IGN):
        yield
    if came:
        raise KeyboardInterrupt


def limit(memory_bytes: int | None, file_bytes: int) -> None:
    """Limit what this process may allocate, and its files, where the system can be told so.

    To write more raises OSError: EFBIG.
    """
    try:
        import resource
    except ImportError:
        return
    limits = [(resource.RLIMIT_AS, memory_bytes), (resource.RLIMIT_FSIZE, file_bytes)]
    for kind, size in limits:
        with contextlib.suppress(OSError, ValueError):  # macOS refuses to limit memory
            if size is not None:
                resource.setrlimit(kind, (size, size))


def leave_no_core() -> None:
    """Have the system write no image of this process's memory when it is killed."""
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def is_running(pid: int) -> bool:
    """Whether there is such a process, and it has not ended."""
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def is_stopped(leader: int) -> bool:
    """Whether a process, or a child of it, has been stopped (SIGSTOP)."""
    try:
        process = psutil.Process(leader)
        each = [process, *process.children()]
        return any(one.status() == psutil.STATUS_STOPPED for one in each)
    except psutil.NoSuchProcess:
        return False


cpu_clock: Callable[[], float] = time.perf_counter if os.name == "nt" else time.process_time
"""Seconds that all threads of this process computed; Windows tells them in steps of 16 ms, too
coarse for one polygon, so that it is the wall clock there."""


class WaitedFor:
    """How long the threads of this process have waited for a core; Linux alone tells.

    Files stay open, for opening them anew would take longer than some draws do.
    """

    def __init__(self) -> None:
        self._owner = os.getpid()
        self._files: dict[str, int] = {}

    def read(self) -> dict[str, int] | None:
        """Return the nanoseconds so far by thread, None where the system does not tell.

        It is the second number of `schedstat`: time on a run queue, not on a core.
        """
        if os.getpid() != self._owner:  # what a fork took along tells of another process
            self.close()
            self._owner = os.getpid()
        found: dict[str, int] = {}
        try:
            for thread in os.listdir("/proc/self/task"):  # noqa: PTH208 - before each draw
                if thread not in self._files:
                    path = f"/proc/self/task/{thread}/schedstat"
                    self._files[thread] = os.open(path, os.O_RDONLY)
                try:
                    found[thread] = int(os.pread(self._files[thread], 64, 0).split()[1])
                except ProcessLookupError:  # it has ended since
                    os.close(self._files.pop(thread))
        except (OSError, ValueError, IndexError):
            return None
        return found

    def close(self) -> None:
        """Close the files."""
        for descriptor in self._files.values():
            os.close(descriptor)
        self._files.clear()


def stolen_s() -> float:
    """Return the seconds that the host has taken from all cores; 0 where the system tells none."""
    return float(getattr(psutil.cpu_times(), "steal", 0.0))


def others_s() -> float:
    """Return the seconds that all other processes have computed, on all cores, since the start."""
    all_of_them, own = psutil.cpu_times(), psutil.Process().cpu_times()
    spent = ("user", "nice", "system", "irq", "softirq")
    busy = sum(float(getattr(all_of_them, name, 0.0)) for name in spent)
    return busy - float(own.user + own.system)


def lead_group() -> None:
    """Make this process the first of a group of its own, for `end_group`, where there are any."""
    if hasattr(os, "setpgid"):
        os.setpgid(0, 0)


def end_group(leader: int) -> None:
    """Kill the process `leader` and what it has started, whether or not it lives."""
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(leader, signal.SIGKILL)
        return
    with contextlib.suppress(psutil.NoSuchProcess):
        process = psutil.Process(leader)
        for child in [*process.children(recursive=True), process]:
            with contextlib.suppress(psutil.NoSuchProcess):
                child.kill()


def adopt() -> None:
    """Make this process the parent of all that its descendants start and leave; Linux only."""
    if sys.platform == "linux":
        pr_set_child_subreaper = 36
        ctypes.CDLL(None).prctl(pr_set_child_subreaper, 1)


def end_strays(parent: int) -> None:
    """Kill what `parent` has adopted: its children in other sessions than its own, and theirs."""
    gone = (psutil.NoSuchProcess, ProcessLookupError)
    with contextlib.suppress(*gone):
        own = os.getsid(parent)
        for child in psutil.Process(parent).children():
            with contextlib.suppress(*gone):
                if os.getsid(child.pid) != own:
                    for each in [*child.children(recursive=True), child]:
                        each.kill()


def others_may_write(file: Path) -> bool:
    """Whether users who are neither its owner nor of its group may change a file."""
    with contextlib.suppress(OSError):
        return os.name == "posix" and bool(file.stat().st_mode & 0o002)
    return False


def umask() -> int:
    """Return what the user takes away from the permissions of new files."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def lock(descriptor: int, *, wait: bool = True) -> bool:
    """Take the lock on an open file; closing it gives it back.

    wait : until no other process has it; else nothing is done then, and False returned
    """
    try:
        import fcntl
    except ImportError:  # Windows: what is locked cannot be read, so lock what is never written
        import msvcrt

        place = os.lseek(descriptor, 0, os.SEEK_CUR)
        os.lseek(descriptor, 2**40, os.SEEK_SET)
        try:
            # Who waits gives up after ten seconds, as whoever waits for a database does.
            how = msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK  # type: ignore[attr-defined]
            msvcrt.locking(descriptor, how, 1)  # type: ignore[attr-defined]
        except OSError:
            if wait:
                raise
            return False
        finally:
            os.lseek(descriptor, place, os.SEEK_SET)
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except OSError:  # a file system that knows no locks
        if wait:
            raise
    return True


def ending(code: int | None) -> str:
    """Say how a process ended, of which multiprocessing tells `code`."""
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        hint = " (perhaps out of memory)" if name == "SIGKILL" else ""
        return f"{name}{hint}"
    if code is not None and code > 255:  # a Windows status, such as 0xC0000005
        return f"exit code 0x{code:08X}"
    return f"exit code {code}"
