"""Differences between Linux, macOS and Windows: process groups, signals, limits, file locks.

Only this module imports platform-specific modules, and only in the functions that need them.
"""

import contextlib
import ctypes
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import psutil
from platformdirs import user_cache_path

T = TypeVar("T")

TEMPORARY_PREFIX = "raster-harness-tmp-"  # of the folder that `harness.supervisor` creates
HANGUP: signal.Signals | None = getattr(signal, "SIGHUP", None)  # closed terminal; None on Windows

STOPPING = tuple(number for number in (signal.SIGINT, signal.SIGTERM, HANGUP) if number is not None)
"""Signals that request the end of a program."""

BINARY: int = getattr(os, "O_BINARY", 0)  # without it, Windows writes "\n" as two bytes


def get_database_path() -> Path:
    """Return the value of RASTER_HARNESS_CACHE, or if unset a file in the user's cache folder."""
    if file := os.environ.get("RASTER_HARNESS_CACHE"):
        return Path(file)
    if os.path.expanduser("~") == "~" and not os.environ.get("XDG_CACHE_HOME"):  # noqa: PTH111
        # Neither HOME nor an entry in passwd, as in a container that runs as any user.
        shared = Path(tempfile.gettempdir())
        shared = shared.parent if shared.name.startswith(TEMPORARY_PREFIX) else shared
        folder = shared / f"raster-harness-{os.getuid()}"
    else:
        folder = user_cache_path("raster-harness", appauthor=False)
    return folder / "triangulations.sqlite"


def get_cache_file(name: str) -> Path:
    """Return the path of the file or folder `name` next to the database of triangulations."""
    return get_database_path().parent / name


@contextlib.contextmanager
def handle_signals(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Handle `STOPPING` signals in the block, in the main thread; ignored ones stay ignored."""
    is_main = threading.current_thread() is threading.main_thread()  # others cannot set handlers
    before = {
        number: signal.signal(number, handler)
        for number in STOPPING
        if is_main and signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


@contextlib.contextmanager
def delay_signals() -> Iterator[None]:
    """Delay `STOPPING` signals to the end of the block; if one came, raise KeyboardInterrupt."""
    received: list[int] = []
    with handle_signals(lambda number, _: received.append(number)):
        yield
    if received:
        raise KeyboardInterrupt


@contextlib.contextmanager
def set_variables(variables: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables during the block."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def set_limits(memory_bytes: int | None, file_bytes: int) -> None:
    """Limit this process's memory and file size; writing a larger file raises OSError (EFBIG)."""
    try:
        import resource
    except ImportError:
        return
    limits = [(resource.RLIMIT_AS, memory_bytes), (resource.RLIMIT_FSIZE, file_bytes)]
    for kind, size in limits:
        with contextlib.suppress(OSError, ValueError):  # macOS does not limit memory
            if size is not None:
                resource.setrlimit(kind, (size, size))


def disable_core_dump() -> None:
    """Prevent a core dump if this process is killed."""
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def is_running(pid: int) -> bool:
    """Return whether a process exists and has not ended."""
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def is_suspended(leader: int) -> bool:
    """Return whether a process or a child of it is suspended (SIGSTOP)."""
    try:
        process = psutil.Process(leader)
        family = [process, *process.children()]
        return any(member.status() == psutil.STATUS_STOPPED for member in family)
    except psutil.NoSuchProcess:
        return False


cpu_clock: Callable[[], float] = time.perf_counter if os.name == "nt" else time.process_time
"""CPU time in s of all threads of this process; on Windows, where CPU time has a resolution of
16 ms, wall-clock time."""


class RunQueueClock:
    """Time that this process's threads have waited for a core; Linux only."""

    # Files stay open, because opening a file takes longer than some draws.

    def __init__(self) -> None:
        self._owner = os.getpid()
        self._files: dict[str, int] = {}

    def read(self) -> dict[str, int] | None:
        """Return each thread's nanoseconds of waiting (in `schedstat`); None if unavailable."""
        if os.getpid() != self._owner:  # in a fork, the open files are about the parent's threads
            self.close()
            self._owner = os.getpid()
        waited_ns: dict[str, int] = {}
        try:
            for thread in os.listdir("/proc/self/task"):  # noqa: PTH208 - before each draw
                if thread not in self._files:
                    path = f"/proc/self/task/{thread}/schedstat"
                    self._files[thread] = os.open(path, os.O_RDONLY)
                try:
                    waited_ns[thread] = int(os.pread(self._files[thread], 64, 0).split()[1])
                except ProcessLookupError:  # the thread has ended
                    os.close(self._files.pop(thread))
        except (OSError, ValueError, IndexError):
            return None
        return waited_ns

    def close(self) -> None:
        """Close the files."""
        for descriptor in self._files.values():
            os.close(descriptor)
        self._files.clear()


def query_psutil(function: Callable[[], T]) -> T | None:
    """Return the result of a function that uses psutil, or None if it fails, as in a sandbox."""
    try:
        return function()
    except (OSError, psutil.Error, NotImplementedError):
        return None


def read_steal_time_s() -> float:
    """Return the steal time of all cores, in seconds; 0 if not reported by the system."""
    return float(getattr(query_psutil(psutil.cpu_times), "steal", 0.0))


def read_other_processes_s() -> float:
    """Return the CPU seconds of all other processes since the start of the system; 0 if unknown."""
    total = query_psutil(psutil.cpu_times)
    process = query_psutil(lambda: psutil.Process().cpu_times())
    if total is None or process is None:
        return 0.0
    states = ("user", "nice", "system", "irq", "softirq")
    busy_s = sum(float(getattr(total, state, 0.0)) for state in states)
    return busy_s - float(process.user + process.system)


def start_process_group() -> None:
    """Make this process the leader of a new process group, on systems with process groups."""
    if hasattr(os, "setpgid"):
        os.setpgid(0, 0)


def kill_group(leader: int) -> None:
    """Kill the process group of `leader`, even if the leader has ended."""
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(leader, signal.SIGKILL)
        return
    kill_descendants(leader)
    with contextlib.suppress(psutil.NoSuchProcess):
        psutil.Process(leader).kill()


def kill_descendants(ancestor: int) -> None:
    """Kill all processes that `ancestor` and its descendants have started."""
    with contextlib.suppress(psutil.Error, OSError):
        for process in psutil.Process(ancestor).children(recursive=True):
            with contextlib.suppress(psutil.Error):
                process.kill()


def end_with_parent(parent: int) -> None:
    """Make the kernel kill this process when the process `parent` ends; Linux only."""
    if sys.platform != "linux":
        return
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)
    if os.getppid() != parent:  # the parent had ended before the call above
        os._exit(1)


def become_subreaper() -> None:
    """Make this process the parent of orphaned descendants; Linux only."""
    if sys.platform == "linux":
        pr_set_child_subreaper = 36
        ctypes.CDLL(None).prctl(pr_set_child_subreaper, 1)


def kill_orphans(parent: int) -> None:
    """Kill processes that `parent` adopted: children in other sessions, and their descendants."""
    gone = (psutil.NoSuchProcess, ProcessLookupError)
    with contextlib.suppress(*gone):
        session = os.getsid(parent)
        for child in psutil.Process(parent).children():
            with contextlib.suppress(*gone):
                if os.getsid(child.pid) != session:
                    kill_descendants(child.pid)
                    child.kill()


def read_umask() -> int:
    """Return the umask of this process: the permissions that new files do not get."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def lock_file(descriptor: int, *, wait: bool = True, required: bool = False) -> bool:
    """Lock an open file and return True; closing the file releases the lock.

    Without `wait`, return False if another process holds the lock, and with `required` also if the
    file system does not support locks.
    """
    try:
        import fcntl
    except ImportError:  # on Windows a locked range cannot be read, so lock a range beyond the end
        import msvcrt

        position = os.lseek(descriptor, 0, os.SEEK_CUR)
        os.lseek(descriptor, 2**40, os.SEEK_SET)
        try:
            # Windows waits for ten seconds at most.
            mode = msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK  # type: ignore[attr-defined]
            msvcrt.locking(descriptor, mode, 1)  # type: ignore[attr-defined]
        except OSError:
            if wait:
                raise
            return False
        finally:
            os.lseek(descriptor, position, os.SEEK_SET)
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except OSError:  # the file system does not support locks
        if wait:
            raise
        return not required
    return True


def describe_exit(code: int | None) -> str:
    """Return how a process ended, in words, given the exit code that multiprocessing reports."""
    if code is not None and code < 0:
        names = {number.value: number.name for number in signal.Signals}
        name = names.get(-code, f"signal {-code}")  # most real-time signals have no name
        hint = " (perhaps out of memory)" if name == "SIGKILL" else ""
        return f"{name}{hint}"
    if code is not None and code > 255:  # a Windows status, such as 0xC0000005
        return f"exit code 0x{code:08X}"
    return f"exit code {code}"
