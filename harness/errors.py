"""Errors that a user can cause, and the exit codes the command line ends with."""

import difflib
import errno
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

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
    """Base of all errors shown to the user as one line; `exit_code` is the process's exit code."""

    exit_code = BAD_INPUT


class UsageError(HarnessError):
    """A name, option or file that cannot be used as given."""


class NoRasteriser(HarnessError):  # noqa: N818 - says what there is not
    """No rasteriser or device of the requested kind works on this machine."""

    exit_code = NO_RASTERISER


class NothingMeasured(HarnessError):  # noqa: N818 - says what happened
    """Nothing was measured, or can be compared."""

    exit_code = NOTHING_MEASURED


class Inconclusive(HarnessError):  # noqa: N818 - says what came out
    """Too noisy to say, or a part of what was asked for failed."""

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


def did_you_mean(name: str, known: Iterable[str], like: float = 0.4, otherwise: str = "") -> str:
    """Return a clause that names the nearest of the `known` names.

    like : how near it has to be, 0 to 1 for the same; otherwise : said where none is; by default
        all that are known
    """
    choices = sorted(known)
    near = difflib.get_close_matches(name, choices, n=1, cutoff=like)
    if near:
        return f"did you mean '{near[0]}'?"
    return otherwise or f"known: {', '.join(choices) or 'none'}"


def unknown(kind: str, name: str, known: Iterable[str]) -> UsageError:
    """Build the error for an unknown name of a kind, e.g. "device", with the nearest of `known`."""
    return UsageError(f"unknown {kind} '{name}'; {did_you_mean(name, known)}")


def refuse_failed(counts: Mapping[tuple[str, str], int], out: Path) -> None:
    """Raise `Inconclusive` if polygons failed.

    counts : (kind, reason) to polygons dropped, repaired or failed
    """
    failed = sum(count for (kind, _), count in counts.items() if kind == "failed")
    if failed:
        raise Inconclusive(
            f"{failed:,} {'polygons' if failed > 1 else 'polygon'} failed; the rest is in "
            f"{os.path.relpath(out)}"
        )
