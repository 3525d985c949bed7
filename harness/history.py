"""Plot each metric of each case over many runs, and detect changes of the metric.

An exact metric changes at each run whose value differs from that of the run before. The values of a
noisy metric are cut into segments of constant level by the pruned exact linear time search of
Killick, Fearnhead & Eckley (2012). The search minimises the sum of absolute deviations from the
segments' medians, so that a single run on a busy machine is not a change. Changes of the
log level by less than `MIN_STEP` are then removed, the smallest first.
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

from harness.compare.matching import compute_low_quantile
from harness.errors import InputError, UsageError, make_unknown_name_error
from harness.machine.git import get_commit
from harness.metrics.groups import mark_processors
from harness.metrics.registry import find_metric, find_metrics, list_metrics
from harness.metrics.run_quality import get_run_state
from harness.results.record import CaseGroup, CaseId, Record
from harness.results.run_folder import Run, find_folder, read_facts, read_run, select_latest
from harness.settings import HISTORY_METRICS
from harness.style import COLOURS, MARKERS, add_legend_below, draw_figure, make_figure
from scenes.spec import format_install_command

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TIME = "time"  # a draw time relative to other runs', and to the group's other triangulators'
GROUP_NAME = "(all cases together)"  # names the time changes that a group's cases have in common
CACHED_METRIC = "triangulate_ms"  # no value for cached triangulations, which an older run timed


@dataclass(frozen=True)
class Series:
    """A metric of a case over runs.

    values : (runs,) float64, nan for a run without the case; times are relative to the median
    content : (runs,) content hash of the scene, or "" if unknown; times of a software device also
        have the processor's name
    """

    id: CaseId
    metric: str
    exact: bool  # without noise, as counters are
    values: NDArray[np.float64]
    content: tuple[str, ...]

    @cached_property
    def changes(self) -> tuple[int, ...]:
        """Index of the first run after each change of the metric while the content is the same."""
        # The triangulation that a model has takes 0 s, whose logarithm is infinite.
        usable = np.isfinite(self.values) & (self.exact | (self.values > 0))
        runs = np.flatnonzero(usable)
        cuts = [
            n for n, (a, b) in enumerate(pairwise(runs), 1) if self.content[a] != self.content[b]
        ]
        changes: list[int] = []
        for segment in np.split(runs, cuts):
            values = self.values[segment]
            indices = (
                find_exact_changes(values) if self.exact else find_noisy_changes(np.log(values))
            )
            changes += segment[indices].tolist()
        return tuple(changes)

    @property
    def steps(self) -> list[tuple[float, float]]:
        """Median values before and after each change."""
        cuts = [0, *self.changes, len(self.values)]
        return list(pairwise(float(np.nanmedian(self.values[a:b])) for a, b in pairwise(cuts)))


def find_runs(folders: Sequence[Path], *, studies: bool = False) -> tuple[list[Run], int]:
    """Return the runs in and below `folders`, by creation, and the number of skipped studies.

    Below `folders`, baselines of `--beside` and, without `studies`, studies are skipped.
    """
    paths: dict[Path, Path] = {}
    for folder in folders:
        files = sorted(file.parent for file in folder.rglob("run.json")) if folder.is_dir() else []
        if not files and not folder.is_file():
            raise InputError(f"{folder} has no run; give a run, or a folder of runs")
        for path in files or [folder]:
            paths.setdefault(find_folder(path).resolve(), path)
    named = {find_folder(path).resolve() for path in folders}
    runs, skipped = [], 0
    for resolved, path in paths.items():
        facts = read_facts(path, [])
        study = ((facts.get("environment") or {}).get("command") or [])[1:2] == ["study"]
        is_base = (facts.get("beside") or {}).get("is_base")
        if resolved not in named and (is_base or (study and not studies)):
            skipped += study
            continue
        runs.append(select_latest(read_run(path)))
    runs.sort(key=lambda run: (str(run.facts.get("created") or ""), str(run.path)))
    return runs, skipped


def read_series(runs: Sequence[Run], metrics: Sequence[str] = HISTORY_METRICS) -> list[Series]:
    """Return a series for each case and each metric that any run has."""
    metrics_by_name = list_metrics() | find_metrics(
        record for run in runs for record in run.records
    )
    for metric in metrics:
        if metric != TIME and metric not in metrics_by_name:
            raise make_unknown_name_error("metric", metric, [TIME, *metrics_by_name])
    cases = _group_by_case(runs)
    series = []
    for metric in metrics:
        if metric == TIME:
            quiet = [r if get_run_state(r).is_quiet else replace(r, records=[]) for r in runs]
            # The processor of a software device is part of the content.
            series += _build_time_series(_group_by_case(mark_processors(quiet, _add_processor)))
        else:
            series += [_build_series(name, metric, records) for name, records in cases.items()]
    return [entry for entry in series if np.isfinite(entry.values).any()]


def _add_processor(case: CaseId, processor: str) -> CaseId:
    return replace(case, scene_hash=f"{case.scene_hash} on {processor}")


def _group_by_case(runs: Sequence[Run]) -> dict[CaseId, list[Record | None]]:
    """Return the record of each case in each run, or None for a run without the case."""
    cases: dict[CaseId, list[Record | None]] = defaultdict(lambda: [None] * len(runs))
    for number, run in enumerate(runs):
        for record in run.records:
            if record.is_ok:
                cases[record.id][number] = record
    return dict(cases)


def _build_series(case: CaseId, metric: str, records: Sequence[Record | None]) -> Series:
    if metric == CACHED_METRIC:
        records = [None if record and record.polygons_cached else record for record in records]
    figures = [find_metric(metric)(record) if record else None for record in records]
    values = np.array([np.nan if value is None else value for value in figures], np.float64)
    return Series(case, metric, find_metric(metric).exact, values, _list_contents(records))


def _build_time_series(cases: dict[CaseId, list[Record | None]]) -> list[Series]:
    """Return the series of each group's common change and of each case relative to that change.

    As in a comparison, the common change is separated: the machine causes it as often as the code.
    """
    groups: dict[CaseGroup, list[CaseId]] = defaultdict(list)
    for name in cases:
        groups[name.group].append(name)
    series = []
    for names in groups.values():
        logs = pd.DataFrame({name: list(map(_log_time, cases[name])) for name in names})
        logs = logs.dropna(axis=1, how="all")
        logs -= logs.median()
        timed = [name for name in names if name in logs]
        if len(timed) > 1:
            together = logs.median(axis=1)
            group_case = replace(names[0], triangulator=GROUP_NAME, number=None, upright=False)
            rows = zip(*(cases[name] for name in timed), strict=True)
            contents = _list_contents([next(filter(None, row), None) for row in rows])
            series.append(Series(group_case, TIME, False, np.exp(together.to_numpy()), contents))
            logs = logs.sub(together, axis=0)
        series += [
            Series(name, TIME, False, np.exp(logs[name].to_numpy()), _list_contents(cases[name]))
            for name in timed
        ]
    return series


def _log_time(record: Record | None) -> float:
    seconds = compute_low_quantile(record.time.samples_s) if record and record.time else None
    return np.nan if seconds is None else float(np.log(seconds))


def _list_contents(records: Sequence[Record | None]) -> tuple[str, ...]:
    return tuple(record.id.scene_hash if record else "" for record in records)


MAX_SERIES = 12  # shown by default


def filter_series(series: Sequence[Series], names: Mapping[str, Sequence[str]]) -> list[Series]:
    """Return the series that have a selected name of each kind ("scene", "triangulator", ...)."""
    selected = list(series)
    for kind, values in names.items():
        attribute = "name" if kind == "triangulator" else kind  # of a case
        existing = {getattr(entry.id, attribute) for entry in selected}
        for value in values:
            if value not in existing:
                raise make_unknown_name_error(kind, value, existing)
        selected = [entry for entry in selected if getattr(entry.id, attribute) in values]
    return selected


def select_series(series: Sequence[Series]) -> list[Series]:
    """Return the `MAX_SERIES` series with the largest steps, of those with two values or more."""
    several = [entry for entry in series if np.isfinite(entry.values).sum() > 1]
    selected = set(map(id, sorted(several, key=_get_preference)[:MAX_SERIES]))
    return [entry for entry in series if id(entry) in selected]


def _get_preference(entry: Series) -> tuple[float, bool, float]:
    is_group = entry.id.name == GROUP_NAME
    steps = [0.0 if is_group else _measure_step(*levels) for levels in entry.steps]
    return -max(steps, default=0.0), is_group, -np.isfinite(entry.values).sum()


def _measure_step(before: float, after: float) -> float:
    if before == after:
        return 0.0
    return abs(math.log(after / before)) if before > 0 and after > 0 else math.inf


MIN_SEGMENT_RUNS = 3  # one or two outliers are noise, not a change
PENALTY = 3.0  # of a change, in mean deviations times log(runs); outliers require more than 1
MIN_NOISE = 0.0075  # lower bound of the estimated mean deviation of log times
MIN_STEP = 0.03  # difference between the log values before and after a change


def find_exact_changes(values: NDArray[np.float64]) -> list[int]:
    """Return the indices of (n,) values that differ from the value before."""
    return (np.flatnonzero(np.diff(values)) + 1).tolist()


def find_noisy_changes(logs: NDArray[np.float64]) -> list[int]:
    """Return the indices at which the level of (n,) log values changes."""
    if len(logs) < 2 * MIN_SEGMENT_RUNS:
        return []
    try:
        import ruptures
    except ImportError:
        raise UsageError(
            f"ruptures, which detects changes: not installed; {format_install_command('history')}"
        ) from None
    noise = max(MIN_NOISE, _estimate_noise(logs))
    search = ruptures.Pelt(model="l1", min_size=MIN_SEGMENT_RUNS, jump=1).fit(logs[:, None])
    ends: list[int] = search.predict(pen=PENALTY * noise * math.log(len(logs)))
    return _remove_small_steps(logs, [int(end) for end in ends[:-1]])


def _remove_small_steps(logs: NDArray[np.float64], cuts: list[int]) -> list[int]:
    """Remove the change (cut) of the smallest step until all steps are at least `MIN_STEP`."""
    while cuts:
        levels = [float(np.median(part)) for part in np.split(logs, cuts)]
        steps = np.abs(np.diff(levels))
        if steps.min() >= MIN_STEP:
            break
        cuts = [cut for number, cut in enumerate(cuts) if number != int(steps.argmin())]
    return cuts


def _estimate_noise(logs: NDArray[np.float64]) -> float:
    """Return the mean absolute deviation from the level, estimated from successive differences.

    A change of level affects only one difference. For normal noise of standard deviation s the
    median absolute difference is 0.954 s, and the mean absolute deviation is 0.798 s.
    """
    return float(0.798 / 0.954 * np.median(np.abs(np.diff(logs))))


MAX_LABELS = 12  # along the axis


def plot_history(runs: Sequence[Run], series: Sequence[Series], folder: Path) -> list[Path]:
    """Draw a figure of each metric as PNG and SVG in `folder`; return the files."""
    files = []
    for metric in dict.fromkeys(entry.metric for entry in series):
        entries = [entry for entry in series if entry.metric == metric]
        files += draw_figure(folder, metric, draw_metric, runs, entries)
    return files


def draw_metric(runs: Sequence[Run], series: Sequence[Series]) -> Figure:
    """Draw one metric: rings and dashed lines mark changes, black lines changes of the scene."""
    groups = list(dict.fromkeys(entry.id.group for entry in series))
    names = list(dict.fromkeys(entry.id.name for entry in series))
    metric = series[0].metric
    quantity = find_metric(metric)
    label = "time, relative" if metric == TIME else f"{quantity.title}, {quantity.unit}"
    figure, panels = make_figure((7.0, 0.8 + 2.4 * len(groups)), len(groups), sharex=True)
    for panel, group in zip(panels, groups, strict=True):
        for entry in series:
            if entry.id.group == group:
                _draw_series(panel, entry, names.index(entry.id.name))
        _mark_content_changes(panel, next(entry for entry in series if entry.id.group == group))
        panel.set_title(str(group), fontsize=8, loc="left")
        panel.set_ylabel(label)
    ticks = range(0, len(runs), max(1, -(-len(runs) // MAX_LABELS)))
    panels[-1].set_xticks(
        list(ticks), [format_run_label(runs[tick]) for tick in ticks], rotation=30
    )
    panels[-1].tick_params(axis="x", labelsize=6)
    add_legend_below(figure, panels, columns=3)
    return figure


def _draw_series(panel: Axes, entry: Series, number: int) -> None:
    is_group = entry.id.name == GROUP_NAME
    colour = "#999999" if is_group else COLOURS[number % (len(COLOURS) - 1)]
    runs = np.arange(len(entry.values))
    style = (":" if is_group else "-") + MARKERS[number % len(MARKERS)]
    label = entry.id.name
    panel.plot(runs, entry.values, style, color=colour, markersize=3, linewidth=1, label=label)
    for run in entry.changes:
        ring: Any = {"markersize": 9, "markerfacecolor": "none", "markeredgewidth": 1.5}
        panel.plot(run, entry.values[run], "o", markeredgecolor=colour, **ring)
        panel.axvline(run - 0.5, color=colour, linewidth=0.8, linestyle="--")


def _mark_content_changes(panel: Axes, entry: Series) -> None:
    contents = [(run, content) for run, content in enumerate(entry.content) if content]
    for (_, before), (run, after) in pairwise(contents):
        if before != after:
            panel.axvline(run - 0.5, color="black", linewidth=1.2, label="content changed")


def format_run_label(run: Run) -> str:
    """Return a run's commit if known, otherwise its folder's name, and its date."""
    name = get_commit(run.facts)[:8] or run.path.name
    day = str(run.facts.get("created") or "")[:10]
    return f"{name}\n{day}" if day else name
