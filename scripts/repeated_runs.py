"""Compare two runs of the same plan: equality of counters and agreement of verdicts on times.

    python -m scripts.repeated_runs results/once results/again

The exit code is 1 if a counter differs.
"""

import sys
from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

from harness.metrics.groups import compute_time_ratio, drop_equal_triangulations, group_records
from harness.metrics.statistics import UNDECIDED
from harness.results.record import Record
from harness.results.run_folder import read_run

MAX_KEYS_PRINTED = 5


def compare_repeated(
    first: Sequence[Record], second: Sequence[Record]
) -> tuple[int, list[str], dict[tuple[str, str], tuple[int, int, int, int]]]:
    """Compare the counters of two runs case by case, and their verdicts pair by pair.

    A pair is two different triangulations of the same polygons on the same device in the same view.

    Returns the number of common cases, the keys of cases with different counters, and for each
    (rasteriser, device) four numbers of pairs: timed together in both runs; with the same verdict
    (faster, slower or no significant difference); significant in both; significant in both with
    the same verdict.
    """
    second_by_key = {record.key: record for record in second if record.is_ok}
    common = [record for record in first if record.is_ok and record.key in second_by_key]
    repeated = [second_by_key[record.key] for record in common]
    cases = zip(common, repeated, strict=True)
    unequal = [record.key for record, repeat in cases if record.counters != repeat.counters]
    first_verdicts, second_verdicts = _verdicts(common), _verdicts(repeated)
    agreement = {}
    for device, verdicts in first_verdicts.items():
        pairs = verdicts.keys() & second_verdicts[device].keys()
        verdicts_of = {pair: {verdicts[pair], second_verdicts[device][pair]} for pair in pairs}
        decided = [pair for pair in pairs if UNDECIDED not in verdicts_of[pair]]
        equal = {pair for pair in pairs if len(verdicts_of[pair]) == 1}
        if pairs:
            counts = (len(pairs), len(equal), len(decided), len(equal.intersection(decided)))
            agreement[device] = counts
    return len(common), unequal, agreement


def _verdicts(records: Sequence[Record]) -> dict[tuple[str, str], dict[tuple[object, ...], str]]:
    """Return (rasteriser, device) -> pair -> verdict for pairs that were timed together."""
    verdicts: dict[tuple[str, str], dict[tuple[object, ...], str]] = defaultdict(dict)
    for group in group_records(records):
        ordered = sorted(group.records, key=lambda record: record.name)
        for first, second in combinations(drop_equal_triangulations(ordered), 2):
            if ratio := compute_time_ratio(first, second):
                device = group.id.rasteriser, group.id.device_name
                verdicts[device][group.id, first.name, second.name] = ratio.verdict
    return verdicts


def main(first: str, second: str) -> None:
    """Print the comparison of two run folders."""
    runs = (read_run(Path(folder)) for folder in (first, second))
    cases, unequal, agreement = compare_repeated(*(run.records for run in runs))
    if not cases:
        sys.exit(f"{first} and {second}: no common cases; run the same plan twice")
    print(f"counters: equal in {cases - len(unequal):,} of {cases:,} cases")
    for key in unequal[:MAX_KEYS_PRINTED]:
        print(f"  differ: {key}")
    for (rasteriser, device), (pairs, equal, decided, equal_decided) in agreement.items():
        share = f", same direction for {equal_decided / decided:.2%} of these" if decided else ""
        print(
            f"{rasteriser} on {device}, {pairs:,} pairs: significant in both runs for "
            f"{decided:,}{share}; the verdicts of all pairs agree on {equal / pairs:.1%}"
        )
    sys.exit(1 if unequal else 0)


if __name__ == "__main__":
    main(*sys.argv[1:])
