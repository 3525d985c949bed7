"""Whether a study that was run twice says the same both times."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from harness.figures.groups import group_of, groups, time_ratio, without_twins
from harness.figures.intervals import UNDECIDED
from harness.stored.folder import Record


@dataclass(frozen=True)
class Verdicts:
    """How two runs' verdicts on the same pairs agree, on one rasteriser and device.

    pairs : pairs of triangulations timed together in both runs
    same : pairs with the same verdict in both: faster, slower, or no difference shown
    decided : pairs for which both runs say which one is faster
    agreeing : pairs among `decided` for which they say the same
    """

    rasteriser: str
    device: str
    pairs: int
    same: int
    decided: int
    agreeing: int


@dataclass(frozen=True)
class Repeat:
    """How two runs of the same cases agree.

    cases : counted in both runs; unequal : keys of those with a counter that differs
    """

    cases: int
    unequal: tuple[str, ...]
    verdicts: tuple[Verdicts, ...]


def repeat(first: Sequence[Record], second: Sequence[Record]) -> Repeat:
    """Compare two runs' counters case by case, and their verdicts pair by pair.

    Pairs are of triangulations of the same polygons, on one device in one view; two names of one
    triangulation are no pair.
    """
    others = {record["key"]: record for record in second if record["status"] == "ok"}
    common = [r for r in first if r["status"] == "ok" and r["key"] in others]
    unequal = [r["key"] for r in common if r["counters"] != others[r["key"]]["counters"]]
    found = []
    for place in dict.fromkeys((r["rasteriser"], r["device"]) for r in common):
        here = [r for r in common if (r["rasteriser"], r["device"]) == place]
        one, other = _verdicts(here), _verdicts([others[record["key"]] for record in here])
        both = Counter((one[pair], other[pair]) for pair in one.keys() & other.keys())
        decided = {pair: count for pair, count in both.items() if UNDECIDED not in pair}
        found.append(
            Verdicts(
                *place,
                pairs=both.total(),
                same=sum(count for (a, b), count in both.items() if a == b),
                decided=sum(decided.values()),
                agreeing=sum(count for (a, b), count in decided.items() if a == b),
            )
        )
    return Repeat(len(common), tuple(unequal), tuple(v for v in found if v.pairs))


def _verdicts(records: Sequence[Record]) -> dict[tuple[object, ...], str]:
    found: dict[tuple[object, ...], str] = {}
    for members in groups(records):
        ordered = sorted(members, key=lambda record: str(record["triangulator"]))
        for one, other in combinations(without_twins(ordered), 2):
            ratio = time_ratio(one, other)
            if ratio is not None:
                names = (one["triangulator"], other["triangulator"])
                found[(*group_of(one), *names)] = ratio.verdict
    return found
