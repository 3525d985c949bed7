"""Counts and examples of the notes on polygons that were dropped, repaired or failed."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from scenes.scene import Note

MAX_EXAMPLES = 1000
"""Notes of a kind that are stored with their names; all are counted by reason."""


def general_reason(reason: str) -> str:
    """Return a reason without its location.

    >>> general_reason("self-intersects at 3.0 4.0; repaired into 2 polygons")
    'self-intersects'
    """
    return reason.split(" at ")[0].split(";")[0]


@dataclass
class NoteCounter:
    """Notes on polygons, of the kinds "dropped", "repaired" and "failed".

    counts : number of polygons by kind and reason
    examples : the first `MAX_EXAMPLES` notes of each kind
    """

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    examples: dict[str, list[Note]] = field(default_factory=dict)

    def note(self, kind: str, notes: Sequence[Note], times: int = 1) -> None:
        """Count notes of a kind, each of `times` polygons, and store the first of them."""
        for _, reason in notes:
            self.counts[kind, general_reason(reason)] += times
        examples = self.examples.setdefault(kind, [])
        examples += notes[: MAX_EXAMPLES - len(examples)]

    def list_examples(self, *kinds: str) -> list[tuple[str, str, str]]:
        """Return (kind, name, reason) of the stored notes of these kinds."""
        return [(kind, *note) for kind in kinds for note in self.examples.get(kind, ())]
