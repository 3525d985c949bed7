"""Recommendation of a triangulator for a group: ranking, verdicts, reason, and a sentence.

All outputs use the same `Decision`, so that none contradicts another.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from harness.metrics.break_even import BreakEven, compute_break_even
from harness.metrics.groups import RecordGroup, group_run
from harness.metrics.registry import find_metric, get_first_value, list_costs
from harness.metrics.run_quality import QUIET
from harness.metrics.statistics import FASTER, SLOWER, Ratio, Verdict
from harness.results.record import Record
from harness.results.run_folder import Run

Reason = Literal[
    "faster", "others slower", "counter", "undecided", "few pixels", "single", "incomplete"
]

TIME = "draw_ms"
COVERED = "fragments"

MIN_PIXELS = 64  # minimum for a recommendation, as small counters do not scale

MIN_SAVED_SHARE = 0.01
"""Smallest saved share of a cost that is a reason to change the triangulator, in `run` and
`inspect`. If quads were counted, the cost is the shaded lanes, of which the helper lanes of large
triangles are a negligible share."""

MIN_SHARE_OF_BEST = 0.8  # minimum share of the largest saving that a recommended triangulator saves


@dataclass(frozen=True)
class Standing:
    """A record in a ranking, with its ratio of times and break-even against the base.

    cost : sort key: time or main counter relative to the base's
    """

    record: Record
    cost: float
    complete: bool
    ratio: Ratio | None
    break_even: BreakEven | None

    @property
    def name(self) -> str:
        """Name of the triangulator."""
        return self.record.name

    @property
    def verdict(self) -> Verdict | None:
        """Verdict of the ratio, or None without a ratio."""
        return self.ratio.verdict if self.ratio else None


@dataclass(frozen=True)
class Decision:
    """A recommended triangulator, with the reason.

    standings : measured records, complete records first, sorted by cost
    reason : "faster", "others slower": the choice is significantly faster than the base, or all
        others are significantly slower than the base; "counter": times do not decide, and the
        choice saves `MIN_SAVED_SHARE` of an exact counter; "undecided": no relevant difference;
        "few pixels", "single", "incomplete": no recommendation, as too few pixels are covered,
        there is one candidate, or every triangulator skipped polygons
    choice : the base, or the triangulator with the minimum triangulation time among those that
        reach `MIN_SHARE_OF_BEST` of the largest saving
    best, measure : the triangulator with the largest saving, and the main counter if any
    timed : whether times of two or more complete triangulators are compared
    saving : the choice's ratio to the base if "faster", with a simultaneous interval over all
        candidates, because a choice among several noisy ratios is biased
    """

    group: RecordGroup
    standings: tuple[Standing, ...]
    base: Standing
    reason: Reason
    choice: Standing
    best: Standing
    measure: str | None
    timed: bool
    saving: Ratio | None = None


def decide_group(group: RecordGroup) -> Decision | None:
    """Return the recommendation for a group of records, or None if none was measured."""
    base_record = group.base
    if base_record is None:
        return None
    measure = next(iter(list_costs(base_record.counters)), None)
    all_polygons = max(record.all_polygons for record in group.measured)
    complete = [record for record in group.measured if record.polygons == all_polygons]
    compared = sum(record is not base_record for record in complete)
    standings = [
        _make_standing(record, group, base_record, all_polygons, compared)
        for record in group.measured
    ]
    standings.sort(key=lambda s: (-s.record.polygons, s.cost, s.name))
    ranked = tuple(standings)
    base = next(standing for standing in ranked if standing.record is base_record)
    rivals = [standing for standing in ranked if standing.complete]
    if not rivals and len(ranked) > 1:
        first = ranked[0]
        return Decision(group, ranked, base, "incomplete", first, first, measure, timed=False)
    rivals = rivals or standings
    reason, choice, best = _choose_triangulator(rivals, base, measure)
    saving = _get_joint_ratio(choice) if reason == "faster" else None
    timed = any(rival.ratio is not None and rival is not base for rival in rivals)
    return Decision(group, ranked, base, reason, choice, best, measure, timed, saving)


Decided = tuple[RecordGroup, Decision | None]  # the decision is None if no record was measured


def decide_run(run: Run) -> list[Decided]:
    """Return the groups of a run's records, each with the recommendation."""
    return [(group, decide_group(group)) for group in group_run(run)]


def _make_standing(
    record: Record, group: RecordGroup, base: Record, all_polygons: int, compared: int
) -> Standing:
    """Return the entry of a record in the ranking; compared : number of other complete records.

    The cost is the ratio of times if the run was quiet or counted nothing, otherwise the main
    counter or, without a ratio of times, the draw time relative to the base's. It is infinite if
    the records have no metric in common.
    """
    ratio = group.compute_ratio(record, base, compared)
    counters = list_costs(record.counters)
    if ratio is not None and (ratio.quiet or not counters):
        cost = ratio.value
    else:
        metrics = map(find_metric, [TIME, *counters] if ratio is None else counters)
        values = ((metric(record), metric(base)) for metric in metrics)
        pairs = ((v, b) for v, b in values if v is not None and b is not None)
        value, base_value = next(pairs, (math.inf, 0.0))
        cost = value / base_value if base_value else value
    complete = record.polygons == all_polygons
    return Standing(record, cost, complete, ratio, compute_break_even(record, base, ratio))


def _choose_triangulator(
    rivals: Sequence[Standing], base: Standing, measure: str | None
) -> tuple[Reason, Standing, Standing]:
    """Return the reason, the choice, and the triangulator with the largest saving."""
    # Strongest reason first: too little data, then times, then counters.
    challengers = [rival for rival in rivals if rival is not base]
    if not challengers:
        return "single", rivals[0], rivals[0]
    default = base if base in rivals else rivals[0]
    covered = default.record.counters.get(COVERED)
    if covered is not None and covered < MIN_PIXELS:
        return "few pixels", default, default
    faster = {
        rival.name: rival
        for rival in challengers
        if (ratio := _get_joint_ratio(rival)) is not None
        and rival.verdict == ratio.verdict == FASTER
    }
    if faster:
        saved = {name: 1.0 - rival.ratio.value for name, rival in faster.items() if rival.ratio}
        return "faster", *_find_recommended_and_best(faster, saved)
    if all(rival.verdict == SLOWER for rival in challengers):
        return "others slower", base, base
    candidates = [rival for rival in rivals if rival.verdict != SLOWER]
    counts = [
        (count, rival)
        for rival in candidates
        if (count := rival.record.counters.get(measure or "")) is not None
    ]
    # The base first: it is the choice if no count is lower.
    counts.sort(key=lambda pair: (pair[0], pair[1] is not base))
    if counts:
        fewest = counts[0][1]
        other = base if base in rivals and base is not fewest else counts[-1][1]
        saved = {s.name: _compute_saved_share(s.record, other.record, measure) for _, s in counts}
        if saved[fewest.name] >= MIN_SAVED_SHARE:
            better = {s.name: s for _, s in counts[: 1 if fewest is base else None]}
            return "counter", *_find_recommended_and_best(
                better, {name: saved[name] for name in better}
            )
    equal = base if base in rivals else candidates[0]
    return "undecided", equal, equal


def _get_joint_ratio(standing: Standing) -> Ratio | None:
    """Return the ratio to the base, with the simultaneous interval if computed, or None."""
    return standing.ratio and (standing.ratio.joint or standing.ratio)


def _find_recommended_and_best(
    standings: Mapping[str, Standing], saved: Mapping[str, float]
) -> tuple[Standing, Standing]:
    seconds = {name: standing.record.triangulate_s for name, standing in standings.items()}
    return standings[choose_recommended(saved, seconds)], standings[find_largest_saving(saved)]


def find_largest_saving(saved: Mapping[str, float]) -> str:
    """Return the triangulator with the largest saved share; of several, the first."""
    return max(saved, key=lambda name: saved[name])


def choose_recommended(saved: Mapping[str, float], seconds: Mapping[str, float | None]) -> str:
    """Return the fastest to triangulate of the triangulators with nearly the largest saving.

    saved, seconds : saved share of a cost, and triangulation time, by triangulator
    """
    best = find_largest_saving(saved)
    enough = [name for name, share in saved.items() if share >= MIN_SHARE_OF_BEST * saved[best]]

    def key(name: str) -> tuple[float, bool]:
        cost = seconds[name]
        return math.inf if cost is None else cost, name != best

    return min(enough, key=key)


def describe_recommended(name: str) -> str:
    """Return the name of a recommended triangulator with the reason, for sentences."""
    return f"{name}, the cheapest triangulator with most of the saving"


def _compute_saved_share(record: Record, base: Record, measure: str | None) -> float:
    """Return the share of the base's quads that `record` saves; without quads, of `measure`."""
    names = ["quads", *([measure] if measure else [])]
    count, base_count = (get_first_value(r, names) or 0.0 for r in (record, base))
    return 1.0 - count / base_count if base_count else 0.0


def format_advice(decision: Decision | None) -> str:
    """Return a sentence with the recommended triangulator of a group, and the reason."""
    if decision is None:
        return "No recommendation: no case was measured (all were skipped or failed)."
    group = decision.group.id
    condition = f"{group.scene} on {group.device_name} ({group.rasteriser}, {group.condition})"
    if decision.reason in ("single", "incomplete", "few pixels"):
        return f"No recommendation for {condition}: {_format_obstacle(decision)}."
    return f"Recommendation for {condition}: {_format_choice(decision)}."


def _format_obstacle(decision: Decision) -> str:
    record = decision.choice.record
    if decision.reason == "single":
        return f"{record.name} has no other triangulator to compare with"
    if decision.reason == "incomplete":
        drawn = f"{record.polygons:,} of {record.all_polygons:,}"
        return f"every triangulator skipped polygons ({record.name} drew the most: {drawn})"
    covered = record.counters[COVERED]
    pixels = f"{covered:,} pixel{'s' * (covered != 1)}"
    return f"the polygons cover {pixels} in all (at least {MIN_PIXELS} are needed)"


_SAVES_ENOUGH = f"saves {100 * MIN_SAVED_SHARE:g} % by exact count"


def _format_choice(decision: Decision) -> str:
    """Return the choice with the saving or the reason, as the end of a sentence."""
    choice, base, ratio = decision.choice, decision.base, decision.saving
    if ratio is not None:
        saved, low, high = (
            _format_percent(1 - end) for end in (ratio.value, ratio.high, ratio.low)
        )
        text = f"{describe_recommended(choice.name)}: {saved} % of {base.name}'s draw time "
        text += f"(95 % CI {low}-{high} %)"
        if choice.break_even is not None and choice.break_even.kind in ("at once", "after"):
            text += f", break-even {choice.break_even.text}"
        best = decision.best
        if best is not choice and best.ratio is not None:
            text += f"; {best.name} saves the most, {_format_percent(1 - best.ratio.value)} %"
        return text
    if decision.reason == "others slower":
        return f"{choice.name}; all other triangulators are significantly slower"
    if decision.reason == "counter":
        count = _format_count(decision, choice)
        if choice is base:
            text = f"{base.name} has the lowest exact count, {count}"
        else:
            text = f"{describe_recommended(choice.name)}: {count}"
        best = decision.best
        if best is not choice:
            text += f"; {best.name} has the lowest exact count, {_format_count(decision, best)}"
        return text + (f"; {_explain_times(decision)}" if decision.timed else "")
    if decision.timed and decision.group.state != QUIET:
        return f"{choice.name}; no other {_SAVES_ENOUGH}, {_explain_times(decision)}"
    counted = f", and none {_SAVES_ENOUGH}" if choice.record.counters else ""
    return f"{choice.name}; no other triangulator is significantly faster{counted}"


def _explain_times(decision: Decision) -> str:
    state = decision.group.state
    if state != QUIET:
        return f"times are {state} and not used (measure again on an idle machine)"
    if any(s.verdict == FASTER for s in decision.standings if s.complete):
        return "no time is significantly lower after correction for multiple comparisons"
    return "no time is significantly lower"


def _format_count(decision: Decision, standing: Standing) -> str:
    """Return a triangulator's main counter, and the share by which it is below the base's."""
    measure, base = decision.measure, decision.base
    assert measure is not None
    count, base_count = standing.record.counters[measure], base.record.counters.get(measure)
    text = f"{count:,} {find_metric(measure).label}"
    if base is standing or not base_count or standing.record.polygons != base.record.polygons:
        return text
    return f"{text}, {_format_percent(1 - count / base_count)} % fewer than {base.name}"


def _format_percent(share: float) -> str:
    return f"{100 * share:.1f}"


def join_names(names: Sequence[str]) -> str:
    """Return names as an enumeration: a, b and c."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
