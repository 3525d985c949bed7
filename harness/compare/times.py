"""Classify the change of times between two runs, separating the triangulator from the machine.

Between two runs the machine drifts: all cases of a run become a few per cent faster or slower
together, and other programs lengthen some samples but shorten none. Therefore

- a time is summarised by a low quantile of the samples, which other programs hardly affect;
- a case is compared with its peers, the cases of its group that drew the same polygons; memory
  layout scatters the ratios of peers even with equal code, and the interval includes this scatter;
- the drift, the median log ratio of a group's cases, is reported and never gated.

If both versions were timed in the same rounds, each round's ratio depends on the code alone, and
the common change of all cases is gated like the change of one case.

docs/how-to/ci.md has the rules. Separate runs are tested by Mann & Whitney (1947) and by the
interval; versions of the same rounds by a sign test, with Student's interval. Both are corrected
for many cases by Benjamini & Hochberg (1995). As in an equivalence test, a time is `unchanged` only
if the interval lies inside the threshold.
"""

import math
import zlib
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from harness.compare.matching import (
    QUANTILE,
    Pair,
    Parts,
    Samples,
    compute_log_ratio,
    summarise_samples,
)
from harness.compare.model import Against, Drift, Outcome, Settings, TimeChange
from harness.metrics.run_quality import MIN_QUIET_ROUNDS
from harness.metrics.statistics import compute_paired_ratio
from harness.results.record import CaseGroup

RESAMPLES = 2000  # of the bootstrap, for an interval

MAX_ROUNDS_Q = 1e-3  # maximum q-value in common rounds: 1 in 1,000 reported changes may be chance

MIN_STEADY_PEERS = 2  # minimum number of peers with equal counters; with fewer, all peers are used

DRIFT_SD = 0.015  # standard deviation of log ratios of equal code about the reference draw's

MIN_PEERS = 3  # minimum number of peers; with fewer, the reference draw is used

MIN_CASE_SD = 0.0075  # minimum scatter of a case's log ratio between runs of equal code

OUTLIER_CONFIDENCE = 0.99  # confidence of the interval that excludes a single outlying peer


class MachineShift(NamedTuple):
    """The machine's share of a case's log ratio, between `low` and `high`.

    sd : standard deviation of the case's log ratio about the share
    degrees : degrees of freedom of `sd`; inf if `sd` is a constant, not an estimate
    """

    low: float
    high: float
    sd: float
    degrees: float
    against: Against


def compare_group(
    group: CaseGroup, pairs: Sequence[Pair], settings: Settings, *, machines_differ: bool
) -> tuple[list[TimeChange], Drift | None]:
    """Return the changes of a group's cases, with q-values to be corrected, and the group's drift.

    In common rounds, the drift is that of the cases with different triangles, and None if there are
    fewer than two. A resumed run has several groups of common rounds: the largest is used.
    """
    if all(pair.same_rounds for pair in pairs):
        changes = [
            TimeChange(
                "unchanged", "", against="same-triangles", **summarise_samples(pair.base, pair.head)
            )
            if pair.same_drawing
            else compare_rounds(pair.base, pair.head, settings, pair.parts, pair.quiet)
            for pair in pairs
        ]
        timed = [pair for pair in pairs if not pair.same_drawing]
        groups = Counter(pair.round_group for pair in timed).most_common(1)
        timed = [pair for pair in timed if pair.round_group == groups[0][0]]
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
            TimeChange("inconclusive", shift, **summarise_samples(pair.base, pair.head))
            if isinstance(shift, str)
            else _compare_with_shift(pair, errors[number], shift, settings)
        )
    return changes, _measure_run_drift(group, pairs, errors, settings, machines_differ)


def _estimate_shift(
    pair: Pair, cases: Sequence[Pair], settings: Settings, machines_differ: bool
) -> MachineShift | str:
    """Return the machine's share of a pair's log ratio, or why it cannot be estimated.

    Without enough peers the share lies between 0 and the reference draw's log ratio; on different
    machines it equals the latter. A case that drew other polygons than the rest of its group has no
    estimate: 49 of 49 wrong verdicts between separate runs of equal code were of such cases.
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


def estimate_peer_shift(logs: NDArray[np.float64], confidence: float) -> MachineShift:
    """Return the machine's share of a case's log ratio, from the (k,) log ratios of its peers.

    With equal code all k + 1 log ratios scatter about the drift with the same unknown standard
    deviation sigma. A median of k normal values has about pi / 2k of their variance, so the
    case x lies about the peers' median m with variance sigma^2 (1 + pi / 2k). With the sample
    deviation s in place of sigma, (x - m) / (s sqrt(1 + pi / 2k)) follows Student's distribution
    with k - 1 degrees of freedom: the interval covers 95.2 to 95.6 % for 2 to 8 peers. Taking s as
    known (1.96) gave a false regression in 17 % of comparisons of six cases whose times differ by
    2 % between processes.

    Peers can agree by chance, so the larger of two half-widths is used: the normal quantile times
    `MIN_CASE_SD`, and Student's quantile times s. A single peer with changed code would widen the
    interval of all cases, so one peer outside the 99 % interval of the other peers is excluded.
    """
    if len(logs) > MIN_PEERS:
        shifts = [
            _estimate_from_peers(np.delete(logs, peer), confidence) for peer in range(len(logs))
        ]
        changed = [
            abs(log - shift.low)
            > get_two_sided_quantile(OUTLIER_CONFIDENCE, shift.degrees) * shift.sd
            for log, shift in zip(logs, shifts, strict=True)
        ]
        if sum(changed) == 1:
            return shifts[changed.index(True)]
    return _estimate_from_peers(logs, confidence)


def _estimate_from_peers(logs: NDArray[np.float64], confidence: float) -> MachineShift:
    count = len(logs)
    sd, degrees = float(np.std(logs, ddof=1)), float(count - 1)
    if (
        get_two_sided_quantile(confidence, degrees) * sd
        <= get_two_sided_quantile(confidence) * MIN_CASE_SD
    ):
        sd, degrees = MIN_CASE_SD, math.inf
    middle = float(np.median(logs))
    sd *= math.sqrt(1 + math.pi / (2 * count))
    return MachineShift(middle, middle, sd, degrees, "peers")


def get_two_sided_quantile(confidence: float, degrees: float = math.inf) -> float:
    """Return a two-sided Student interval's half-width in standard deviations."""
    return float(stats.t.ppf(0.5 + confidence / 2, degrees))


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

    A slower machine slows the reference draw, one large triangle, by another factor than a thousand
    small triangles, so its share may be any value between 0 and the reference draw's log ratio.
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
    """Return the two-sided p-value of "no change" that corresponds to a Student interval."""
    nearest, reach = (lowest, lowest - low) if lowest > 0 else (-highest, high - highest)
    if nearest <= 0:
        return 1.0
    if reach <= 0:
        return 0.0
    return 2 * float(
        stats.t.sf(get_two_sided_quantile(confidence, degrees) * nearest / reach, degrees)
    )


def classify_change(
    lowest: float, highest: float, low: float, high: float, threshold: float
) -> tuple[Outcome, str]:
    """Return the outcome for a log ratio of `lowest` to `highest`, with interval `low` to `high`.

    The outcome is `regressed` or `improved` only beyond the threshold with an interval that
    excludes 0, and `unchanged` only with an interval inside the threshold.
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

    Rounds in which one version waited for a core are not in `quiet`, (r,).
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


def measure_round_drift(
    group: CaseGroup,
    pairs: Sequence[tuple[Samples, Samples]],
    settings: Settings,
    parts: Parts = (None, None),
    quiet: NDArray[np.bool_] | None = None,
) -> Drift:
    """Return the common change of a group's cases, from each round's median ratio."""
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
