"""Errors that a user can cause, and exit codes of the command line."""

import errno
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from triangulators.errors import suggest

GOOD = 0
REGRESSION = 1
BAD_INPUT = 2
NO_RASTERISER = 3
NOTHING_MEASURED = 4
INCONCLUSIVE = 5  # times too noisy for a conclusion, or some work failed; results are stored
DEFECT = 70  # internal error of the harness (EX_SOFTWARE of sysexits.h); 1 means a regression
INTERRUPTED = 130  # by Ctrl-C, SIGTERM or SIGHUP, as in shells
BROKEN_PIPE = 141  # the reader of the output closed the pipe, as in shells


class HarnessError(Exception):
    """Base class of errors that end a command with one printed line and `exit_code`."""

    exit_code = BAD_INPUT


class UsageError(HarnessError):
    """A name, option or argument is invalid, or options contradict each other."""


class InputError(HarnessError):
    """An input file is missing, invalid, truncated, unsupported, or without usable content."""


class StorageError(HarnessError):
    """A file or folder cannot be read or written (disk full, no permission, in use)."""


class IncompatibleRunsError(HarnessError):
    """Runs or parts of a run cannot be combined: plans, scenes, versions or formats differ."""


class NoRasteriserError(HarnessError):
    """No rasteriser or device of the requested kind works on this machine."""

    exit_code = NO_RASTERISER


class NothingMeasuredError(HarnessError):
    """No case was measured, or no cases can be compared."""

    exit_code = NOTHING_MEASURED


class InconclusiveError(HarnessError):
    """Times are too noisy for a conclusion, or a part of the work failed."""

    exit_code = INCONCLUSIVE


def is_memory_error(error: BaseException) -> bool:
    """Return whether the cause is too little memory, also for loading a library or a thread."""
    signs = ("failed to map segment", "annot allocate memory", "can't start new thread")
    return isinstance(error, MemoryError) or any(sign in str(error) for sign in signs)


def format_os_error(error: OSError) -> str:
    """Return one line about an error of the operating system, with a remedy."""
    path = f"{error.filename}: " if error.filename else ""
    reason = f"{path}{error.strerror or error or type(error).__name__}"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"{reason}; free some space, and try again"
    if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
        return f"{reason}; choose a readable and writable path, e.g. with --out"
    return reason


def make_unknown_name_error(kind: str, name: str, names: Iterable[str]) -> UsageError:
    """Return the error for an unknown `name` of a `kind`, such as "device", with suggestions."""
    return UsageError(f"unknown {kind} '{name}'; {suggest(name, sorted(names), cutoff=0.4)}")


def raise_if_failed(counts: Mapping[tuple[str, str], int], out: Path) -> None:
    """Raise InconclusiveError if a polygon of the export failed; `counts` by (kind, reason)."""
    failed = sum(count for (kind, _), count in counts.items() if kind == "failed")
    if failed:
        raise InconclusiveError(
            f"{failed:,} {'polygons' if failed > 1 else 'polygon'} failed; the others are in "
            f"{os.path.relpath(out)}"
        )
