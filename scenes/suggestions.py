"""Suggestions for a name that is not known."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def suggestion(name: str, known: Iterable[str], otherwise: str = "there are") -> str:
    """The end of an error message: the nearest of the known names, or all of them.

    >>> suggestion("ctiy", ["city", "glyphs"])
    'did you mean city?'
    >>> suggestion("qqqqq", ["city", "glyphs"])
    'there are: city, glyphs'
    """
    choices = list(known)
    nearest = difflib.get_close_matches(name, choices, n=1)
    return f"did you mean {nearest[0]}?" if nearest else f"{otherwise}: {', '.join(choices)}"
