"""Turns the errors that libraries raise on damaged files into one clear line each.

A library may raise any exception on bytes that it did not expect, so a list of exceptions is never
complete. Everything that a reader raises ends at one of the two boundaries here. With
`RASTER_HARNESS_DEBUG=1` there is no boundary: the error is raised with its traceback.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from scenes.scene import Note, SceneError

DEBUG = "RASTER_HARNESS_DEBUG"
"""Environment variable that switches the boundaries off."""


@contextmanager
def clear_errors(
    name: str, kind: str, explain: Callable[[Exception], str | None] | None = None
) -> Iterator[None]:
    """Turn whatever is raised within into a SceneError of one line.

    name : the file, as the user gave it
    kind : what it was read as, e.g. "GeoParquet"
    explain : may give a better message than the general one

    >>> with clear_errors("a.svg", "SVG"):
    ...     raise LookupError("unknown encoding:\\n no-such-code")
    Traceback (most recent call last):
    scenes.scene.SceneError: a.svg cannot be read as SVG: unknown encoding: no-such-code (it is \
damaged or has another format: write it again)
    """
    try:
        yield
    except SceneError:
        raise
    except MemoryError as error:
        raise SceneError(
            f"{name} needs more memory than there is: it is damaged, or give only a part of it"
        ) from error
    except Exception as error:
        if debugging():
            raise
        general = (
            f"{name} cannot be read as {kind}: {reason(error)} "
            "(it is damaged or has another format: write it again)"
        )
        raise SceneError((explain and explain(error)) or general) from error


@contextmanager
def noted(notes: list[Note], which: str, what: str) -> Iterator[None]:
    """Add a note to `notes` for whatever is raised within: one bad item costs that item only.

    >>> notes = []
    >>> with noted(notes, "line 7", "is not sound"):
    ...     raise KeyError("vertices")
    >>> notes
    [('line 7', "is not sound: no 'vertices'")]
    """
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        if debugging():
            raise
        notes.append((which, f"{what}: {reason(error)}"))


def reason(error: Exception) -> str:
    """What an error says, in one line.

    >>> reason(ValueError("no\\n  number")), reason(KeyError("type")), reason(EOFError())
    ('no number', "no 'type'", 'EOFError')
    """
    text = " ".join(str(error).split())
    if isinstance(error, KeyError):
        return f"no {text}"
    return text or type(error).__name__


def debugging() -> bool:
    """Whether the boundaries are switched off.

    >>> debugging()
    False
    """
    return os.environ.get(DEBUG, "") not in ("", "0")
