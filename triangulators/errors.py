"""Exceptions of the package, suggestions for unknown names, and exceptions as one line."""

import difflib
import traceback
from collections.abc import Iterable
from pathlib import Path

MAX_MESSAGE_CHARACTERS = 300  # maximum number of characters of a reported third-party message
MAX_TRACEBACK = 10_000  # maximum number of characters of a stored traceback


class TriangulationError(Exception):
    """Base of all errors of this package; raised itself if a triangulator failed on a polygon."""


class InvalidPolygonError(TriangulationError):
    """The input is not a valid polygon (empty, self-intersecting, NaN coordinates, ...)."""


class SkippedError(TriangulationError):
    """A triangulator does not support this polygon, by design; the message is the reason."""


class UnavailableError(TriangulationError):
    """An optional package is missing; the message contains the installation command."""


class UnknownNameError(TriangulationError, ValueError):
    """No triangulator, criterion, device, ... has this name; the message suggests the nearest."""


class ArgumentError(TriangulationError, ValueError):
    """An argument is invalid, or contradicts another argument or the triangulator's name."""


def suggest(name: str, names: Iterable[str], cutoff: float = 0.6, fallback: str = "") -> str:
    """Return "did you mean 'x'?" with the nearest known name, otherwise the fallback.

    The similarity has to reach `cutoff` (0 to 1); the default fallback lists all known names.

    >>> suggest("ear-cliping", ["delaunay", "ear-clipping"])
    "did you mean 'ear-clipping'?"
    >>> suggest("xyz", ["delaunay", "ear-clipping"])
    'known: delaunay, ear-clipping'
    """
    choices = list(names)
    nearest = difflib.get_close_matches(name, choices, n=1, cutoff=cutoff)
    if nearest:
        return f"did you mean '{nearest[0]}'?"
    return fallback or f"known: {', '.join(choices) or 'none'}"


def format_error(error: BaseException) -> str:
    """Return an exception's type and message as a line, with the file and line that raised it."""
    text = summarize_error(error)
    frames = traceback.extract_tb(error.__traceback__)
    return f"{text} ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else text


def summarize_error(error: BaseException) -> str:
    """Return an exception's type and message as a short line."""
    text = truncate(str(error))
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def truncate(text: str) -> str:
    """Return a text as a line of `MAX_MESSAGE_CHARACTERS` or fewer; if cut, add the full length."""
    line = " ".join(text[: 4 * MAX_MESSAGE_CHARACTERS].split())[:MAX_MESSAGE_CHARACTERS]
    return f"{line} ... ({len(text):,} characters)" if len(text) > MAX_MESSAGE_CHARACTERS else line
