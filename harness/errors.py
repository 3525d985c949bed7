"""Errors that a user can cause, each with the exit code the command line ends with."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

GOOD = 0
REGRESSION = 1
BAD_INPUT = 2
NO_RASTERISER = 3
NOTHING_MEASURED = 4
INCONCLUSIVE = 5


class HarnessError(Exception):
    """Base of all errors shown to the user as one line; `exit_code` is the process's exit code."""

    exit_code = BAD_INPUT


class UsageError(HarnessError):
    """A name, option or file that cannot be used as given."""


class NoRasteriser(HarnessError):  # noqa: N818 - says what there is not
    """No rasteriser or device of the requested kind works on this machine."""

    exit_code = NO_RASTERISER


class NothingMeasured(HarnessError):  # noqa: N818 - says what happened
    """Every case was skipped or failed."""

    exit_code = NOTHING_MEASURED


def unknown(kind: str, name: str, known: Iterable[str]) -> UsageError:
    """Build the error for an unknown `name`, naming the nearest of the `known` ones.

    Parameters
    ----------
    kind : what is named, e.g. "device"
    """
    return UsageError(f"unknown {kind} '{name}'; {suggestion(name, sorted(known))}")


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the end of a message on an unknown name: the nearest known one, or all.

    >>> suggestion("opengi", ["opengl", "reference"])
    "did you mean 'opengl'?"
    >>> suggestion("x", ["opengl", "reference"])
    'known: opengl, reference'
    """
    choices = list(known)
    near = difflib.get_close_matches(name, choices, n=1, cutoff=0.4)
    return f"did you mean '{near[0]}'?" if near else f"known: {', '.join(choices) or 'none'}"
