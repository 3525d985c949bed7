"""Executors with two workers: crashes and failures of tasks, workers and schedulers."""

import os
import re
import signal
import sys
from collections import Counter
from functools import partial
from unittest.mock import Mock

import psutil
import pytest

from harness.errors import InconclusiveError, UsageError
from harness.progress import Reporter
from harness.scaling.dataset import Dataset
from harness.scaling.executors import MAX_ATTEMPTS, QUEUED_TASKS, DaskExecutor, Executor
from harness.scaling.triangulated import Triangulating
from tests.paths import run_python
from tests.scaling import tasks
from tests.scaling.conftest import EVERY, read_ids, read_parts

NAMES = [f"t{number}" for number in range(12)]
WORK = Triangulating("optimal:half-perimeter")
quiet = partial(Reporter, quiet=True)


def test_crashed_task_is_reported_and_others_complete(two_workers, tmp_path):
    work = {name: partial(tasks.note, str(tmp_path), name) for name in NAMES}
    work["t4"] = partial(tasks.crash, str(tmp_path), "t4")
    work["t7"] = partial(tasks.fail, str(tmp_path), "t7")
    answers = list(two_workers.run_all(work))
    assert Counter(name for name, _ in answers) == Counter(NAMES)
    aside = {name: answer.failed for name, answer in answers if answer.failed}
    assert set(aside) == {"t4", "t7"}
    assert "SIGABRT" in aside["t4"]
    assert aside["t7"] == "not this one"
    assert tasks.times(tmp_path) == {n: MAX_ATTEMPTS if n in aside else 1 for n in NAMES}


def test_tasks_of_a_killed_worker_are_repeated(two_workers, tmp_path):
    work = {name: partial(tasks.note, str(tmp_path), name, 0.1) for name in NAMES}
    done: Counter[str] = Counter()
    for name, answer in two_workers.run_all(work):
        assert not answer.failed
        done[name] += 1
        if len(done) in (2, 5):
            # The scheduler may not have noticed the exit of the worker killed before.
            workers = two_workers._client.run(os.getpid, on_error="ignore")
            os.kill(min(workers.values()), signal.SIGKILL)
    assert done == Counter(NAMES)
    assert set(tasks.times(tmp_path)) == set(NAMES)


def test_command_after_a_killed_scheduler_completes_the_rest(parts, tmp_path):
    dataset = Dataset(str(parts / "*.parquet"), tmp_path / "out", WORK)
    executor = DaskExecutor("local:1")
    try:
        with pytest.raises(InconclusiveError, match="then run the same command again"):
            dataset.complete(executor, quiet(), lambda: executor._cluster.close(timeout=60))
    finally:
        executor.close()
    dataset_after = Dataset(str(parts / "*.parquet"), tmp_path / "out", WORK)
    done_before = len(dataset_after.done)
    summary = dataset_after.complete(Executor(), quiet())
    assert 1 <= done_before == summary.parts_done - summary.fresh < summary.parts_done == 6


def test_files_of_workers_equal_those_of_one_process(two_workers, parts, tmp_path):
    for name, executor in (("alone", Executor()), ("spread", two_workers)):
        summary = Dataset(str(parts), tmp_path / name, WORK).complete(executor, quiet())
        assert summary.parts_done == summary.fresh == 6
    assert read_parts(tmp_path / "spread") == read_parts(tmp_path / "alone")


def test_crash_sets_aside_a_single_part(two_workers, parts, tmp_path):
    dataset = Dataset(str(parts), tmp_path / "out", tasks.CrashingPart("optimal:half-perimeter"))
    summary = dataset.complete(two_workers, quiet())
    ((which, why),) = summary.set_aside.items()
    assert which.endswith("0.parquet, rows 40 to 79")
    assert "crashed: SIGSEGV" in why
    assert read_ids(tmp_path / "out") == [n for n in range(EVERY) if not 40 <= n < 80]


def test_a_worker_with_other_code_refuses_the_work(two_workers, parts, tmp_path, monkeypatch):
    monkeypatch.setattr("harness.machine.environment.hash_code", lambda: "0" * 16)
    dataset = Dataset(str(parts / "0.parquet"), tmp_path / "out", WORK)
    summary = dataset.complete(two_workers, quiet())
    assert len(summary.set_aside) == 3
    assert all("another version of raster-harness" in why for why in summary.set_aside.values())


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("nonsense", "error: --dask nonsense: give .*"),
        ("local:0", "error: --dask local:0: give .*"),
        ("local", r'error: --dask needs Dask: \S+ -m pip install .*\[dask\]"'),
    ],
)
def test_a_wrong_address_or_a_missing_package_is_one_line(
    harness, parts, monkeypatch, address, message
):
    if address == "local":
        monkeypatch.setitem(sys.modules, "distributed", None)
    code, _, error = harness("triangulate", f"{parts}/*.parquet", "-o", "out", "--dask", address)
    assert code == 2
    assert re.fullmatch(f"{message}\n", error)


STOPPED_AT_ONCE = """
import os, signal, sys
import distributed.deploy.local
from harness.cli import main

class Stopped(distributed.Nanny):
    def __init__(self, *arguments, **options):
        os.kill(os.getpid(), signal.SIGTERM)  # before its process has started
        super().__init__(*arguments, **options)

distributed.deploy.local.Nanny = Stopped
sys.argv = ["harness", "triangulate", "in", "-o", "out", "--dask", "local:1"]
if __name__ == "__main__":
    main()
"""


def test_cluster_stopped_during_start_exits_cleanly(tmp_path):
    (tmp_path / "in").mkdir()
    for name, size in (("a", 4), ("b", 5)):
        text = f"POLYGON ((0 0, {size} 0, {size} 4, 0 4, 0 0))\n"
        (tmp_path / "in" / f"{name}.wkt").write_text(text)
    (tmp_path / "stopped.py").write_text(STOPPED_AT_ONCE)
    done = run_python("stopped.py", cwd=tmp_path)
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith("stopped")


def test_cluster_is_not_reachable_from_other_machines(two_workers):
    """Dashboard, scheduler and workers listen on the loopback interface only."""
    assert two_workers.dashboard.startswith("http://127.0.0.1:")
    process = psutil.Process()
    open_at = {
        connection.laddr.ip
        for member in [process, *process.children(recursive=True)]
        for connection in member.net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN
    }
    assert open_at == {"127.0.0.1"}


def test_number_of_queued_tasks_is_bounded(two_workers, tmp_path, monkeypatch):
    submit = Mock(wraps=two_workers._client.submit)
    monkeypatch.setattr(two_workers._client, "submit", submit)
    work = {name: partial(tasks.note, str(tmp_path), name) for name in NAMES}
    for ended, _ in enumerate(two_workers.run_all(work)):
        assert submit.call_count <= ended + (1 + QUEUED_TASKS) * 2
    assert submit.call_count == len(NAMES)


@pytest.mark.parametrize("times", [0, MAX_ATTEMPTS - 1, MAX_ATTEMPTS])
def test_failed_task_is_repeated(times):
    task = Mock(side_effect=[UsageError("no space")] * times + ["done"])
    ((name, answer),) = Executor().run_all({"a": task})
    assert (name, *answer) == ("a", *(("done", "") if times < MAX_ATTEMPTS else (None, "no space")))


def test_exception_in_this_process_is_raised():
    with pytest.raises(ZeroDivisionError):
        list(Executor().run_all({"a": partial(divmod, 1, 0)}))
