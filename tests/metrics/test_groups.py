"""Runs are grouped by the processors that drew; what no processor draws on is left as it is."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.metrics.groups import (
    by_processor,
    machine_words,
    of_cpu,
    processor_words,
    several_processors,
    time_ratio,
)
from harness.results.run_folder import Run


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
        (None, None, False),
    ],
)
def test_the_renderer_says_who_draws_and_else_the_name(device, renderer, drawn):
    details = {} if renderer is None else {"details": {"renderer": renderer}}
    for facts in ({}, {"devices": None}, {"devices": {f"opengl on {device}": details}}):
        if "details" in details and not facts.get("devices"):
            continue
        run = Run(Path("run"), facts, [])
        assert of_cpu(run, {"rasteriser": "opengl", "device": device}) is drawn


def runs_of(*labels: str) -> list[Run]:
    """A run a processor, of a device that it draws on, once untimed, and of a GPU."""
    records = [
        {"rasteriser": "opengl", "device": device, "time": time}
        for device, time in (("llvmpipe", {"timer": "wall"}), ("gpu0", {"timer": "gpu"}))
    ]
    untimed = {"rasteriser": "reference", "device": "cpu", "time": None}
    return [Run(Path("run"), {"cpu": {"label": each}}, [*records, untimed]) for each in labels]


def test_only_what_processors_were_timed_on_is_kept_apart():
    runs = runs_of("Xeon", "EPYC")
    mixed = several_processors(runs)
    assert mixed == {"llvmpipe": ["EPYC", "Xeon"]}
    assert processor_words(mixed) == "llvmpipe on EPYC, Xeon"
    assert several_processors(runs[:1]) == {}
    found = [[record["device"] for record in run.records] for run in by_processor(runs)]
    assert found == [[f"llvmpipe ({kind})", "gpu0", "cpu"] for kind in ("Xeon", "EPYC")]


def test_a_device_of_that_name_that_no_processor_draws_on_keeps_it():
    runs = runs_of("Xeon", "EPYC")
    facts = {"devices": {"opengl on llvmpipe": {"details": {"renderer": "NVIDIA H100"}}}}
    real = Run(Path("run"), facts, runs[0].records)
    assert by_processor([*runs, real])[2].records == real.records


def test_a_run_says_which_processor_its_times_are_of():
    (run,) = runs_of("Xeon")
    assert machine_words(run) == ["times of llvmpipe are of this processor: Xeon"]
    assert machine_words(replace(run, records=run.records[1:])) == []
    assert machine_words(replace(run, facts={})) == []
    slow = {"state": "disturbed", "why": ["it was slow"], "draws": []}
    assert len(machine_words(replace(run, facts={**run.facts, "state": slow}))) == 2


def test_two_records_of_times_alone_have_a_ratio():
    times = {"samples_s": [1e-3 + 1e-6 * k for k in range(20)], "reference_s": [1e-3] * 20}
    base = {"polygons": 3, "time": times}
    slower = {"polygons": 3, "time": times | {"samples_s": [2 * s for s in times["samples_s"]]}}
    assert time_ratio(slower, base).value == pytest.approx(2.0)
    assert time_ratio(slower, base | {"polygons": 2}) is None
    assert time_ratio(slower, {"polygons": 3, "time": {"samples_s": [1.0]}}) is None
