"""Runs are grouped by the processors that drew; what no processor draws on is left as it is."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.metrics.processors import (
    describe_machine,
    find_mixed_processors,
    format_processors,
    is_drawn_by_processor,
    mark_processors,
)
from harness.results.run_folder import Run
from tests.records import make_record, make_run


@pytest.mark.parametrize(
    ("device", "renderer", "drawn"),
    [
        ("llvmpipe", None, True),
        ("cpu", None, True),
        ("zink@host", None, True),
        ("gpu0", "llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("gpu0", "NVIDIA H100", False),
        ("gpu0", "", False),
        ("gpu0", None, False),
    ],
)
def test_the_renderer_says_who_draws_and_else_the_name(device, renderer, drawn):
    details = {} if renderer is None else {"details": {"renderer": renderer}}
    name, _, host = device.partition("@")
    record = make_record(device=name, host=host or None)
    for facts in ({}, {"devices": None}, {"devices": {f"opengl on {device}": details}}):
        if "details" in details and not facts.get("devices"):
            continue
        assert is_drawn_by_processor(Run(Path("run"), facts, []), record) is drawn


def runs_of(*labels: str) -> list[Run]:
    """A run a processor, of a device that it draws on, once untimed, and of a GPU."""
    records = [
        make_record(device=device, time={"timer": timer, "samples_s": [1.0]})
        for device, timer in (("llvmpipe", "wall"), ("gpu0", "gpu"))
    ]
    untimed = make_record(rasteriser="reference", device="cpu")
    return [make_run([*records, untimed], cpu={"label": each}) for each in labels]


def mark(case, processor):
    return replace(case, device=f"{case.device} ({processor})")


def test_only_what_processors_were_timed_on_is_kept_apart():
    runs = runs_of("Xeon", "EPYC")
    mixed = find_mixed_processors(runs)
    assert mixed == {"llvmpipe": ["EPYC", "Xeon"]}
    assert format_processors(mixed) == "llvmpipe on EPYC, Xeon"
    assert find_mixed_processors(runs[:1]) == {}
    devices = [[each.id.device for each in run.records] for run in mark_processors(runs, mark)]
    assert devices == [[f"llvmpipe ({kind})", "gpu0", "cpu"] for kind in ("Xeon", "EPYC")]


def test_a_device_of_that_name_that_no_processor_draws_on_keeps_it():
    runs = runs_of("Xeon", "EPYC")
    facts = {"devices": {"opengl on llvmpipe": {"details": {"renderer": "NVIDIA H100"}}}}
    real = Run(Path("run"), facts, runs[0].records)
    assert mark_processors([*runs, real], mark)[2].records == real.records


def test_description_names_the_processor_and_disturbances():
    (run,) = runs_of("Xeon")
    assert describe_machine(run) == ["processor of llvmpipe: Xeon"]
    assert describe_machine(replace(run, records=run.records[1:])) == []
    assert describe_machine(replace(run, facts={})) == []
    slow = {"state": "disturbed", "why": ["it was slow"], "draws": []}
    assert len(describe_machine(replace(run, facts={**run.facts, "state": slow}))) == 2
