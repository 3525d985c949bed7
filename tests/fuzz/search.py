"""The search that `make fuzz` starts; its name keeps it out of `make test`."""

import os

import pytest

from tests.fuzz.target import search, targets

TARGETS = targets()
TOTAL_S = float(os.environ.get("FUZZ_SECONDS", "600"))
WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
SHARE_S = TOTAL_S / -(-len(TARGETS) // WORKERS)


@pytest.mark.parametrize("name", TARGETS)
def test_no_input_breaks(name: str, record_property) -> None:
    tried = search(TARGETS[name], SHARE_S)
    assert tried, "no input was tried: give more FUZZ_SECONDS"
    record_property("fuzz", f"{name}: {tried:,} inputs in {SHARE_S:.0f} s, none breaks it")
