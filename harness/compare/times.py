"""Says what times did between two runs, without blaming a triangulator for the machine.

Between two runs the machine drifts: all cases of a run become a few per cent faster or slower
together, and other programs lengthen some samples but shorten none. Three things follow.

- A time is summarised by a low quantile of its samples, which other programs hardly move.
- What all cases of a group did together (the median of their ratios) is the drift. A case is
  judged by what it did beyond that of its peers, and their scatter about the drift says how far
  two runs of the same code lie apart: the interval is widened by it.
- The drift itself is told and never gated: it is the machine's as often as the code's.

None of it is needed where both were timed in the same rounds. Whatever the machine did in a round,
it did to both, so each round's ratio tells the code alone, and what all cases did together is a
finding like any other.

docs/how-to/ci.md has the measurements behind this. Of runs made apart the test is Mann & Whitney's
(1947), with a percentile bootstrap of the ratio; of the same rounds it is a sign test, with
Student's interval. Both are corrected for many cases by Benjamini & Hochberg (1995); `unchanged` is
shown, as in an equivalence test, by an interval inside the threshold.
"""

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from harness.compare.model import Against, Drift, Outcome, Settings, TimeChange
from harness.results.record import CaseGroup, Record, Time
from harness.stats import run_quality
from harness.stats.intervals import paired_ratio
from harness.stats.run_quality import ENOUGH, select_rounds

QUANTILE = 0.1
"""Of the samples: low enough to be clear of other programs, not as fickle as the fastest one."""

RESAMPLES = 2000

Q_VALUE = 1e-3
"""An alarm by rounds needs this much evidence: one in a thousand such findings may be chance."""

Samples = NDArray[np.float64]

Parts = tuple[Sequence[int] | None, Sequence[int] | None]
"""Rounds of each epoch, and of each process."""

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


@dataclass(frozen=True)
class Pair:
    """The times of one case: seconds of one draw in each round of BASE and of HEAD, (r,) each.

    reference : the same for the reference draw of the same rounds, None where a run has none
    same_work : the counters of both runs are equal, so the same was drawn
    same_rounds : both were timed in the same rounds
    parts : rounds of each of their epochs, and of each process, where there were any
    kept : (r,) of the same rounds, those that a ratio rests on; None: all
    unlike : why the machine's states in the two runs, made apart, cannot be compared; "" if they
        can
    """

    base: Samples
    head: Samples
    reference: tuple[Samples, Samples] | None
    same_work: bool
    same_rounds: bool = False
    parts: Parts = (None, None)
    kept: NDArray[np.bool_] | None = None
    unlike: str = ""

    @cached_property
    def log_ratio(self) -> float:
        """Log of HEAD's time over BASE's."""
        return log_ratio(self.base, self.head)


def read_pair(
    base: Record, head: Record, *, same_work: bool, machines_differ: bool = False
) -> Pair | TimeChange | None:
    """Return the times of a case, why they cannot be compared, or None if neither run has any."""
    if base.time is None and head.time is None:
        return None
    before, after = base.time or Time(), head.time or Time()
    first, second = (positive(time.samples_s) for time in (before, after))
    reason = ""
    if not len(first) or not len(second):
        reason = f"{'HEAD' if len(first) else 'BASE'} was not timed"
    elif before.timer != after.timer:
        reason = f"timed by {before.timer} clock in BASE, by {after.timer} in HEAD"
    elif min(len(first), len(second)) < MIN_ROUNDS:
        reason = f"{len(first)} and {len(second)} samples are too few"
    if reason:
        return _undecided(first, second, reason)
    references = (positive(before.reference_s), positive(after.reference_s))
    if not all(map(len, references)):
        return Pair(first, second, None, same_work)
    # A sample that was left out would move those after it to other rounds.
    complete = len(first) == len(before.samples_s) and len(second) == len(after.samples_s)
    same_rounds = complete and before.is_paired_with(after)
    parts: Parts = (after.epochs or None, after.processes or None) if same_rounds else (None, None)
    kept = select_rounds(before, after) if same_rounds else None
    unlike = ""
    if not same_rounds:
        unlike = run_quality.explain_apart(before, after, machines_differ=machines_differ)
    return Pair(first, second, references, same_work, same_rounds, parts, kept, unlike)


def judge_group(
    group: CaseGroup, pairs: Sequence[Pair], settings: Settings, *, machines_differ: bool
) -> tuple[list[TimeChange], Drift]:
    """Judge cases that were timed together in both runs, and what they did together.

    q-values are still to be corrected, for which the cases of all groups are needed.
    """
    if all(pair.same_rounds for pair in pairs):
        changes = [
            judge_rounds(pair.base, pair.head, settings, pair.parts, pair.kept) for pair in pairs
        ]
        together = [(pair.base, pair.head) for pair in pairs]
        every = [pair.kept for pair in pairs if pair.kept is not None]
        kept = np.all(every, axis=0) if every else None
        if kept is not None and kept.sum() < ENOUGH:
            kept = None
        return changes, drift_of_rounds(group, together, settings, pairs[0].parts, kept)
    known = np.array([margins(pair.base, pair.head, settings.confidence) for pair in pairs])
    changes = []
    for number, pair in enumerate(pairs):
        part = None if pair.unlike else _machines_part(pairs, number, settings, machines_differ)
        if part is None:
            reason = pair.unlike or "the machines differ: no reference draw"
            changes.append(_undecided(pair.base, pair.head, reason))
        else:
            changes.append(_judge(pair, known[number], *part, settings))
    return changes, _drift(group, pairs, known, settings, machines_differ)


def _machines_part(
    pairs: Sequence[Pair], number: int, settings: Settings, machines_differ: bool
) -> tuple[tuple[float, float], float, Against] | None:
    """Return between which log ratios the machine's part in one of the pairs lies.

    Then its standard deviation, and what tells it; None where nothing does. It is the median of the
    peers' log ratios. Without peers it lies between none and the reference draw's; of other
    machines only the latter will do.
    """
    pair, others = pairs[number], [*pairs[:number], *pairs[number + 1 :]]
    steady = [each for each in others if each.same_work]
    enough = len(steady) >= MIN_STEADY
    peers = np.array([each.log_ratio for each in (steady if enough else others)])
    if settings.normalise == "auto" and (enough or len(peers) >= MIN_PEERS):
        scatter = max(BETWEEN_RUNS, float(stats.median_abs_deviation(peers, scale="normal")))
        # The variance of a median of k normal values is pi/2 of their mean's.
        deviation = scatter * math.sqrt(1 + math.pi / (2 * len(peers)))
        return (float(np.median(peers)),) * 2, deviation, "peers"
    if pair.reference is None or settings.normalise == "none":
        return None if machines_differ else ((0.0, 0.0), DRIFT_RUNS, "none")
    reference = log_ratio(*pair.reference)
    return (reference if machines_differ else 0.0, reference), DRIFT_RUNS, "reference"


def correct(changes: Sequence[TimeChange], settings: Settings) -> list[TimeChange]:
    """Correct for the number of cases: a difference must stand out among all of them."""
    p_values = [change.q_value for change in changes if change.q_value is not None]
    if not p_values:
        return list(changes)
    corrected = iter(stats.false_discovery_control(p_values, method="bh").tolist())
    settled = []
    for change in changes:
        if change.q_value is not None:
            change = replace(change, q_value=(q_value := next(corrected)))
            allowed = Q_VALUE if change.against == "rounds" else 1 - settings.confidence
            if change.outcome in ("regressed", "improved") and q_value > allowed:
                reason = f"may be chance among so many cases (q = {q_value:.2g})"
                change = replace(change, outcome="inconclusive", reason=reason)
        settled.append(change)
    return settled


def _judge(
    pair: Pair,
    known: Samples,
    drifts: tuple[float, float],
    deviation: float,
    against: Against,
    settings: Settings,
) -> TimeChange:
    """Judge a case whose log ratio is known to `known`, (2,) below and above.

    Its drift lies between `drifts`, with standard deviation `deviation`.
    """
    raw = pair.log_ratio
    margin = _normal(settings.confidence) * deviation
    least, most = raw - max(drifts), raw - min(drifts)
    middle = raw - sum(drifts) / 2
    low = least - math.hypot(known[0], margin)
    high = most + math.hypot(known[1], margin)
    threshold = settings.time_threshold_of(paired=False)
    outcome, reason = decide(least, most, low, high, threshold)
    faster = _faster_half(pair.base), _faster_half(pair.head * math.exp(middle - raw))
    p_value = float(stats.mannwhitneyu(*faster, alternative="two-sided").pvalue)
    # A difference needs both the test and the interval, so the weaker of the two is corrected.
    q_value = max(p_value, _p_of_interval(least, most, low, high, settings.confidence))
    ends = (math.exp(middle), math.exp(low), math.exp(high), math.exp(raw))
    medians = in_short(pair.base, pair.head)
    return TimeChange(
        outcome, reason, *ends, against, threshold, p_value=p_value, q_value=q_value, **medians
    )


def _faster_half(samples: Samples) -> Samples:
    """Return the samples up to their median: the slower half tells of other programs."""
    return np.sort(samples)[: (len(samples) + 1) // 2]


def _drift(
    group: CaseGroup,
    pairs: Sequence[Pair],
    known: Samples,
    settings: Settings,
    machines_differ: bool,
) -> Drift:
    """Say what the median of a group's log ratios did beside that of the reference draw.

    It is never gated: runs made at different times cannot tell slower code from a slower machine,
    which slows the reference draw, one large triangle, in another measure than a thousand small
    ones. What is the machine's lies at least between nothing and the reference draw's ratio.
    """
    shift = float(np.median([pair.log_ratio for pair in pairs]))
    references = [pair.reference for pair in pairs if pair.reference is not None]
    reference, own = None, 0.0
    if references:
        reference = log_ratio(*references[0])
        own = float(margins(*references[0], settings.confidence).max())
    # The variance of a median of k normal values is pi/2 of their mean's.
    sampling = float(np.median(known)) * math.sqrt(math.pi / (2 * len(pairs)))
    margin = math.hypot(_normal(settings.confidence) * DRIFT_RUNS, sampling, own)
    explained = (0.0, reference or 0.0)
    least, most = shift - max(explained), shift - min(explained)
    low, high = least - margin, most + margin
    outcome, reason = decide(least, most, low, high, settings.time_threshold_of(paired=False))
    if machines_differ:
        outcome, reason = "inconclusive", "the machines differ"
    ends = (math.exp(shift), math.exp(low), math.exp(high))
    whole = None if reference is None else math.exp(reference)
    return Drift(group, len(pairs), outcome, reason, *ends, reference=whole, gated=False)


def _normal(confidence: float) -> float:
    """Return how many standard deviations a two-sided interval reaches."""
    return float(stats.norm.ppf(0.5 + confidence / 2))


def _p_of_interval(least: float, most: float, low: float, high: float, confidence: float) -> float:
    """Return the two-sided p-value that an interval of normal width gives against no change."""
    nearest, reach = (least, least - low) if least > 0 else (-most, high - most)
    if nearest <= 0:
        return 1.0
    return 2 * float(stats.norm.sf(_normal(confidence) * nearest / reach)) if reach > 0 else 0.0


def _undecided(base: Samples, head: Samples, reason: str) -> TimeChange:
    return TimeChange("inconclusive", reason, **in_short(base, head))


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


def judge_rounds(
    base: Samples,
    head: Samples,
    settings: Settings,
    parts: Parts = (None, None),
    kept: NDArray[np.bool_] | None = None,
) -> TimeChange:
    """Judge one case by its rounds' ratios; element r of both is of round r.

    parts : rounds of each epoch and of each process, in order, where the run had any
    kept : (r,) the rounds that count: what the machine did to a pair, it did to both, unless one of
        them waited for a core. The q-value is still to be corrected for the number of cases.
    """
    ratio = paired_ratio(head, base, *parts, kept)
    if kept is not None:
        base, head = base[kept], head[kept]
    threshold = settings.time_threshold_of(paired=True)
    value, low, high = (math.log(x) for x in (ratio.value, ratio.low, ratio.high))
    outcome, reason = decide(value, value, low, high, threshold)
    p_value = sign_test(np.log(head / base))
    return TimeChange(
        *(outcome, reason, ratio.value, ratio.low, ratio.high, ratio.value, "rounds", threshold),
        p_value=p_value,
        q_value=p_value,
        **in_short(base, head),
    )


def in_short(base: Samples, head: Samples) -> dict[str, Any]:
    """Return medians and numbers of rounds, as `TimeChange` has them; None for those of none."""
    both = {"base": base, "head": head}
    medians = {f"{k}_median_s": float(np.median(v)) if len(v) else None for k, v in both.items()}
    return medians | {f"{name}_rounds": len(samples) for name, samples in both.items()}


def drift_of_rounds(
    group: CaseGroup,
    pairs: Sequence[tuple[Samples, Samples]],
    settings: Settings,
    parts: Parts = (None, None),
    kept: NDArray[np.bool_] | None = None,
) -> Drift:
    """Judge what all cases of a group did together: the median case of each round."""
    ratios = np.exp(np.median([np.log(head / base) for base, head in pairs], axis=0))
    change = judge_rounds(np.ones(len(ratios)), ratios, settings, parts, kept)
    outcome, reason = change.outcome, change.reason
    if outcome in ("regressed", "improved") and (change.q_value or 0.0) > Q_VALUE:
        outcome, reason = "inconclusive", "too few rounds"
    value, low, high = (float(end or math.nan) for end in (change.ratio, change.low, change.high))
    return Drift(group, len(pairs), outcome, reason, value, low, high, reference=1.0, gated=True)


def sign_test(logs: Samples) -> float:
    """Return the two-sided p-value of as many rounds being slower if either were as likely."""
    slower, faster = int((logs > 0).sum()), int((logs < 0).sum())
    if slower + faster == 0:
        return 1.0
    return float(stats.binomtest(slower, slower + faster).pvalue)


def positive(values: Sequence[Any]) -> Samples:
    """Return (n,) samples; what is no positive number is left out."""
    numbers = np.array([v for v in values if isinstance(v, int | float)], np.float64)
    return numbers[np.isfinite(numbers) & (numbers > 0)]


def low_quantile(samples_s: Sequence[Any]) -> float | None:
    """Return the low quantile of a record's samples in seconds, None where there are none."""
    samples = positive(samples_s)
    return float(np.quantile(samples, QUANTILE)) if len(samples) else None


def log_ratio(base: Samples, head: Samples) -> float:
    """Return the log of HEAD's low quantile over BASE's."""
    return float(np.log(np.quantile(head, QUANTILE) / np.quantile(base, QUANTILE)))


def margins(base: Samples, head: Samples, confidence: float) -> Samples:
    """Return how far below and above `log_ratio` its percentile bootstrap interval reaches.

    (2,); the same at every call.
    """
    rng = np.random.default_rng(zlib.crc32(base.tobytes() + head.tobytes()))
    ratios = np.log(_resampled(head, rng) / _resampled(base, rng))
    low, high = np.quantile(ratios, [(1 - confidence) / 2, (1 + confidence) / 2])
    ratio = log_ratio(base, head)
    return np.maximum(0.0, [ratio - low, high - ratio])


def _resampled(samples: Samples, rng: np.random.Generator) -> Samples:
    """Return (RESAMPLES,) low quantiles of samples drawn from `samples` with replacement.

    No sample is drawn: the k-th smallest of n uniform numbers has the distribution Beta(k, n+1-k),
    and above it the next is the smallest of n-k. Where they fall among the sorted samples is what
    drawing n of them would have given, so a hundred thousand samples cost as little as thirty.
    """
    n = len(samples)
    place = QUANTILE * (n - 1)  # numpy's: between the order statistics k and k + 1
    k = int(place) + 1
    lower = rng.beta(k, n + 1 - k, RESAMPLES)
    upper = 1 - (1 - lower) * rng.random(RESAMPLES) ** (1 / (n - k))
    below, above = np.sort(samples)[np.minimum((n * np.array([lower, upper])).astype(int), n - 1)]
    share = place - int(place)
    found: Samples = (1 - share) * below + share * above
    return found
