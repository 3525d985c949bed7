"""Counts the cases of a group on their device, each checked against the baseline's coverage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.frame import Frame
from harness.measuring import records
from harness.measuring.plan import Case
from harness.measuring.preparing import BASELINE, Prepared
from harness.measuring.processes import Backend, Bench
from harness.progress import Reporter
from harness.rasterisers.base import Counters, Options
from harness.stored.folder import Record
from harness.triangulating.frames import Prediction
from harness.triangulating.recipes import Recipe

Columns = Mapping[str, NDArray[Any]]
"""Figures of each polygon, (p,) each."""


@dataclass(frozen=True)
class Counted:
    """A case was counted, and is to be timed; `record` is the finished one but for its time."""

    record: Record
    columns: Columns | None


@dataclass(frozen=True)
class Finished:
    """A case was measured, skipped or failed; `columns` only where no `Counted` had them."""

    record: Record
    columns: Columns | None = None


def count_cases(
    cases: Mapping[Recipe, Case],
    backend: Backend,
    options: Options,
    frame: Frame,
    prepared: Mapping[Recipe, Prepared],
    bench: Bench,
    reporter: Reporter,
) -> Iterator[tuple[Recipe, Counted | Finished]]:
    """Yield each case as soon as it is counted, or the record of one that failed.

    The baseline is counted first, whether or not it is a case: it says what each polygon covers.
    """
    if not cases:
        return
    coverage = None
    centres = BASELINE in prepared and options.samples == 1  # whose limits are known
    limits = prepared[BASELINE].limits if centres else {}
    names = [recipe for recipe in dict.fromkeys([BASELINE, *cases]) if recipe in prepared]
    with reporter.stage(f"counting: {backend.label}", len(names)) as stage:
        for recipe in names:
            ready = prepared[recipe]
            try:
                counters = bench.count(backend, frame, ready.triangles, options)
            except HarnessError as error:
                if recipe in cases:
                    yield recipe, Finished(records.problem(cases[recipe], "failed", str(error)))
            else:
                if recipe == BASELINE:
                    coverage = _coverage(counters, ready)
                if recipe in cases:
                    made = (frame, ready.triangulation, counters, coverage, limits)
                    record = records.measured(cases[recipe], *made)
                    columns = _columns(frame, ready.triangulation.predicted, counters, limits)
                    yield recipe, Counted(record, columns)
            stage.advance()


def _coverage(counters: Counters, baseline: Prepared) -> records.Coverage | None:
    """Return what the baseline drew of each polygon, None where the device cannot say."""
    fragments = counters.get("fragments")
    if fragments is None or not fragments.ndim:
        return None
    return records.Coverage(fragments, records.drawn_polygons(baseline.triangulation.parts))


def _columns(
    frame: Frame,
    prediction: Prediction,
    counters: Counters,
    limits: Mapping[str, NDArray[np.int64]],
) -> Columns | None:
    """Return what is predicted and counted of each polygon; one polygon's are the totals."""
    if len(frame.source) == 1:
        return None
    predicted = {f"predicted_{name}": column for name, column in prediction.columns.items()}
    return predicted | {n: column for n, column in counters.items() if column.ndim} | dict(limits)
