"""A farm on this machine: two workers, a scripted device each, one run of both."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest
from distributed import LocalCluster

from harness.scaling.farm import measure as farm_out
from harness.scaling.merging import on_host
from harness.stored.folder import file_stem, read_run
from tests.measuring.test_run import MOCK, measure, plan_for, quiet

NAMES = ("ear-clipping", "delaunay")


@pytest.fixture(scope="module")
def farm() -> Iterator[str]:
    """The address of a scheduler whose one worker offers the scripted device."""
    import dask

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1000}),
        LocalCluster(
            n_workers=1,
            threads_per_worker=2,
            resources={"scripted": 1},
            dashboard_address=":0",
            silence_logs=50,
        ) as cluster,
    ):
        yield cluster.scheduler_address


def run(harness, scene, farm, *more):
    return harness(
        *("run", "--scene", str(scene), "--rasterisers", MOCK, "--quick"),
        *("--triangulators", ",".join(NAMES), "--dask", farm, *more),
    )


def test_a_farm_gives_the_counters_of_a_run_made_apart(farm, block, tmp_path):
    plan = plan_for(block, triangulators=NAMES)
    outcome, aside = farm_out(plan, tmp_path / "farm", farm, quiet())
    assert aside == {}
    host = file_stem(socket.gethostname())
    apart = measure(plan, tmp_path / "apart")
    expected = on_host(read_run(apart.path), host).records
    assert {record["device"] for record in outcome.records} == {f"scripted@{host}"}
    assert {record["key"]: record["counters"] for record in outcome.records} == {
        record["key"]: record["counters"] for record in expected
    }
    assert len(list((tmp_path / "farm" / "hosts").iterdir())) == 1


def test_what_no_worker_offers_is_said(harness, farm, block):
    code, _, error = run(harness, block, farm, "--device", "gpu0", "--out", "none")
    assert code == 2
    assert "no worker offers a device of this run (offered: scripted)" in error
    code, _, error = run(harness, block, farm, "--json")
    assert code == 2
    assert "--dask goes with none of" in error


def test_a_device_is_held_by_a_lock_that_dies_with_its_process(tmp_path, monkeypatch):
    from harness.scaling.farm import _alone

    monkeypatch.setenv("RASTER_HARNESS_CACHE", str(tmp_path / "cache" / "known.sqlite"))
    holder = (
        "from harness.scaling.farm import _alone; import sys, time\n"
        "with _alone('llvmpipe'):\n    print('held', flush=True); time.sleep(60)"
    )
    process = subprocess.Popen([sys.executable, "-c", holder], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "held\n"
        import fcntl

        (lock,) = (tmp_path / "cache").glob("*.lock")
        with lock.open("a") as stream, pytest.raises(BlockingIOError):
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    finally:
        process.kill()
        process.wait()
    with _alone("zink"):  # software, too: it shares the cores
        assert [*(tmp_path / "cache").glob("*.lock")] == [lock]
