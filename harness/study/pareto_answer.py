"""What a study of the Pareto front says: a table for the terminal, and sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import pandas as pd
from rich.console import Console

from harness.figures.groups import groups
from harness.figures.ratios import FASTER, SLOWER
from harness.pictures.style import plain_table
from harness.stored.folder import Record
from harness.study.pareto import SAME, WHOLE, WITH_C, WITHOUT_C, MeasuredFront

CORNERS = "front"
"""Kind of the points that are judged; `sweep` in a row about a whole scene."""


def subjects(table: pd.DataFrame) -> Iterator[tuple[tuple[str, str, str], pd.DataFrame]]:
    """Yield (polygon, rasteriser, device) and the rows that belong together."""
    for key, part in table.groupby(["polygon", "rasteriser", "device"], sort=False):
        polygon, rasteriser, device = (str(name) for name in key)
        yield (polygon, rasteriser, device), part


def points(part: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a subject's front, or of its sweep, ascending in A, the base first."""
    kind = CORNERS if (part["kind"] == CORNERS).any() else "sweep"
    chosen = part[(part["kind"] == kind) & (part["gamma"].fillna(0) == 0)]
    return chosen.sort_values("overdraw_over_area", kind="stable")


def others(rows: pd.DataFrame) -> pd.DataFrame:
    """Return what was timed against the least-A end and is not that triangulation."""
    return rows[~rows["same_as_end"]].dropna(subset=["time_ratio"])


def print_table(table: pd.DataFrame, scene: str, console: Console) -> None:
    """Print a row for each polygon, rasteriser and device."""
    title = f"{scene}: time in ratio to the least-A end of the front of A and D"
    headings = ("polygon", "rasteriser", ">points", ">slower", ">faster", ">best", "fastest of all")
    shown = plain_table(title, *headings, padding=(0, 1, 0, 0))
    for (polygon, rasteriser, _), part in subjects(table):
        rows = others(points(part))
        verdicts = rows["verdict"].value_counts()
        every = others(part).sort_values("time_ratio").head(1)
        fastest = [f"{r.time_ratio:.3f} {r.triangulator}" for r in every.itertuples()]
        shown.add_row(
            polygon,
            rasteriser,
            str(len(rows) + 1),
            *(str(verdicts.get(name, 0)) for name in (SLOWER, FASTER)),
            "-" if rows.empty else f"{rows['time_ratio'].min():.3f}",
            *(fastest or ["-"]),
        )
    console.print(shown)


def sentences(table: pd.DataFrame) -> list[str]:
    """Say for each rasteriser and device which part of the front is measurably faster."""
    said = []
    for (rasteriser, device), part in table.groupby(["rasteriser", "device"], sort=False):
        for whole in (False, True):
            subjects_ = [rows for _, rows in subjects(part[(part["polygon"] == WHOLE) == whole])]
            if subjects_:
                said.append(f"{rasteriser} on {device}, {_about(subjects_, whole=whole)}")
        said += [f"{rasteriser} on {device}, {noise}" for noise in _noise(part)]
    return said


def _about(subjects_: list[pd.DataFrame], *, whole: bool) -> str:
    """Say how the points of all subjects of one sort compare with their least-A ends."""
    if whole:
        where, noun = "whole scene", ("step of the sweep", "steps of the sweep")
    else:
        where = _count(len(subjects_), "polygon", "polygons")
        noun = ("point of the front", "points of the fronts")
    notes = []
    single = sum(others(points(rows)).empty for rows in subjects_)
    if single:
        of_them = "" if len(subjects_) == 1 else f" on {single} of them"
        notes.append(f"A and D agree{of_them}, so that the front is one point")
    compared = pd.concat([_with_distance(rows) for rows in subjects_])
    if len(compared):
        notes.append(_verdicts(compared, noun))
    notes += _beating(subjects_)
    return f"{where}: {'; '.join(notes)}."


def _with_distance(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a subject's compared points with `more`: how much greater A is than at the end."""
    front = points(rows)
    least = float(front["overdraw"].iloc[0])
    found = others(front)
    return found.assign(more=found["overdraw"] / least - 1)


def _verdicts(compared: pd.DataFrame, noun: tuple[str, str]) -> str:
    faster = compared[compared["verdict"] == FASTER]
    slower = compared[compared["verdict"] == SLOWER]
    rest = len(compared) - len(faster) - len(slower)
    some = f"{len(faster)} {'is' if len(faster) == 1 else 'are'}"
    text = f"of {_count(len(compared), *noun)}, {some} measurably faster than the least-A end"
    if len(faster):
        text += f" (with {_percent(faster['more'].min(), faster['more'].max())} more A)"
    return f"{text}, {len(slower)} slower, {rest} {'shows' if rest == 1 else 'show'} no difference"


def _beating(subjects_: list[pd.DataFrame]) -> list[str]:
    """Name triangulators off the front that are measurably faster than the least-A end."""
    counts: Counter[str] = Counter()
    for rows in subjects_:
        off = rows[~rows["undominated"] & (rows["kind"] == "named") & ~rows["same_as_end"]]
        counts.update(off.loc[off["verdict"] == FASTER, "triangulator"].astype(str).tolist())
    of_all = f" of {len(subjects_)}" if len(subjects_) > 1 else ""
    found = [name + (f" ({n}{of_all})" if of_all else "") for name, n in counts.most_common(3)]
    return [f"off the front, but faster than the least-A end: {', '.join(found)}"] if found else []


def _noise(part: pd.DataFrame) -> list[str]:
    """Say how far from 1 the time ratios of the same triangulation under two names were."""
    named = part[part["same_as_end"] & (part["time_ratio"] != 1)]
    twins = named["time_ratio"].dropna()
    if twins.empty:
        return []
    most = 100 * float((twins - 1).abs().max())
    names = _count(len(twins), "other name", "other names")
    return [f"noise: the same triangulation under {names} took up to {most:.1f} % more or less."]


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _percent(low: float, high: float) -> str:
    ends = [f"{100 * value:.1f}" for value in (low, high)]
    return f"{ends[0]} %" if ends[0] == ends[1] else f"{ends[0]} to {ends[1]} %"


def gamma_changes(records: Sequence[Record]) -> tuple[int, int]:
    """Return in how many of how many groups the weight of C changed A or D of the optimum."""
    changed = compared = 0
    for members in groups(records):
        found = {r["triangulator"]: r["predicted"] for r in members if r["status"] == "ok"}
        if WITHOUT_C in found and WITH_C in found:
            compared += 1
            pairs = [(found[WITHOUT_C][n], found[WITH_C][n]) for n in ("overdraw", "shape")]
            changed += any(abs(a - b) > SAME * abs(a) for a, b in pairs)
    return changed, compared


def remarks(records: Sequence[Record], fronts: Mapping[str, MeasuredFront]) -> list[str]:
    """Say what a reader must know: what C does, and what was not measured or left out."""
    said = []
    changed, compared = gamma_changes(records)
    if compared and not changed:
        said.append(
            f"gamma changes nothing: {WITH_C} and {WITHOUT_C} have the same A and D, because C "
            "is the same for every triangulation of a polygon"
        )
    elif compared:
        said.append(f"gamma changed A or D of {changed} of {compared} optima, whose costs tie")
    long = [front for front in fronts.values() if len(front.chosen) < len(front.costs)]
    said += [
        f"polygon {front.polygon}: {len(front.chosen)} of the front's {len(front.costs)} points "
        "were measured, at even steps with both ends"
        for front in long
    ]
    most: dict[str, int] = {}
    for record in (record for record in records if record["status"] == "ok"):
        most[record["scene"]] = max(most.get(record["scene"], 0), record["polygons"])
    partial = [
        record["triangulator"]
        for record in records
        if record["status"] == "skipped"
        or (record["status"] == "ok" and record["polygons"] < most[record["scene"]])
    ]
    if partial:
        names = ", ".join(dict.fromkeys(partial))
        said.append(f"cannot do every polygon, and left some out: {names}")
    return said
