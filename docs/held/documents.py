"""Which document cites which figures."""

from docs.held import Held, findings

DOCUMENTS: dict[str, tuple[list[Held], tuple[str, ...]]] = {
    "docs/findings.md": (findings.HELD, findings.DEFINITIONS),
}
"""For each document what is held, and patterns of numbers that nobody measured."""
