"""What a triangulator can raise, and how that is told."""

import traceback
from pathlib import Path

MOST_SAID = 300
"""Characters of an error that are kept."""

MOST_TRACED = 10_000
"""Characters of a traceback that are kept."""


class TriangulationError(Exception):
    """A polygon could not be triangulated; the message says which and why."""


class InvalidPolygon(TriangulationError):  # noqa: N818 - says what the polygon is
    """The input is not a valid polygon (empty, self-intersecting, NaN coordinates, ...)."""


class Skipped(Exception):  # noqa: N818 - a status, not an error: the harness records it as such
    """A triangulator does not do this polygon, by design; the message is the reason."""


class UnknownName(ValueError):  # noqa: N818 - the name says what went wrong
    """No triangulator or criterion has this name; the message suggests the nearest."""


class Unavailable(TriangulationError):  # noqa: N818 - says what the package is
    """An optional package is missing; the message holds the line that installs it."""


def told_of(error: BaseException) -> str:
    """Return in one line, and not a long one, what was raised and where."""
    text = in_short(error)
    frames = traceback.extract_tb(error.__traceback__)
    return f"{text} ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else text


def in_short(error: BaseException) -> str:
    """Return an error's kind and message in one line, and not a long one."""
    text = shortened(str(error))
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def shortened(text: str) -> str:
    """Return a text of somebody else's in one line, cut off where it goes on and on."""
    line = " ".join(text[: 4 * MOST_SAID].split())[:MOST_SAID]
    return f"{line} ... ({len(text):,} characters)" if len(text) > MOST_SAID else line
