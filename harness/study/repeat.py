"""Whether a study that was run twice says the same twice."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from harness.store import Record
from harness.summary import group_of, groups, time_ratio

SAME = ("overdraw", "half_perimeter", "edge_length", "shape")
"""Criteria that, when they are all equal, show two names for one triangulation."""


@dataclass(frozen=True)
class Repeat:
    """How two runs of the same cases agree.

    cases : counted in both runs; unequal : keys of those with a counter that differs
    pairs : pairs of triangulations timed together in both; agreeing : those with the same verdict
    opposite : those of which one run shows the first faster, the other the second
    """

    cases: int
    unequal: tuple[str, ...]
    pairs: int
    agreeing: int
    opposite: int


def repeat(first: Sequence[Record], second: Sequence[Record]) -> Repeat:
    """Compare two runs' counters case by case, and their verdicts pair by pair.

    Pairs are of triangulations of the same polygons, on one device in one view; two names of one
    triangulation are no pair.
    """
    others = {record["key"]: record for record in second if record["status"] == "ok"}
    common = [r for r in first if r["status"] == "ok" and r["key"] in others]
    unequal = [r["key"] for r in common if r["counters"] != others[r["key"]]["counters"]]
    verdicts = [_verdicts(common), _verdicts([others[record["key"]] for record in common])]
    shared = verdicts[0].keys() & verdicts[1].keys()
    both = Counter((verdicts[0][pair], verdicts[1][pair]) for pair in shared)
    return Repeat(
        cases=len(common),
        unequal=tuple(unequal),
        pairs=len(shared),
        agreeing=sum(count for (one, other), count in both.items() if one == other),
        opposite=both["faster", "slower"] + both["slower", "faster"],
    )


def _verdicts(records: Sequence[Record]) -> dict[tuple[object, ...], str]:
    found: dict[tuple[object, ...], str] = {}
    for members in groups(records):
        for one, other in combinations(_without_twins(members), 2):
            ratio = time_ratio(one, other)
            if ratio is not None:
                names = (one["triangulator"], other["triangulator"])
                found[(*group_of(one), *names)] = ratio.verdict
    return found


def _without_twins(members: Sequence[Record]) -> list[Record]:
    ordered = sorted(members, key=lambda record: str(record["triangulator"]))
    seen = {tuple(round(r["predicted"][name], 6) for name in SAME): r for r in reversed(ordered)}
    return sorted(seen.values(), key=lambda record: str(record["triangulator"]))
