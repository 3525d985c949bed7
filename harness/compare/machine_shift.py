"""The machine's share of a case's log ratio between separate runs, estimated from peers."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from harness.compare.model import Against

MIN_PEERS = 3
"""Minimum number of peers (cases timed together), whatever their counters; with fewer, the
reference draw is used."""

MIN_CASE_SD = 0.0075
"""Minimum standard deviation of a case's log ratio between two runs of equal code."""

OUTLIER_CONFIDENCE = 0.99
"""Confidence of the interval of all peers but one; if just one peer is outside, it is excluded."""


@dataclass(frozen=True)
class MachineShift:
    """The machine's share of a case's log ratio.

    low, high : bounds of the share
    sd : standard deviation of the case's log ratio about the share
    degrees : degrees of freedom of `sd`; inf if `sd` is a constant, not an estimate
    against : source of the estimate
    """

    low: float
    high: float
    sd: float
    degrees: float
    against: Against


def estimate_peer_shift(logs: NDArray[np.float64], confidence: float) -> MachineShift:
    """Return the machine's share of a case's log ratio, estimated from its peers.

    logs : (k,) log ratios of the peers, cases timed together with the case on the same polygons

    With equal code all k + 1 log ratios scatter about the drift with the same unknown standard
    deviation sigma. A median of k normal values has about pi / 2k of their variance, so the
    case x lies about the peers' median m with variance sigma^2 (1 + pi / 2k). With the sample
    deviation s in place of sigma, (x - m) / (s sqrt(1 + pi / 2k)) follows Student's distribution
    with k - 1 degrees of freedom: the interval covers 95.2 to 95.6 % for 2 to 8 peers. Taking s as
    known (1.96) gave a false regression in 17 % of comparisons of six cases whose times differ by
    2 % between processes.

    sigma is at least `MIN_CASE_SD`, and peers can agree by chance. If sigma equals that minimum,
    the normal quantile times `MIN_CASE_SD` is wide enough; if sigma is larger, Student's quantile
    times s is. So the larger of both is used. A single peer with changed code would widen the
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
    """Return the median of (k,) peers' log ratios and the deviation of a case about the median."""
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
    """Return a two-sided interval's half-width in standard deviations, by Student's distribution.

    degrees : degrees of freedom; inf for the normal distribution
    """
    return float(stats.t.ppf(0.5 + confidence / 2, degrees))
