"""The search of `make fuzz`; `make test` does not collect it because of its file name."""

import os

import pytest

from tests.fuzz.target import load_targets, search_inputs

TARGETS = load_targets()
TOTAL_S = float(os.environ.get("FUZZ_SECONDS", "600"))
WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
TARGET_S = TOTAL_S / -(-len(TARGETS) // WORKERS)


@pytest.mark.parametrize("name", TARGETS)
def test_no_input_violates_the_guarantee(name: str, record_property) -> None:
    count = search_inputs(TARGETS[name], TARGET_S)
    assert count, "no input was tried; increase FUZZ_SECONDS"
    record_property("fuzz", f"{name}: {count:,} inputs in {TARGET_S:.0f} s, no failure")
