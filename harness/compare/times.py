"""Classify the change of times between two runs, separating the triangulator from the machine.

Between two runs the machine drifts: all cases of a run become a few per cent faster or slower
together, and other programs lengthen some samples but shorten none. Three rules follow.

- A time is summarised by a low quantile of the samples, which other programs hardly affect.
- The drift is the median log ratio of a group's cases. A case is compared with its peers: cases of
  the group that drew the same polygons. Even with equal code the ratios of peers scatter, because
  memory layout differs between processes; the interval includes this scatter.
- The drift is reported and never gated: the machine causes drift as often as the code.

These rules are unnecessary if both versions were timed in the same rounds. A round's disturbance
affects both versions, so each round's ratio depends on the code alone, and the common change of all
cases is gated like the change of one case.

docs/how-to/ci.md has the rules. Separate runs are tested by Mann & Whitney (1947) and by the
interval; versions of the same rounds by a sign test, with Student's interval. Both are corrected
for many cases by Benjamini & Hochberg (1995). As in an equivalence test, a time is `unchanged` only
if the interval lies inside the threshold.
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

from harness.compare.machine_shift import (
    MIN_PEERS,
    MachineShift,
    estimate_peer_shift,
    get_two_sided_quantile,
)
from harness.compare.model import Drift, Outcome, Settings, TimeChange
from harness.results.record import CaseGroup, Record, Time
from harness.stats import run_quality
from harness.stats.intervals import compute_paired_ratio
from harness.stats.run_quality import MIN_QUIET_ROUNDS, select_rounds

QUANTILE = 0.1
"""Quantile of the samples that represents a case's time: low enough to exclude samples that other
programs lengthened, steadier than the minimum."""

RESAMPLES = 2000  # of the bootstrap, for an interval

MAX_ROUNDS_Q = 1e-3
"""Maximum q-value of a change in common rounds: 1 in 1,000 reported changes may be chance."""

Samples = NDArray[np.float64]

Parts = tuple[Sequence[int] | None, Sequence[int] | None]
"""Number of rounds in each epoch, and in each process; None if unknown."""

MIN_ROUNDS = 8
"""Minimum number of samples of a case that both runs must have."""

MIN_STEADY_PEERS = 2
"""Minimum number of peers with equal counters in both runs; with fewer, all peers are used."""

DRIFT_SD = 0.015
"""Standard deviation of log ratios of equal code about the reference draw's log ratio."""


@dataclass(frozen=True)
class Pair:
    """Times of one case in both runs: seconds of one draw in each round, (r,) each.

    reference : times of the reference draw in the same rounds, or None if a run has none
    same_work : True if all counters are equal in both runs
    polygons : number of polygons drawn, equal in both runs; 0 if unknown
    same_rounds : True if both versions were timed in the same rounds
    same_drawing : True if both versions have the same triangles, which were timed once
    parts : number of common rounds in each epoch and in each process
    quiet : (r,) True for the common rounds that the ratio uses, or None for all
    obstacle : why the machine's state during the two separate runs forbids a comparison, or ""
    """

    base: Samples
    head: Samples
    reference: tuple[Samples, Samples] | None
    same_work: bool
    polygons: int = 0
    same_rounds: bool = False
    same_drawing: bool = False
    parts: Parts = (None, None)
    quiet: NDArray[np.bool_] | None = None
    obstacle: str = ""

    @cached_property
    def log_ratio(self) -> float:
        """Log of HEAD's time over BASE's."""
        return compute_log_ratio(self.base, self.head)


def read_pair(
    base: Record, head: Record, *, same_work: bool, machines_differ: bool = False
) -> Pair | TimeChange | None:
    """Return a case's times in both runs, or None if neither run timed the case.

    Times that cannot be compared give an inconclusive change, with the reason.
    """
    if base.time is None and head.time is None:
        return None
    before, after = base.time or Time(), head.time or Time()
    first, second = (select_positive(time.samples_s) for time in (before, after))
    reason = ""
    if not len(first) or not len(second):
        reason = f"{'HEAD' if len(first) else 'BASE'} was not timed"
    elif before.timer != after.timer:
        reason = f"timed by {before.timer} clock in BASE, by {after.timer} in HEAD"
    elif min(len(first), len(second)) < MIN_ROUNDS:
        reason = f"too few samples ({len(first)} and {len(second)}, minimum {MIN_ROUNDS})"
    if reason:
        return _make_inconclusive(first, second, reason)
    pair = Pair(first, second, None, same_work, polygons=head.polygons)
    references = (select_positive(before.reference_s), select_positive(after.reference_s))
    if not all(map(len, references)):
        return pair
    # A missing sample would shift the following samples to other rounds.
    complete = len(first) == len(before.samples_s) and len(second) == len(after.samples_s)
    if complete and before.is_paired_with(after):
        return replace(
            pair,
            reference=references,
            same_rounds=True,
            same_drawing=_is_same_drawing(base, head),
            parts=(after.epochs or None, after.processes or None),
            quiet=select_rounds(before, after),
        )
    obstacle = run_quality.explain_incomparable(before, after, machines_differ=machines_differ)
    return replace(pair, reference=references, obstacle=obstacle)


def _is_same_drawing(base: Record, head: Record) -> bool:
    """Return whether both versions have equal triangles, so that one drawing was timed for both.

    Both records then have the same samples. A coarse timer may give equal samples by chance, so the
    sums of the criteria and the counters must be equal as well.
    """
    return (base.time, base.predicted, base.counters) == (head.time, head.predicted, head.counters)


def compare_group(
    group: CaseGroup, pairs: Sequence[Pair], settings: Settings, *, machines_differ: bool
) -> tuple[list[TimeChange], Drift | None]:
    """Return the changes of a group's cases and the group's drift.

    `comparison.correct_q_values` must still correct the q-values for the number of cases. If BASE
    and HEAD were measured in the same rounds, the drift is computed from the cases that draw
    different triangles, and is None if there are fewer than two such cases.
    """
    if all(pair.same_rounds for pair in pairs):
        changes = [
            _make_unchanged(pair)
            if pair.same_drawing
            else compare_rounds(pair.base, pair.head, settings, pair.parts, pair.quiet)
            for pair in pairs
        ]
        timed = [pair for pair in pairs if not pair.same_drawing]
        if len(timed) < 2:
            return changes, None
        masks = [pair.quiet for pair in timed if pair.quiet is not None]
        quiet = np.all(masks, axis=0) if masks else None
        if quiet is not None and quiet.sum() < MIN_QUIET_ROUNDS:
            quiet = None
        samples = [(pair.base, pair.head) for pair in timed]
        return changes, measure_round_drift(group, samples, settings, timed[0].parts, quiet)
    errors = np.array(
        [compute_margins(pair.base, pair.head, settings.confidence) for pair in pairs]
    )
    changes = []
    for number, pair in enumerate(pairs):
        peers = [*pairs[:number], *pairs[number + 1 :]]
        shift = pair.obstacle or _estimate_shift(pair, peers, settings, machines_differ)
        changes.append(
            _make_inconclusive(pair.base, pair.head, shift)
            if isinstance(shift, str)
            else _compare_with_shift(pair, errors[number], shift, settings)
        )
    return changes, _measure_run_drift(group, pairs, errors, settings, machines_differ)


def _estimate_shift(
    pair: Pair, cases: Sequence[Pair], settings: Settings, machines_differ: bool
) -> MachineShift | str:
    """Return the machine's share of a pair's log ratio, or why it cannot be estimated.

    The estimate uses peers: those of the group's other `cases` that drew the same polygons. Without
    enough peers the share lies between 0 and the reference draw's log ratio; on different machines
    it equals the latter. A case that drew other polygons than the rest of its group (`fan` draws
    229 of 500) has no estimate: 49 of 49 wrong verdicts between separate runs of equal code were of
    such cases.
    """
    if settings.normalise == "auto":
        peers = [case for case in cases if case.polygons == pair.polygons]
        steady = [peer for peer in peers if peer.same_work]
        enough = len(steady) >= MIN_STEADY_PEERS
        if enough or len(peers) >= MIN_PEERS:
            logs = np.array([peer.log_ratio for peer in (steady if enough else peers)])
            return estimate_peer_shift(logs, settings.confidence)
        if len(peers) < len(cases):
            return f"too few cases drew the same {pair.polygons:,} polygons; use run --beside"
    if pair.reference is None or settings.normalise == "none":
        if machines_differ:
            return "the machines differ, and a reference draw is missing"
        return MachineShift(0.0, 0.0, DRIFT_SD, math.inf, "none")
    reference = compute_log_ratio(*pair.reference)
    low, high = sorted((reference if machines_differ else 0.0, reference))
    return MachineShift(low, high, DRIFT_SD, math.inf, "reference")


def _compare_with_shift(
    pair: Pair, error: Samples, shift: MachineShift, settings: Settings
) -> TimeChange:
    """Return the change of a case between separate runs, less the machine's share `shift`.

    error : (2,) reach of the log ratio's interval below and above, from the samples' scatter only
    """
    raw = pair.log_ratio
    margin = get_two_sided_quantile(settings.confidence, shift.degrees) * shift.sd
    lowest, highest = raw - shift.high, raw - shift.low
    middle = (lowest + highest) / 2
    low = lowest - math.hypot(error[0], margin)
    high = highest + math.hypot(error[1], margin)
    threshold = settings.get_time_threshold(paired=False)
    outcome, reason = classify_change(lowest, highest, low, high, threshold)
    faster = _select_faster_half(pair.base), _select_faster_half(pair.head * math.exp(middle - raw))
    p_value = float(stats.mannwhitneyu(*faster, alternative="two-sided").pvalue)
    # A change needs both the test and the interval, so the weaker of the two is corrected.
    interval_p = _compute_p_value(lowest, highest, low, high, settings.confidence, shift.degrees)
    return TimeChange(
        outcome,
        reason,
        *(math.exp(middle), math.exp(low), math.exp(high), math.exp(raw)),
        shift.against,
        threshold,
        p_value=p_value,
        q_value=max(p_value, interval_p),
        **summarise_samples(pair.base, pair.head),
    )


def _select_faster_half(samples: Samples) -> Samples:
    """Return the samples up to their median: other programs lengthen some of the slower half."""
    return np.sort(samples)[: (len(samples) + 1) // 2]


def _measure_run_drift(
    group: CaseGroup,
    pairs: Sequence[Pair],
    errors: Samples,
    settings: Settings,
    machines_differ: bool,
) -> Drift:
    """Compare the median log ratio of a group in separate runs with the reference draw's log ratio.

    The drift is never gated: separate runs cannot distinguish slower code from a slower machine,
    which slows the reference draw, one large triangle, by another factor than a thousand small
    triangles. The machine's share may be any value between 0 and the reference draw's log ratio.
    """
    shift = float(np.median([pair.log_ratio for pair in pairs]))
    references = [pair.reference for pair in pairs if pair.reference is not None]
    reference, reference_error = None, 0.0
    if references:
        reference = compute_log_ratio(*references[0])
        reference_error = float(compute_margins(*references[0], settings.confidence).max())
    # A median of k normal values has pi / 2k of their variance.
    sampling = float(np.median(errors)) * math.sqrt(math.pi / (2 * len(pairs)))
    margin = math.hypot(
        get_two_sided_quantile(settings.confidence) * DRIFT_SD, sampling, reference_error
    )
    explained = (0.0, reference or 0.0)
    lowest, highest = shift - max(explained), shift - min(explained)
    low, high = lowest - margin, highest + margin
    outcome, reason = classify_change(
        lowest, highest, low, high, settings.get_time_threshold(paired=False)
    )
    if machines_differ:
        outcome, reason = "inconclusive", "the machines differ"
    ends = (math.exp(shift), math.exp(low), math.exp(high))
    ratio = None if reference is None else math.exp(reference)
    return Drift(group, len(pairs), outcome, reason, *ends, reference=ratio, gated=False)


def _compute_p_value(
    lowest: float, highest: float, low: float, high: float, confidence: float, degrees: float
) -> float:
    """Return the two-sided p-value of "no change" that corresponds to a Student interval.

    The log ratio is between `lowest` and `highest`; its confidence interval is `low` to `high`.
    """
    nearest, reach = (lowest, lowest - low) if lowest > 0 else (-highest, high - highest)
    if nearest <= 0:
        return 1.0
    if reach <= 0:
        return 0.0
    return 2 * float(
        stats.t.sf(get_two_sided_quantile(confidence, degrees) * nearest / reach, degrees)
    )


def _make_inconclusive(base: Samples, head: Samples, reason: str) -> TimeChange:
    return TimeChange("inconclusive", reason, **summarise_samples(base, head))


def _make_unchanged(pair: Pair) -> TimeChange:
    """Return the change, without a test, of a case with equal triangles in both versions."""
    return TimeChange(
        "unchanged", "", against="same-triangles", **summarise_samples(pair.base, pair.head)
    )


def classify_change(
    lowest: float, highest: float, low: float, high: float, threshold: float
) -> tuple[Outcome, str]:
    """Return the outcome for a log ratio of `lowest` to `highest`, with interval `low` to `high`.

    The outcome is `regressed` or `improved` only beyond the threshold with an interval that
    excludes 0, and `unchanged` only with an interval inside the threshold; otherwise inconclusive,
    with the reason.
    """
    bound = math.log1p(threshold)
    if lowest > bound and low > 0:
        return "regressed", ""
    if highest < -bound and high < 0:
        return "improved", ""
    if -bound <= low and high <= bound:
        return "unchanged", ""
    interval = f"{math.expm1(low) * 100:+.1f} % to {math.expm1(high) * 100:+.1f} %"
    return "inconclusive", f"95 % CI {interval}, threshold ±{threshold * 100:g} %"


def compare_rounds(
    base: Samples,
    head: Samples,
    settings: Settings,
    parts: Parts = (None, None),
    quiet: NDArray[np.bool_] | None = None,
) -> TimeChange:
    """Compare two versions by the ratios of rounds; element r of both is from round r.

    parts : number of rounds in each epoch and in each process, in order
    quiet : (r,) True for the rounds to use. A round in which one version waited for a core is left
        out; any other disturbance affects both versions alike
    """
    ratio = compute_paired_ratio(head, base, *parts, quiet)
    if quiet is not None:
        base, head = base[quiet], head[quiet]
    threshold = settings.get_time_threshold(paired=True)
    value, low, high = (math.log(x) for x in (ratio.value, ratio.low, ratio.high))
    outcome, reason = classify_change(value, value, low, high, threshold)
    p_value = compute_sign_p_value(np.log(head / base))
    return TimeChange(
        *(outcome, reason, ratio.value, ratio.low, ratio.high, ratio.value, "rounds", threshold),
        p_value=p_value,
        q_value=p_value,
        **summarise_samples(base, head),
    )


def summarise_samples(base: Samples, head: Samples) -> dict[str, Any]:
    """Return medians and numbers of rounds by their names in `TimeChange`."""
    samples = {"base": base, "head": head}
    medians = {f"{k}_median_s": float(np.median(v)) if len(v) else None for k, v in samples.items()}
    return medians | {f"{name}_rounds": len(values) for name, values in samples.items()}


def measure_round_drift(
    group: CaseGroup,
    pairs: Sequence[tuple[Samples, Samples]],
    settings: Settings,
    parts: Parts = (None, None),
    quiet: NDArray[np.bool_] | None = None,
) -> Drift:
    """Return the common change of a group's cases, from each round's median ratio.

    pairs : samples of each case in BASE and in HEAD, (r,) each
    """
    ratios = np.exp(np.median([np.log(head / base) for base, head in pairs], axis=0))
    change = compare_rounds(np.ones(len(ratios)), ratios, settings, parts, quiet)
    outcome, reason = change.outcome, change.reason
    if outcome in ("regressed", "improved") and (change.q_value or 0.0) > MAX_ROUNDS_Q:
        outcome, reason = "inconclusive", "too few rounds"
    value, low, high = (float(end or math.nan) for end in (change.ratio, change.low, change.high))
    return Drift(group, len(pairs), outcome, reason, value, low, high, reference=1.0, gated=True)


def compute_sign_p_value(logs: Samples) -> float:
    """Return the two-sided p-value of the sign test of (r,) log ratios."""
    slower, faster = int((logs > 0).sum()), int((logs < 0).sum())
    if slower + faster == 0:
        return 1.0
    return float(stats.binomtest(slower, slower + faster).pvalue)


def select_positive(values: Sequence[Any]) -> Samples:
    """Return the finite positive numbers among `values`, (n,)."""
    numbers = np.array([v for v in values if isinstance(v, int | float)], np.float64)
    return numbers[np.isfinite(numbers) & (numbers > 0)]


def compute_low_quantile(samples_s: Sequence[Any]) -> float | None:
    """Return the low quantile of a record's samples in seconds, or None if there are none."""
    samples = select_positive(samples_s)
    return float(np.quantile(samples, QUANTILE)) if len(samples) else None


def compute_log_ratio(base: Samples, head: Samples) -> float:
    """Return the log of HEAD's low quantile over BASE's."""
    return float(np.log(np.quantile(head, QUANTILE) / np.quantile(base, QUANTILE)))


def compute_margins(base: Samples, head: Samples, confidence: float) -> Samples:
    """Return (2,) how far the bootstrap interval extends below and above `compute_log_ratio`."""
    rng = np.random.default_rng(zlib.crc32(base.tobytes() + head.tobytes()))
    ratios = np.log(_resample_quantiles(head, rng) / _resample_quantiles(base, rng))
    low, high = np.quantile(ratios, [(1 - confidence) / 2, (1 + confidence) / 2])
    ratio = compute_log_ratio(base, head)
    return np.maximum(0.0, [ratio - low, high - ratio])


def _resample_quantiles(samples: Samples, rng: np.random.Generator) -> Samples:
    """Return (RESAMPLES,) low quantiles of samples drawn from `samples` with replacement.

    No sample is drawn: the k-th smallest of n uniform numbers has the distribution Beta(k, n+1-k),
    and the next larger is the minimum of the n-k above. Their positions among the sorted samples
    are distributed as if n samples had been drawn, so 100,000 samples cost as little as thirty.
    """
    n = len(samples)
    position = QUANTILE * (n - 1)  # NumPy's definition: between the order statistics k and k + 1
    k = int(position) + 1
    lower = rng.beta(k, n + 1 - k, RESAMPLES)
    upper = 1 - (1 - lower) * rng.random(RESAMPLES) ** (1 / (n - k))
    below, above = np.sort(samples)[np.minimum((n * np.array([lower, upper])).astype(int), n - 1)]
    share = position - int(position)
    quantiles: Samples = (1 - share) * below + share * above
    return quantiles
