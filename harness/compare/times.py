"""Says what times did between two runs, without blaming a triangulator for the machine.

Between two runs the machine drifts: all cases of a run become a few per cent faster or slower
together, and other programs lengthen some samples but shorten none. Three things follow.

- A time is summarised by a low quantile of its samples, which other programs hardly move.
- What all cases of a group did together (the median of their ratios) is the drift. A case is
  judged by what it did beyond that of its peers, and their scatter about the drift says how far
  two runs of the same code lie apart: the interval is widened by it.
- The drift itself is judged as a case of its own, beside the reference draw, a triangle that no
  change of a triangulator touches: only what that does not explain can be a regression of all.

docs/ci/README.md has the measurements behind this. The tests are Mann & Whitney's (1947), corrected
for many cases by Benjamini & Hochberg (1995), with a percentile bootstrap of the ratio; `unchanged`
is shown, as in an equivalence test, by an interval inside the threshold.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from harness.compare.model import Against, Drift, Outcome, TimeChange
from harness.compare.settings import Settings
from harness.stored.folder import Record

QUANTILE = 0.1
"""Of the samples: low enough to be clear of other programs, not as fickle as the fastest one."""

MIN_ROUNDS = 8
"""Fewer samples than this in either run say nothing."""

MIN_STEADY = 2
"""Peers that drew the same in both runs, by their counters; where there are fewer, all serve."""

MIN_PEERS = 3
"""With fewer peers their median is no drift; the reference draw stands in for them."""

BETWEEN_RUNS = 0.0075
"""Least standard deviation of a case's log ratio between two runs of the same code."""

DRIFT_RUNS = 0.015
"""The same for the drift, after the reference draw is taken out."""

RESAMPLES = 2000

Samples = NDArray[np.float64]


@dataclass(frozen=True)
class Pair:
    """The times of one case: seconds of one draw in each round of BASE and of HEAD, (r,) each.

    reference : the same for the reference draw of the same rounds, None where a run has none
    same_work : the counters of both runs are equal, so the same was drawn
    """

    base: Samples
    head: Samples
    reference: tuple[Samples, Samples] | None
    same_work: bool

    @property
    def log_ratio(self) -> float:
        """Log of HEAD's time over BASE's."""
        return _log_ratio(self.base, self.head)

    @property
    def reference_log_ratio(self) -> float | None:
        """The same of the reference draw, None where there is none."""
        return None if self.reference is None else _log_ratio(*self.reference)


def read_pair(base: Record, head: Record, *, same_work: bool) -> Pair | TimeChange | None:
    """Return the times of a case, why they cannot be compared, or None if neither run has any."""
    before, after = base.get("time") or {}, head.get("time") or {}
    if not before and not after:
        return None
    first, second = _samples(before, "samples_s"), _samples(after, "samples_s")
    reason = ""
    if not len(first) or not len(second):
        reason = f"{'HEAD' if len(first) else 'BASE'} was not timed"
    elif before.get("timer") != after.get("timer"):
        reason = f"timed by {before.get('timer')} clock in BASE, by {after.get('timer')} in HEAD"
    elif min(len(first), len(second)) < MIN_ROUNDS:
        reason = f"{len(first)} and {len(second)} samples are too few"
    if reason:
        return _undecided(first, second, reason)
    references = _samples(before, "reference_s"), _samples(after, "reference_s")
    return Pair(first, second, references if all(map(len, references)) else None, same_work)


def judge_group(
    where: str, pairs: Sequence[Pair], settings: Settings, *, machines_differ: bool
) -> tuple[list[TimeChange], Drift]:
    """Judge cases that were timed together in both runs, and what they did together.

    q-values are still to be corrected, for which the cases of all groups are needed.
    """
    ratios = np.array([pair.log_ratio for pair in pairs])
    margins = np.array([_margins(pair.base, pair.head, settings.confidence) for pair in pairs])
    drift = _drift(where, pairs, margins, settings, machines_differ)
    same = np.array([pair.same_work for pair in pairs])
    changes = []
    for number, pair in enumerate(pairs):
        others = np.arange(len(pairs)) != number
        steady = others & same
        peers = ratios[steady if steady.sum() >= MIN_STEADY else others]
        enough = steady.sum() >= MIN_STEADY or len(peers) >= MIN_PEERS
        if settings.normalise == "auto" and enough:
            changes.append(_against_peers(pair, margins[number], peers, settings))
        else:
            changes.append(_against_reference(pair, margins[number], settings, machines_differ))
    return changes, drift


def correct(changes: Sequence[TimeChange], settings: Settings) -> list[TimeChange]:
    """Correct for the number of cases: a difference must stand out among all of them."""
    p_values = [change.q_value for change in changes if change.q_value is not None]
    if not p_values:
        return list(changes)
    corrected = iter(stats.false_discovery_control(p_values, method="bh").tolist())
    return [
        change if change.q_value is None else _settle(change, next(corrected), settings)
        for change in changes
    ]


def _settle(change: TimeChange, q_value: float, settings: Settings) -> TimeChange:
    decided = change.outcome in ("regressed", "improved")
    if decided and q_value > 1 - settings.confidence:
        reason = f"may be chance among so many cases (q = {q_value:.2f})"
        return replace(change, q_value=q_value, outcome="inconclusive", reason=reason)
    return replace(change, q_value=q_value)


def _against_peers(pair: Pair, margins: Samples, peers: Samples, settings: Settings) -> TimeChange:
    """Judge what a case did beyond the median of its `peers`' log ratios, (k,)."""
    drift = float(np.median(peers))
    scatter = max(BETWEEN_RUNS, float(stats.median_abs_deviation(peers, scale="normal")))
    # The variance of a median of k normal values is pi/2 of their mean's.
    deviation = scatter * math.sqrt(1 + math.pi / (2 * len(peers)))
    return _judge(pair, margins, (drift, drift), deviation, settings, "peers")


def _against_reference(
    pair: Pair, margins: Samples, settings: Settings, machines_differ: bool
) -> TimeChange:
    """Judge a case without peers: by its time and by its time over the reference draw's.

    The drift lies between none and the reference's; on other machines only the latter will do.
    """
    reference = pair.reference_log_ratio
    if reference is None or settings.normalise == "none":
        if machines_differ:
            return _undecided(pair.base, pair.head, "the machines differ: no reference draw")
        return _judge(pair, margins, (0.0, 0.0), DRIFT_RUNS, settings, "none")
    drifts = (reference, reference) if machines_differ else (0.0, reference)
    return _judge(pair, margins, drifts, DRIFT_RUNS, settings, "reference")


def _judge(
    pair: Pair,
    margins: Samples,
    drifts: tuple[float, float],
    deviation: float,
    settings: Settings,
    against: Against,
) -> TimeChange:
    """Judge a case whose log ratio is known to `margins`, (2,) below and above.

    Its drift lies between `drifts`, with standard deviation `deviation`.
    """
    raw = pair.log_ratio
    margin = _normal(settings.confidence) * deviation
    least, most = raw - max(drifts), raw - min(drifts)
    middle = raw - sum(drifts) / 2
    low = least - math.hypot(margins[0], margin)
    high = most + math.hypot(margins[1], margin)
    outcome, reason = decide(least, most, low, high, settings.time_threshold)
    faster = _faster_half(pair.base), _faster_half(pair.head * math.exp(middle - raw))
    p_value = float(stats.mannwhitneyu(*faster, alternative="two-sided").pvalue)
    # A difference needs both the test and the interval, so the weaker of the two is corrected.
    q_value = max(p_value, _p_of_interval(least, most, low, high, settings.confidence))
    return TimeChange(
        outcome=outcome,
        reason=reason,
        ratio=math.exp(middle),
        low=math.exp(low),
        high=math.exp(high),
        raw_ratio=math.exp(raw),
        against=against,
        p_value=p_value,
        q_value=q_value,
        base_median_s=float(np.median(pair.base)),
        head_median_s=float(np.median(pair.head)),
        base_rounds=len(pair.base),
        head_rounds=len(pair.head),
    )


def _faster_half(samples: Samples) -> Samples:
    """Return the samples up to their median: the slower half tells of other programs."""
    return np.sort(samples)[: (len(samples) + 1) // 2]


def decide(
    least: float, most: float, low: float, high: float, threshold: float
) -> tuple[Outcome, str]:
    """Return the outcome for a log ratio in `least`..`most` with interval `low`..`high`.

    A growth is shown only if it exceeds the threshold and its interval excludes 1; no growth is
    shown only if the interval is inside the threshold. All else is inconclusive, with the reason.
    """
    bound = math.log1p(threshold)
    if least > bound and low > 0:
        return "regressed", ""
    if most < -bound and high < 0:
        return "improved", ""
    if -bound <= low and high <= bound:
        return "unchanged", ""
    found = f"{math.expm1(low) * 100:+.1f} % to {math.expm1(high) * 100:+.1f} %"
    return "inconclusive", f"somewhere in {found}, the threshold is ±{threshold * 100:g} %"


def _drift(
    where: str,
    pairs: Sequence[Pair],
    margins: Samples,
    settings: Settings,
    machines_differ: bool,
) -> Drift:
    """Judge the median of a group's log ratios beside the log ratio of the reference draw.

    What is the machine's lies between nothing and the reference draw's ratio. Of other machines
    nothing can be said: there the drift is the machine.
    """
    ratios = [pair.log_ratio for pair in pairs]
    shift = float(np.median(ratios))
    references = [pair.reference for pair in pairs if pair.reference is not None]
    reference, known = None, 0.0
    if references:
        reference = float(_log_ratio(*references[0]))
        known = float(_margins(*references[0], settings.confidence).max())
    # The variance of a median of k normal values is pi/2 of their mean's.
    sampling = float(np.median(margins)) * math.sqrt(math.pi / (2 * len(pairs)))
    margin = math.hypot(_normal(settings.confidence) * DRIFT_RUNS, sampling, known)
    explained = (0.0, reference or 0.0)
    least, most = shift - max(explained), shift - min(explained)
    low, high = least - margin, most + margin
    outcome, reason = decide(least, most, low, high, settings.time_threshold)
    if machines_differ:
        outcome, reason = "inconclusive", "the machines differ"
    return Drift(
        where=where,
        cases=len(ratios),
        outcome=outcome,
        reason=reason,
        ratio=math.exp(shift),
        low=math.exp(low),
        high=math.exp(high),
        reference=None if reference is None else math.exp(reference),
        gated=settings.normalise == "auto" and len(ratios) > MIN_STEADY,
    )


def _margins(base: Samples, head: Samples, confidence: float) -> Samples:
    """Return how far below and above the log ratio its percentile bootstrap interval reaches.

    (2,); the same at every call.
    """
    result = stats.bootstrap(
        (base, head),
        _log_ratio,
        n_resamples=RESAMPLES,
        confidence_level=confidence,
        method="percentile",
        vectorized=True,
        rng=np.random.default_rng(zlib.crc32(base.tobytes() + head.tobytes())),
    )
    ratio, interval = _log_ratio(base, head), result.confidence_interval
    return np.maximum(0.0, [ratio - interval.low, interval.high - ratio])


def _normal(confidence: float) -> float:
    """Return how many standard deviations a two-sided interval reaches."""
    return float(stats.norm.ppf(0.5 + confidence / 2))


def _p_of_interval(least: float, most: float, low: float, high: float, confidence: float) -> float:
    """Return the two-sided p-value that an interval of normal width gives against no change."""
    nearest, reach = (least, least - low) if least > 0 else (-most, high - most)
    if nearest <= 0:
        return 1.0
    return 2 * float(stats.norm.sf(_normal(confidence) * nearest / reach)) if reach > 0 else 0.0


def _log_ratio(base: Samples, head: Samples, axis: int = -1) -> Any:
    top, bottom = np.quantile(head, QUANTILE, axis=axis), np.quantile(base, QUANTILE, axis=axis)
    return np.log(top / bottom)


def low_quantile(samples_s: Sequence[Any]) -> float | None:
    """Return the low quantile of a record's samples in seconds, None where there are none."""
    samples = _positive(samples_s)
    return float(np.quantile(samples, QUANTILE)) if len(samples) else None


def _samples(time: dict[str, Any], name: str) -> Samples:
    return _positive(time.get(name) or [])


def _positive(values: Sequence[Any]) -> Samples:
    """Return (n,) samples; what is no positive number is left out."""
    numbers = np.array([v for v in values if isinstance(v, int | float)], np.float64)
    return numbers[np.isfinite(numbers) & (numbers > 0)]


def _undecided(base: Samples, head: Samples, reason: str) -> TimeChange:
    return TimeChange(
        outcome="inconclusive",
        reason=reason,
        base_median_s=float(np.median(base)) if len(base) else None,
        head_median_s=float(np.median(head)) if len(head) else None,
        base_rounds=len(base),
        head_rounds=len(head),
    )
