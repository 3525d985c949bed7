"""One sentence of advice about a group: which triangulator to take, and why."""

from collections.abc import Sequence

from harness.metrics.decision import COVERED, Decision
from harness.metrics.registry import find_metric
from harness.stats.intervals import FASTER
from harness.stats.run_quality import QUIET


def advice(decision: Decision | None) -> str:
    """Return one sentence about a group: which triangulator to take, and why."""
    if decision is None:
        return "Nothing was measured: every case was skipped or failed."
    group = decision.group.id
    place = f"{group.device_name} ({group.rasteriser}, {group.condition})"
    return f"On {place}, {_advice(decision, group.scene)}."


def _advice(decision: Decision, scene: str) -> str:
    choice, base = decision.choice, decision.base
    take = f"triangulate {scene} by {choice.name}"
    if decision.ground == "shown" and decision.saving:
        ratio = decision.saving
        words = f"{take}: it is shown to save {_share(1 - ratio.value)} of {base.name}'s draw time "
        words += f"(95 % interval {_share(1 - ratio.high, '')} to {_share(1 - ratio.low)})"
        if choice.pays is not None and choice.pays.kind in ("at once", "after"):
            words += f", and pays {choice.pays.written}"
        if decision.alike:
            words += f"; no difference to {listed(decision.alike)} is shown"
        return words
    if decision.ground == "keep":
        return f"{take}: every other triangulator is shown to draw slower"
    if decision.ground == "counted":
        words = f"{take}: it has the least by exact count, {_counted(decision)}"
        return words + (f"; {_times(decision)}" if decision.timed else "")
    if decision.ground == "alone":
        return f"{scene} was triangulated by {choice.name} alone, so there is nothing to compare"
    if decision.ground == "part":
        most, whole = choice.record.polygons, choice.record.all_polygons
        return (
            f"nothing is advised for {scene}: each triangulator left polygons out, "
            f"{choice.name} the fewest ({most:,} of {whole:,} are drawn)"
        )
    if decision.ground == "few":
        covered = choice.record.counters[COVERED]
        pixels = f"{covered:,} pixel{'s' * (covered != 1)}"
        return f"nothing is advised for {scene}: it covers {pixels}, too few to tell"
    if decision.timed and decision.group.state != QUIET:
        return f"{take}: no other costs less by exact count; {_times(decision)}"
    counted = ", and none costs less by exact count" if choice.record.counters else ""
    return f"{take}: no other is shown to be faster{counted}"


def _times(decision: Decision) -> str:
    """Say why times decided nothing."""
    state = decision.group.state
    if state != QUIET:
        return f"its times are {state} and show nothing, so measure again when nothing else runs"
    if any(each.verdict == FASTER for each in decision.standings if each.complete):
        return "times show none to be faster, the best of so many taken as such"
    return "times show none to be faster"


def _counted(decision: Decision) -> str:
    measure, choice, base = decision.measure, decision.choice, decision.base
    assert measure is not None
    count = choice.record.counters[measure]
    words = f"{count:,} {find_metric(measure).label}"
    usual = base.record.counters.get(measure)
    drawn = {each.record.polygons for each in (choice, base)}
    if base is choice or not usual or len(drawn) > 1:
        return words
    return f"{words}, {_share(1 - count / usual)} fewer than {base.name}"


def _share(value: float, unit: str = " %") -> str:
    return f"{100 * value:.1f}{unit}"


def listed(names: Sequence[str]) -> str:
    """Return names as a sentence has them: a, b and c."""
    if len(names) == 1:
        return names[0]
    return f"{', '.join(names[:-1])} and {names[-1]}"
