"""The answer of a report, in one sentence: what was cheapest to draw, and what predicted it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from harness.figures.groups import base_of, time_ratio
from harness.figures.ratios import SLOWER, UNDECIDED, Ratio
from harness.figures.registry import find, measures, predictions
from harness.stored.folder import Record
from harness.study.analysis import TIME
from harness.study.analysis import column as column_of
from harness.study.statistics import Estimate

Correlations = Mapping[str, Mapping[str, float | None]]
"""measure -> criterion -> rank correlation of ratios."""


def answer(
    members: Sequence[Record],
    measure: str | None,
    correlations: Correlations,
    within: Mapping[str, Estimate] | None = None,
) -> str:
    """Return one sentence about the records of a group.

    measure : the group's main counter, None if nothing was counted a polygon
    within : criterion -> rank correlation with it within single polygons, where that is known
    """
    good = [record for record in members if record["status"] == "ok"]
    if not good:
        return "Nothing was measured: every case was skipped or failed."
    most = max(record["polygons"] for record in good)
    whole = [record for record in good if record["polygons"] == most]
    first = whole[0]
    place = (
        f"On {first['device']} ({first['rasteriser']}, {first['resolution']} px), "
        f"{first['scene']} is "
    )
    predicted = _within(measure, within) if within else _predicted(measure, correlations)
    cost = _by_time(whole) or _by_counter(whole, measure) or _alone(first)
    return f"{place}{cost}{predicted}."


def answer_of_study(matrices: Sequence[Mapping[str, Any]]) -> str | None:
    """Return one sentence about a study's first matrix, None where it has no figure to name.

    Helper lanes come first, then bounding-box tests, then whatever was measured.
    """
    if not matrices:
        return None
    matrix = matrices[0]
    columns = [column["measure"] for column in matrix["columns"]]
    wanted = [*measures(name for name in columns if not name.startswith(TIME)), *columns]
    place = columns.index(wanted[0])
    known = {
        row["title"]: cells[place]
        for row, cells in zip(matrix["rows"], matrix["cells"], strict=True)
        if column_of(row["name"]) in predictions() and cells[place] and cells[place][0] is not None
    }
    if not known:
        return None
    best = max(known, key=lambda title: known[title][0])
    value, low, high = known[best]
    interval = "" if low is None else f", 95 % interval {low:.2f} to {high:.2f}"
    column = matrix["columns"][place]
    where = f"{column['rasteriser']} on {column['device']}"
    words = f"{best} predicts the {column['title']} of {where} best "
    words += f"({matrix['title']} {value:.2f}{interval})"
    paper = find("overdraw").title
    if best != paper and paper in known:
        words += f"; {paper} reaches {known[paper][0]:.2f}"
    return f"{words[0].upper()}{words[1:]}."


def _by_time(records: Sequence[Record]) -> str | None:
    timed = [record for record in records if find("draw_ms")(record) is not None]
    if len(timed) < 2:
        return None
    base = base_of(timed)
    # In the order of the ranking below it: paired ratios, where there are any.
    ratios = [time_ratio(record, base) for record in timed]
    if all(ratios):
        order = [ratio.value for ratio in ratios if ratio]
    else:
        order = [find("draw_ms")(record) or 0.0 for record in timed]
    ranked = [timed[place] for place in sorted(range(len(timed)), key=order.__getitem__)]
    leader = ranked[0]
    equals = [r["triangulator"] for r in ranked[1:] if not _is_slower(time_ratio(r, leader))]
    beside = ""
    if equals:
        beside = f" (no difference shown to {_listed(equals)})"
    ratio = time_ratio(leader, base)
    name = "" if base is None else base["triangulator"]
    if base is leader:
        return f"drawn fastest when triangulated by {name}{beside}"
    if ratio is None:
        return f"drawn fastest when triangulated by {leader['triangulator']}{beside}"
    if ratio.verdict == UNDECIDED:
        return f"drawn as fast by {leader['triangulator']} as by {name}: no difference is shown"
    return (
        f"drawn fastest when triangulated by {leader['triangulator']}{beside}: "
        f"in {ratio.value:.3f} of {name}'s time (95 % interval {ratio.low:.3f} to {ratio.high:.3f})"
    )


def _is_slower(ratio: Ratio | None) -> bool:
    return ratio is not None and ratio.verdict == SLOWER


def _by_counter(records: Sequence[Record], measure: str | None) -> str | None:
    counted = [record for record in records if measure in (record.get("counters") or {})]
    if measure is None or len(counted) < 2:
        return None
    best = min(counted, key=lambda record: record["counters"][measure])
    base = base_of(counted)
    words = f"cheapest when triangulated by {best['triangulator']}: "
    words += f"{best['counters'][measure]:,} {find(measure).label}"
    if base is not None and base is not best:
        share = best["counters"][measure] / base["counters"][measure]
        words += f", {share:.3f} of {base['triangulator']}'s"
    return words


def _alone(record: Record) -> str:
    return f"triangulated by {record['triangulator']} alone, so there is nothing to compare it with"


def _predicted(measure: str | None, correlations: Correlations) -> str:
    known = {
        name: value
        for name, value in correlations.get(measure or "", {}).items()
        if value is not None and name in predictions()
    }
    if not known:
        return ""
    best = max(known, key=lambda name: known[name])
    words = f"; of the criteria, {find(best).title} predicts {find(measure or '').label} best "
    words += f"(rank correlation {known[best]:.2f}"
    if best != "overdraw" and "overdraw" in known:
        words += f"; {find('overdraw').title} {known['overdraw']:.2f}"
    return f"{words})"


def _within(measure: str | None, within: Mapping[str, Estimate]) -> str:
    """Say which criterion to use: the one that ranks the triangulations of a polygon best."""
    best = max(within, key=lambda name: within[name].value)
    first = within[best]
    words = f"; within a polygon, {find(best).title} predicts {find(measure or '').label} best "
    interval = "" if math.isnan(first.low) else f", {first.low:.2f} to {first.high:.2f}"
    words += f"(rank correlation {first.value:.2f}{interval}, over {first.polygons} polygons"
    if best != "overdraw" and "overdraw" in within:
        words += f"; {find('overdraw').title} {within['overdraw'].value:.2f}"
    return f"{words})"


def _listed(names: Sequence[str]) -> str:
    if len(names) == 1:
        return names[0]
    return f"{', '.join(names[:-1])} and {names[-1]}"
