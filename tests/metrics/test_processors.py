"""Times of software devices are separated by processor; other devices are unchanged."""

from dataclasses import replace

import pytest

from harness.metrics.groups import (
    describe_machine,
    find_mixed_processors,
    format_processors,
    is_drawn_in_software,
    mark_processors,
)
from harness.results.run_folder import Run
from tests.records import make_record, make_run


@pytest.mark.parametrize(
    ("device", "renderer", "drawn"),
    [
        *(("llvmpipe", None, True), ("cpu", None, True), ("zink@host", None, True)),
        ("gpu0", "llvmpipe (LLVM 15.0.6, 256 bits)", True),
        *(("gpu0", "NVIDIA H100", False), ("gpu0", "", False), ("gpu0", None, False)),
    ],
)
def test_software_devices_are_recognised_by_renderer_or_name(device, renderer, drawn):
    details = {} if renderer is None else {"details": {"renderer": renderer}}
    name, _, host = device.partition("@")
    record = make_record(device=name, host=host or None)
    listed = {"devices": {f"opengl on {device}": details}}
    for facts in [listed] if details else [listed, {}, {"devices": None}]:
        assert is_drawn_in_software(make_run([], **facts), record) is drawn


def make_runs(*labels: str) -> list[Run]:
    """Return a run for each processor: timed on llvmpipe and a GPU, untimed on the CPU."""
    records = [
        make_record(device=device, time={"timer": timer, "samples_s": [1.0]})
        for device, timer in (("llvmpipe", "wall"), ("gpu0", "gpu"))
    ]
    untimed = make_record(rasteriser="reference", device="cpu")
    return [make_run([*records, untimed], cpu={"label": label}) for label in labels]


def mark(case, processor):
    return replace(case, device=f"{case.device} ({processor})")


def test_only_timed_software_devices_are_marked():
    runs = make_runs("Xeon", "EPYC")
    mixed = find_mixed_processors(runs)
    assert mixed == {"llvmpipe": ["EPYC", "Xeon"]}
    assert format_processors(mixed) == "llvmpipe on EPYC, Xeon"
    assert find_mixed_processors(runs[:1]) == {}
    devices = [[record.id.device for record in run.records] for run in mark_processors(runs, mark)]
    assert devices == [[f"llvmpipe ({kind})", "gpu0", "cpu"] for kind in ("Xeon", "EPYC")]


def test_description_names_the_processor_and_disturbances():
    (run,) = make_runs("Xeon")
    assert describe_machine(run) == ["processor of llvmpipe: Xeon"]
    assert describe_machine(replace(run, records=run.records[1:])) == []
    assert describe_machine(replace(run, facts={})) == []
    slow = {"state": "disturbed", "why": ["it was slow"], "draws": []}
    assert len(describe_machine(replace(run, facts={**run.facts, "state": slow}))) == 2
