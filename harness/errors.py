"""Errors that a user can cause, and the exit codes the command line ends with."""

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
INCONCLUSIVE = 5
"""Too noisy to say, or a part of what was asked for failed: what was done is kept."""
DEFECT = 70
"""A defect of the harness itself, as sysexits.h has it: 1 means a regression, and nothing else."""
INTERRUPTED = 130
"""Ended by Ctrl-C, SIGTERM or SIGHUP, as shells have it."""
BROKEN_PIPE = 141
"""Whoever read the output stopped reading, as shells have it."""


class HarnessError(Exception):
    """Base of all errors of this package, printed as one line; `exit_code` ends the command."""

    exit_code = BAD_INPUT


class UsageError(HarnessError):
    """A name, option or argument is invalid, or options contradict each other."""


class InputError(HarnessError):
    """An input file is missing, invalid, truncated or unsupported, or holds nothing usable."""


class StorageError(HarnessError):
    """A file or folder cannot be read or written (disk full, no permission, in use)."""


class IncompatibleRunsError(HarnessError):
    """Runs or parts cannot be combined: other plans, scenes, versions or formats."""


class NoRasteriserError(HarnessError):
    """No rasteriser or device of the requested kind works on this machine."""

    exit_code = NO_RASTERISER


class NothingMeasuredError(HarnessError):
    """Nothing was measured, or nothing can be compared."""

    exit_code = NOTHING_MEASURED


class InconclusiveError(HarnessError):
    """Times are too noisy for a conclusion, or a part of the work failed."""

    exit_code = INCONCLUSIVE


def of_system(error: OSError) -> str:
    """Return one line for what the system refused, with what to do."""
    where = f"{error.filename}: " if error.filename else ""
    reason = f"{where}{error.strerror or error or type(error).__name__}"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"{reason}; free some space, and try again"
    if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
        return f"{reason}; name a place that can be read and written, e.g. with --out"
    return reason


def unknown(kind: str, name: str, known: Iterable[str]) -> UsageError:
    """Build the error for an unknown name of a kind, e.g. "device", with the nearest of `known`."""
    return UsageError(f"unknown {kind} '{name}'; {suggest(name, sorted(known), cutoff=0.4)}")


def refuse_failed(counts: Mapping[tuple[str, str], int], out: Path) -> None:
    """Raise `InconclusiveError` if polygons failed.

    counts : (kind, reason) to polygons dropped, repaired or failed
    """
    failed = sum(count for (kind, _), count in counts.items() if kind == "failed")
    if failed:
        raise InconclusiveError(
            f"{failed:,} {'polygons' if failed > 1 else 'polygon'} failed; the rest is in "
            f"{os.path.relpath(out)}"
        )
