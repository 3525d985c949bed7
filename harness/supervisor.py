"""Supervision: the program runs in a child process that can be stopped at any moment.

Python handles no signal while a library's C++ code runs, for minutes to hours (ear clipping of 10^6
vertices). So the process that the user started forks before anything is loaded: the child runs the
program; the parent forwards signals, and kills the child and all descendants at a time limit.

The parent also removes a folder for temporary files after the child has ended in any way, and the
folders of killed parents, at its own start and end.

Supervision exists only on Linux, where the kernel ends the child with the parent, and a fork is
safe.
"""

import os
import select
import shutil
import signal
import sys
import tempfile
import time
from contextlib import suppress
from math import inf
from pathlib import Path

from harness.errors import INTERRUPTED
from harness.machine import system

END_TIMEOUT_S = 2.0  # limit for the program to end after a signal
CLEANUP_TIMEOUT_S = 15.0  # the same limit after a call of `allow_cleanup`

# Delay of forwarding: meanwhile the child may receive the signal from the terminal, which is then
# not forwarded.
FORWARD_AFTER_S = 0.05

KILL_ATTEMPTS, KILL_INTERVAL_S = 20, 0.02  # number and interval of attempts
MAX_FOLDER_LENGTH = 70  # bytes of the temporary folder's path; a socket's path may have 107

# Bytes that `allow_cleanup` writes to the parent's pipe. The others are the numbers of signals,
# which Python writes when the child receives them.
_CLEANUP, _NO_LIMIT = 254, 255

_channel: int | None = None  # the child's end of the pipe to the parent


def allow_cleanup(*, unlimited: bool = False) -> None:
    """Ask the parent, in a signal handler, for `CLEANUP_TIMEOUT_S` before it kills this process.

    With `unlimited` there is no limit, as this process will end by itself or at the next signal.
    """
    if _channel is not None:
        with suppress(OSError):
            os.write(_channel, bytes([_NO_LIMIT if unlimited else _CLEANUP]))


def continue_in_child() -> None:
    """Fork, and return in the child; the parent supervises the child and exits with its code.

    Without Linux or a further process, return in this process, without supervision.
    """
    global _channel
    if sys.platform != "linux" or not hasattr(os, "fork"):
        return
    folder = _make_folder()
    pipes = os.pipe(), os.pipe()
    for _, writing in pipes:
        os.set_blocking(writing, False)
    (from_child, to_parent), (from_signals, to_self) = pipes
    parent = os.getpid()
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {*system.STOPPING, signal.SIGCHLD})
    try:
        child = os.fork()
    except OSError:
        child = None
    if child:
        signal.set_wakeup_fd(to_self)
        watched = [n for n in system.STOPPING if signal.getsignal(n) != signal.SIG_IGN]
        for number in (*watched, signal.SIGCHLD):
            signal.signal(number, lambda *_: None)  # `to_self` gets the number
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        os.close(to_parent)
        try:
            code = _Supervisor(child, from_child, from_signals).wait()
        finally:
            if folder:
                shutil.rmtree(folder, ignore_errors=True)
                _remove_abandoned(folder.parent)
        os._exit(code)
    unused = [from_child, from_signals, to_self]
    if child is None:
        unused.append(to_parent)
        if folder:
            shutil.rmtree(folder, ignore_errors=True)
    else:
        system.end_with_parent(parent)
        signal.set_wakeup_fd(to_parent, warn_on_full_buffer=False)
        _channel = to_parent
        if folder:
            os.environ["TMPDIR"] = tempfile.tempdir = str(folder)
    for descriptor in unused:
        os.close(descriptor)
    signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


class _Supervisor:
    def __init__(self, child: int, from_child: int, from_signals: int) -> None:
        self._child = child
        self._from_child, self._from_signals = from_child, from_signals
        self._received: dict[int, float] = {}
        self._to_forward: dict[int, float] = {}
        self._deadline = inf
        system.become_subreaper()

    def wait(self) -> int:
        poll, is_open = select.poll(), True
        for descriptor in (self._from_child, self._from_signals):
            os.set_blocking(descriptor, False)
            poll.register(descriptor, select.POLLIN)
        while (code := self._collect_exit_code()) is None:
            time_s = time.monotonic()
            for number in [n for n, due in self._to_forward.items() if due <= time_s]:
                del self._to_forward[number]
                os.kill(self._child, number)
            if time_s >= self._deadline:
                self._kill()
                return _print_and_return("stopped", INTERRUPTED)
            due = min([self._deadline, *self._to_forward.values()])
            poll.poll(None if due == inf else 1000 * (due - time_s) + 1)
            self._schedule_forwarding()
            if is_open and not self._apply_child_signals():
                is_open = False  # the child is ending
                poll.unregister(self._from_child)
        if self._received:
            self._kill_descendants()
        if code >= 0:
            return code
        why = system.describe_exit(code)
        return _print_and_return(
            f"error: the program was ended by {why}; try a smaller scene", 128 - code
        )

    def _collect_exit_code(self) -> int | None:
        """Return the child's exit code, or minus the signal that ended it; None while it runs."""
        code = None
        with suppress(ChildProcessError):
            while (ended := os.waitpid(-1, os.WNOHANG))[0]:
                if ended[0] == self._child:
                    code = os.waitstatus_to_exitcode(ended[1])
        return code

    def _schedule_forwarding(self) -> None:
        time_s = time.monotonic()
        for number in _read_pipe(self._from_signals) or b"":
            is_known = time_s - self._received.get(number, -inf) < FORWARD_AFTER_S
            if number in system.STOPPING and not is_known:
                self._to_forward.setdefault(number, time_s + FORWARD_AFTER_S)
                self._deadline = min(self._deadline, time_s + END_TIMEOUT_S)

    def _apply_child_signals(self) -> bool:
        """Apply the signals and requests in the child's pipe; return whether the pipe is open."""
        time_s = time.monotonic()
        content = _read_pipe(self._from_child)
        for number in content or b"":
            if number == _NO_LIMIT:
                self._deadline = inf
            elif number == _CLEANUP:
                self._deadline = time_s + CLEANUP_TIMEOUT_S
            elif number in system.STOPPING:
                self._received[number] = time_s
                self._to_forward.pop(number, None)
                self._deadline = min(self._deadline, time_s + END_TIMEOUT_S)
        return content != b""

    def _kill(self) -> None:
        os.kill(self._child, signal.SIGKILL)
        os.waitpid(self._child, 0)
        self._kill_descendants()
        if os.isatty(2):
            os.write(2, b"\033[?25h\n")  # show the cursor, which progress bars hide

    def _kill_descendants(self) -> None:
        with suppress(ChildProcessError):  # none is left
            for _ in range(KILL_ATTEMPTS):
                system.kill_descendants(os.getpid())
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
                time.sleep(KILL_INTERVAL_S)


def _read_pipe(descriptor: int) -> bytes | None:
    """Return the content of a pipe, b"" at the end, or None if the pipe is empty."""
    try:
        return os.read(descriptor, 4096)
    except BlockingIOError:
        return None


def _print_and_return(line: str, code: int) -> int:
    with suppress(OSError):
        os.write(2, f"{line}\n".encode())
    return code


def _make_folder() -> Path | None:
    with suppress(OSError):
        shared = Path(tempfile.gettempdir())
        _remove_abandoned(shared)
        folder = Path(tempfile.mkdtemp(prefix=system.TEMPORARY_PREFIX, dir=shared))
        if len(os.fsencode(folder)) <= MAX_FOLDER_LENGTH and _lock_folder(folder) is not None:
            return folder if folder.exists() else None
        folder.rmdir()
    return None


def _remove_abandoned(shared: Path) -> None:
    for folder in shared.glob(f"{system.TEMPORARY_PREFIX}*"):
        with suppress(OSError):
            if folder.is_symlink() or folder.lstat().st_uid != os.getuid():
                continue
            descriptor = _lock_folder(folder)
            if descriptor is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(descriptor)


def _lock_folder(folder: Path) -> int | None:
    """Lock a temporary folder; return the lock's descriptor, or None if the folder is in use."""
    # The lock file may be missing: a process was killed before it locked the new folder.
    descriptor = os.open(folder / "lock", os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o600)
    if system.lock_file(descriptor, wait=False, required=True):
        return descriptor
    os.close(descriptor)
    return None
