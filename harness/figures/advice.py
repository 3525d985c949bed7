"""What the records of a group say, in one sentence: what to do, and whether that is shown."""

from __future__ import annotations

from collections.abc import Sequence

from harness.figures.break_even import AFTER, AT_ONCE
from harness.figures.decision import (
    ALONE,
    COUNTED,
    COVERED,
    EQUAL,
    FEW,
    KEEP,
    SHOWN,
    Decision,
    decide,
)
from harness.figures.registry import find
from harness.stored.folder import Record


def advice(members: Sequence[Record]) -> str:
    """Return one sentence about the records of a group: which triangulator to take, and why."""
    decision = decide(members)
    if decision is None:
        return "Nothing was measured: every case was skipped or failed."
    first = decision.choice.record
    turned = f", turned by {first['rotation']:g} degrees" if first.get("rotation") else ""
    place = f"{first['device']} ({first['rasteriser']}, {first['resolution']} px{turned})"
    return f"On {place}, {_advice(decision, first['scene'])}."


def _advice(decision: Decision, scene: str) -> str:
    choice, base = decision.choice, decision.base
    take = f"triangulate {scene} by {choice.name}"
    if decision.ground == SHOWN and choice.ratio:
        ratio = choice.ratio
        if ratio.exact:
            return f"{take}: it takes {_share(1 - ratio.value)} fewer cycles than {base.name}"
        words = f"{take}: it is shown to save {_share(1 - ratio.value)} of {base.name}'s draw time "
        words += f"(95 % interval {_share(1 - ratio.high, '')} to {_share(1 - ratio.low)})"
        if choice.pays is not None and choice.pays.kind in (AT_ONCE, AFTER):
            words += f", and pays {choice.pays.written}"
        if decision.alike:
            words += f"; no difference to {listed(decision.alike)} is shown"
        return words
    if decision.ground == KEEP:
        return f"{take}: every other triangulator is shown to draw slower"
    if decision.ground == COUNTED:
        words = f"{take}: it has the least by exact count, {_counted(decision)}"
        return words + ("; times show none to be faster" if decision.timed else "")
    if decision.ground == ALONE:
        return f"{scene} was triangulated by {choice.name} alone, so there is nothing to compare"
    if decision.ground == FEW:
        covered = choice.record["counters"][COVERED]
        return f"nothing is advised for {scene}: it covers {covered:,} pixels, too few to tell"
    if decision.ground == EQUAL:
        return f"nothing is advised for {scene}: all counters are equal, and no time differs"
    counted = ", and none costs less by exact count" if choice.record.get("counters") else ""
    return f"{take}: no other is shown to be faster{counted}"


def _counted(decision: Decision) -> str:
    measure, choice, base = decision.measure, decision.choice, decision.base
    assert measure is not None
    own = choice.record["counters"][measure]
    words = f"{own:,} {find(measure).label}"
    usual = (base.record.get("counters") or {}).get(measure)
    if base is choice or not usual:
        return words
    return f"{words}, {_share(1 - own / usual)} fewer than {base.name}"


def _share(value: float, unit: str = " %") -> str:
    return f"{100 * value:.1f}{unit}"


def listed(names: Sequence[str]) -> str:
    """Return names as a sentence has them: a, b and c."""
    if len(names) == 1:
        return names[0]
    return f"{', '.join(names[:-1])} and {names[-1]}"
