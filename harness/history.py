"""Plot each metric of each case over many runs, and detect its changes.

An exact figure changes wherever it differs from the run before. A noisy one is cut into stretches
of constant median by the pruned exact linear time search of Killick, Fearnhead & Eckley (2012);
absolute deviations are its cost, so that a run on a busy machine is no change. Steps too small to
act on are then left out, the smallest first.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.compare.times import low_quantile
from harness.errors import InputError, UsageError, unknown
from harness.machine.git import commit_of
from harness.metrics.processors import mark_processors
from harness.metrics.registry import find_metric, find_metrics, list_metrics
from harness.results.record import CaseGroup, CaseId, Record
from harness.results.run_folder import Run, read_facts, read_run, select_latest
from harness.settings import HISTORY_METRICS
from harness.stats.run_quality import state_of
from harness.style import COLOURS, MARKERS, draw, grid, legend_below
from scenes.spec import format_install_command

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TIME = "time"
"""The one metric of a history that is no record's own: a time beside those of its peers."""

TOGETHER = "(all cases together)"
"""Stands in place of a triangulator for what all cases of a group did."""

MEASURED_ONCE = "triangulate_ms"
"""A cached triangulation keeps the time that an earlier run measured: no run's own, so no point."""


@dataclass(frozen=True)
class Series:
    """A metric of a case over runs.

    values : (runs,) float64, nan where a run lacks it; for `time` relative to the median run
    content : (runs,) the scene's content hash, "" where unknown; of times with the processor, where
        that is the device
    """

    id: CaseId
    metric: str
    exact: bool
    values: NDArray[np.float64]
    content: tuple[str, ...]

    @cached_property
    def changes(self) -> tuple[int, ...]:
        """Positions of the first run after each change; a change of content is none."""
        known = np.flatnonzero(np.isfinite(self.values))
        cuts = [
            n for n, (a, b) in enumerate(pairwise(known), 1) if self.content[a] != self.content[b]
        ]
        found: list[int] = []
        for stretch in np.split(known, cuts):
            part = self.values[stretch]
            places = changes_of_exact(part) if self.exact else changes_of_noisy(np.log(part))
            found += stretch[places].tolist()
        return tuple(found)

    @property
    def steps(self) -> list[tuple[float, float]]:
        """The levels, which are medians, before and after each change."""
        cuts = [0, *self.changes, len(self.values)]
        return list(pairwise(float(np.nanmedian(self.values[a:b])) for a, b in pairwise(cuts)))


def find_runs(folders: Sequence[Path], *, studies: bool = False) -> tuple[list[Run], int]:
    """Read the runs in `folders` and below them, in the order they were made.

    Returns them, and how many studies were left out.

    studies : read them, too, but for those that another run was measured beside, which are older
        states of the code; a folder that is named is always read

    Raises
    ------
    InputError
        if there is none, or one cannot be read
    """
    paths = {}
    for folder in folders:
        found = sorted(file.parent for file in folder.rglob("run.json")) if folder.is_dir() else []
        if not found and not folder.is_file():
            raise InputError(f"{folder} holds no run; give folders of runs, or one of many")
        for path in found or [folder]:
            paths[path.resolve()] = path
    named = {folder.resolve() for folder in folders}
    kept, left = [], 0
    for place, path in paths.items():
        facts = read_facts(path, [])
        study = ((facts.get("environment") or {}).get("command") or [])[1:2] == ["study"]
        older = (facts.get("beside") or {}).get("is_base")
        if place not in named and (older or (study and not studies)):
            left += study
            continue
        kept.append(select_latest(read_run(path)))
    kept.sort(key=lambda run: (str(run.facts.get("created") or ""), str(run.path)))
    return kept, left


def read_series(runs: Sequence[Run], metrics: Sequence[str] = HISTORY_METRICS) -> list[Series]:
    """Return a series for each case and each of `metrics` that any run has.

    Raises
    ------
    UsageError
        if a metric is unknown
    """
    known = list_metrics() | find_metrics(record for run in runs for record in run.records)
    for metric in metrics:
        if metric != TIME and metric not in known:
            raise unknown("metric", metric, [TIME, *known])
    cases = _cases(runs)
    found = []
    for metric in metrics:
        if metric == TIME:
            quiet = [run if state_of(run).is_quiet else replace(run, records=[]) for run in runs]
            # Where the processor is the device, it is part of the content.
            found += _times(_cases(mark_processors(quiet, _mark_content)))
        else:
            found += [_series(name, metric, records) for name, records in cases.items()]
    return [series for series in found if np.isfinite(series.values).any()]


def _mark_content(case: CaseId, processor: str) -> CaseId:
    """Return the case with the processor as a part of its content."""
    return replace(case, scene_hash=f"{case.scene_hash} on {processor}")


def _cases(runs: Sequence[Run]) -> dict[CaseId, list[Record | None]]:
    """Return each case's measured record in every run, None where there is none."""
    cases: dict[CaseId, list[Record | None]] = defaultdict(lambda: [None] * len(runs))
    for number, run in enumerate(runs):
        for record in run.records:
            if record.is_ok:
                cases[record.id][number] = record
    return dict(cases)


def _series(case: CaseId, metric: str, records: Sequence[Record | None]) -> Series:
    if metric == MEASURED_ONCE:
        records = [None if record and record.polygons_cached else record for record in records]
    figures = [find_metric(metric)(record) if record else None for record in records]
    values = np.array([np.nan if value is None else value for value in figures], np.float64)
    return Series(case, metric, find_metric(metric).exact, values, _contents(records))


def _times(cases: dict[CaseId, list[Record | None]]) -> list[Series]:
    """Return each case's time beside those of its peers, and what all of a group did together.

    As in a comparison, what the cases of a group do together is taken out: it is the machine's
    as often as the code's.
    """
    groups: dict[CaseGroup, list[CaseId]] = defaultdict(list)
    for name in cases:
        groups[name.group].append(name)
    found = []
    for names in groups.values():
        logs = pd.DataFrame({name: list(map(_log_time, cases[name])) for name in names})
        logs = logs.dropna(axis=1, how="all")
        logs -= logs.median()
        kept = [name for name in names if name in logs]
        if len(kept) > 1:
            together = logs.median(axis=1)
            whole = replace(names[0], triangulator=TOGETHER, number=None, upright=False)
            contents = _contents(cases[kept[0]])
            found.append(Series(whole, TIME, False, np.exp(together.to_numpy()), contents))
            logs = logs.sub(together, axis=0)
        found += [
            Series(name, TIME, False, np.exp(logs[name].to_numpy()), _contents(cases[name]))
            for name in kept
        ]
    return found


def _log_time(record: Record | None) -> float:
    seconds = low_quantile(record.time.samples_s) if record and record.time else None
    return np.nan if seconds is None else float(np.log(seconds))


def _contents(records: Sequence[Record | None]) -> tuple[str, ...]:
    return tuple(record.id.scene_hash if record else "" for record in records)


MOST = 12
"""Series that are shown unless all are asked for: as many as one can follow."""


def matching(series: Sequence[Series], wanted: Mapping[str, Sequence[str]]) -> list[Series]:
    """Return the series of the scenes, triangulators and rasterisers that were asked for.

    wanted : names by "scene", "triangulator" and "rasteriser"

    Raises
    ------
    UsageError
        if no run has what was asked for
    """
    left = list(series)
    for kind, names in wanted.items():
        known = {_name_of(entry.id, kind) for entry in left}
        for name in names:
            if name not in known:
                raise unknown(kind, name, known)
        left = [entry for entry in left if _name_of(entry.id, kind) in names]
    return left


def _name_of(case: CaseId, kind: str) -> str:
    names = {"scene": case.scene, "triangulator": case.name, "rasteriser": case.rasteriser}
    return names[kind]


def worth_showing(series: Sequence[Series]) -> list[Series]:
    """Return what changed most, then what most runs have, at most `MOST`.

    What only one run has, has no history.
    """
    several = [entry for entry in series if np.isfinite(entry.values).sum() > 1]
    first = sorted(several, key=_interest)[:MOST]
    return [entry for entry in series if any(entry is each for each in first)]


def _interest(entry: Series) -> tuple[float, bool, float]:
    """Return a sort key: the largest step as an absolute log ratio, inf from or to 0, first."""
    together = entry.id.name == TOGETHER
    steps = [0.0 if together else _step(*levels) for levels in entry.steps]
    return -max(steps, default=0.0), together, -np.isfinite(entry.values).sum()


def _step(before: float, after: float) -> float:
    if before == after:
        return 0.0
    return abs(math.log(after / before)) if before > 0 and after > 0 else math.inf


SHORTEST = 3
"""Runs in a stretch: one or two odd runs are noise, and the last ones are for `compare`."""

PENALTY = 3.0
"""Times mean deviation times log n, a change; outliers make more than the textbook's 1 needed."""

LEAST_NOISE = 0.0075
"""Mean deviation of a log time between runs of the same code, at the least."""

LEAST_STEP = 0.03
"""Least step of a log time that is a change."""


def changes_of_exact(values: NDArray[np.float64]) -> list[int]:
    """Return the positions at which (n,) values differ from the ones before."""
    return (np.flatnonzero(np.diff(values)) + 1).tolist()


def changes_of_noisy(logs: NDArray[np.float64]) -> list[int]:
    """Return the positions at which the level of (n,) log values changes."""
    if len(logs) < 2 * SHORTEST:
        return []
    try:
        import ruptures
    except ImportError:
        raise UsageError(
            f"where times change is found by ruptures: {format_install_command('history')}"
        ) from None
    noise = max(LEAST_NOISE, _noise(logs))
    search = ruptures.Pelt(model="l1", min_size=SHORTEST, jump=1).fit(logs[:, None])
    ends: list[int] = search.predict(pen=PENALTY * noise * math.log(len(logs)))
    return _worthwhile(logs, [int(end) for end in ends[:-1]])


def _worthwhile(logs: NDArray[np.float64], cuts: list[int]) -> list[int]:
    """Drop the cut with the smallest step until all steps are worth a mark."""
    while cuts:
        levels = [float(np.median(part)) for part in np.split(logs, cuts)]
        steps = np.abs(np.diff(levels))
        if steps.min() >= LEAST_STEP:
            break
        cuts = [cut for number, cut in enumerate(cuts) if number != int(steps.argmin())]
    return cuts


def _noise(logs: NDArray[np.float64]) -> float:
    """Return the mean deviation from the level, from the median size of differences.

    Differences of neighbours hardly see a change of level. For normal noise of deviation s their
    median size is 0.954 s, and the mean deviation is 0.798 s.
    """
    return float(0.798 / 0.954 * np.median(np.abs(np.diff(logs))))


LABELS = 12
"""Most runs that are named along the axis."""


def plot_history(runs: Sequence[Run], series: Sequence[Series], folder: Path) -> list[Path]:
    """Draw each metric into `folder` as PNG and SVG; returns the files written."""
    files = []
    for metric in dict.fromkeys(entry.metric for entry in series):
        chosen = [entry for entry in series if entry.metric == metric]
        files += draw(folder, metric, metric_figure, runs, chosen)
    return files


def metric_figure(runs: Sequence[Run], series: Sequence[Series]) -> Figure:
    """Draw the series of one metric, changes marked by a ring and the content's by a line."""
    groups = list(dict.fromkeys(entry.id.group for entry in series))
    names = list(dict.fromkeys(entry.id.name for entry in series))
    of = series[0].metric
    label = "time, relative" if of == TIME else f"{find_metric(of).title}, {find_metric(of).unit}"
    figure, panels = grid((7.0, 0.8 + 2.4 * len(groups)), len(groups), sharex=True)
    for panel, group in zip(panels, groups, strict=True):
        for entry in series:
            if entry.id.group == group:
                _line(panel, entry, names.index(entry.id.name))
        _content(panel, next(entry for entry in series if entry.id.group == group))
        panel.set_title(str(group), fontsize=8, loc="left")
        panel.set_ylabel(label)
    places = range(0, len(runs), max(1, -(-len(runs) // LABELS)))
    panels[-1].set_xticks(list(places), [run_label(runs[place]) for place in places], rotation=30)
    panels[-1].tick_params(axis="x", labelsize=6)
    legend_below(figure, panels, columns=3)
    return figure


def _line(panel: Axes, entry: Series, number: int) -> None:
    together = entry.id.name == TOGETHER
    colour = "#999999" if together else COLOURS[number % (len(COLOURS) - 1)]
    places = np.arange(len(entry.values))
    style = (":" if together else "-") + MARKERS[number % len(MARKERS)]
    label = entry.id.name
    panel.plot(places, entry.values, style, color=colour, markersize=3, linewidth=1, label=label)
    for place in entry.changes:
        ring: Any = {"markersize": 9, "markerfacecolor": "none", "markeredgewidth": 1.5}
        panel.plot(place, entry.values[place], "o", markeredgecolor=colour, **ring)
        panel.axvline(place - 0.5, color=colour, linewidth=0.8, linestyle="--")


def _content(panel: Axes, entry: Series) -> None:
    """Mark where the scene's content changed, so that no one takes it for a change of code."""
    known = [(n, text) for n, text in enumerate(entry.content) if text]
    for (_, before), (place, now) in pairwise(known):
        if before != now:
            panel.axvline(place - 0.5, color="black", linewidth=1.2, label="content changed")


def run_label(run: Run) -> str:
    """Return a run's commit if known, else the name of its folder, and its day."""
    name = commit_of(run.facts)[:8] or run.path.name
    day = str(run.facts.get("created") or "")[:10]
    return f"{name}\n{day}" if day else name
