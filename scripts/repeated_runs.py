"""Compares two runs of one plan: are counters equal, and how often do verdicts on times agree?

    python -m scripts.repeated_runs results/once results/again

Ends with 1 if a counter differs.
"""

import sys
from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

from harness.metrics.groups import group_records, time_ratio, without_twins
from harness.results.record import Record
from harness.results.run_folder import read_run
from harness.stats.intervals import UNDECIDED

MAX_KEYS_PRINTED = 5


def compare_repeated(
    first: Sequence[Record], second: Sequence[Record]
) -> tuple[int, list[str], dict[tuple[str, str], tuple[int, int, int, int]]]:
    """Compare two runs' counters case by case, and their verdicts pair by pair.

    A pair is two triangulations of the same polygons, on one device in one view; two names of one
    triangulation are not a pair.

    Returns the number of common cases; the keys of cases with a counter that differs; and for each
    (rasteriser, device) four numbers of pairs: timed together in both runs, with the same verdict
    (faster, slower, or no difference shown), decided in both, decided in both and with the same
    verdict.
    """
    others = {record.key: record for record in second if record.is_ok}
    common = [record for record in first if record.is_ok and record.key in others]
    unequal = [each.key for each in common if each.counters != others[each.key].counters]
    one, other = _verdicts(common), _verdicts([others[record.key] for record in common])
    agreement = {}
    for device, verdicts in one.items():
        pairs = verdicts.keys() & other[device].keys()
        decided = [n for n in pairs if UNDECIDED not in (verdicts[n], other[device][n])]
        same = {pair for pair in pairs if verdicts[pair] == other[device][pair]}
        if pairs:
            counts = (len(pairs), len(same), len(decided), len(same.intersection(decided)))
            agreement[device] = counts
    return len(common), unequal, agreement


def _verdicts(records: Sequence[Record]) -> dict[tuple[str, str], dict[tuple[object, ...], str]]:
    """Return (rasteriser, device) -> pair -> verdict, of pairs that were timed together."""
    verdicts: dict[tuple[str, str], dict[tuple[object, ...], str]] = defaultdict(dict)
    for group in group_records(records):
        ordered = sorted(group.records, key=lambda record: record.name)
        for one, other in combinations(without_twins(ordered), 2):
            if ratio := time_ratio(one, other):
                device = group.id.rasteriser, group.id.device_name
                verdicts[device][group.id, one.name, other.name] = ratio.verdict
    return verdicts


def main(first: str, second: str) -> None:
    """Print the comparison of two run folders."""
    runs = (read_run(Path(folder)) for folder in (first, second))
    cases, unequal, agreement = compare_repeated(*(run.records for run in runs))
    if not cases:
        sys.exit(f"{first} and {second} have no case in common: run the same plan twice")
    print(f"counters: equal in {cases - len(unequal):,} of {cases:,} cases")
    for key in unequal[:MAX_KEYS_PRINTED]:
        print(f"  differ: {key}")
    for (rasteriser, device), (pairs, same, decided, same_decided) in agreement.items():
        share = f", and agree on {same_decided / decided:.2%} of these" if decided else ""
        print(
            f"{rasteriser} on {device}, {pairs:,} pairs: both runs say which is faster for "
            f"{decided:,}{share}; all three verdicts counted, they agree on {same / pairs:.1%}"
        )
    sys.exit(1 if unequal else 0)


if __name__ == "__main__":
    main(*sys.argv[1:])
