"""One plan on many devices of many hosts: each device measures all of it; one run is made of that.

A worker offers devices as Dask's resources: `dask worker ADDRESS --resources "llvmpipe=1"`. A task
is a run on one device, in a folder of its own, with the usual resuming; the folders are merged.
"""

from __future__ import annotations

import io
import shutil
import socket
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from harness.compare.matching import latest
from harness.errors import UsageError
from harness.machine import environment, system
from harness.measuring.plan import Plan
from harness.measuring.run import RunOptions, RunResult, run
from harness.measuring.tasks import Survey, survey
from harness.measuring.worker import Worker
from harness.progress import Reporter
from harness.scaling import merging
from harness.scaling.cluster import DaskCrew
from harness.scaling.part_files import require_code
from harness.scaling.task_queue import work_through
from harness.stored import drawings
from harness.stored.folder import CASES, POLYGONS, clear_errors, file_stem, read_run

HOSTS = "hosts"
"""Folder of what each host measured, in the run's folder."""

CPU = "cpu"
"""All devices that are software share it, so that they do not disturb each other."""


def measure(
    plan: Plan, out: Path, where: str, reporter: Reporter
) -> tuple[RunResult, dict[str, str]]:
    """Measure a plan on all devices that the workers at `where` offer, and merge what they found.

    Returns the run, and the devices that were set aside, by host, with the reasons.

    Raises
    ------
    UsageError
        if no worker offers a device of the plan, or hosts count differently
    """
    offered: dict[str, tuple[str, list[str]]] = {}

    def place(name: str) -> dict[str, Any]:
        device, workers = offered[name]
        return {"workers": workers, "resources": {device: 1}}

    code = environment.code_version()
    crew = DaskCrew(where, reporter, place)
    try:
        for (host, device), workers in _wanted(plan, crew).items():
            offered[f"{device} of {host}"] = device, workers
        tasks = {
            name: (measure_device, (plan.to_json(), device, str(out), code))
            for name, (device, _) in offered.items()
        }
        runs: dict[Path, str] = {}
        with reporter.parts("measuring", len(tasks), len(tasks), "devices") as show:

            def done(_: str, found: tuple[str, str, bytes]) -> None:
                host, name, content = found
                _unpack(content, out / HOSTS / name)
                runs[out / HOSTS / name] = host
                show(len(runs), len(runs))

            aside = work_through(tasks, crew, done)
    finally:
        crew.close()
    if not runs:
        raise UsageError(f"no device measured anything: {next(iter(aside.values()))}")
    _merge(out, runs)
    return RunResult(out, read_run(out).records, interrupted=False), aside


def measure_device(
    plan: Mapping[str, Any], device: str, out: str, code: str
) -> tuple[str, str, bytes]:
    """Measure a plan on a device of this host; returns the host, its run's name and its archive.

    Raises
    ------
    UsageError
        if no rasteriser of the plan has the device, or this host has other code
    """
    require_code(code)
    whole = Plan.from_json(plan)
    able = [name for name in whole.rasterisers if _knows(name, device)]
    if not able:
        raise UsageError(f"no rasteriser of this run has the device '{device}'")
    host = file_stem(socket.gethostname())
    name = f"{host}-{file_stem(device)}"
    folder = Path(out) / HOSTS / name
    with _alone(device):
        resume = (folder / "run.json").exists()
        own = replace(whole, rasterisers=tuple(able), devices=(device,))
        run(own, folder, Reporter(quiet=True), RunOptions(resume=resume))
    return host, name, _packed(folder)


def _knows(rasteriser: str, device: str) -> bool:
    """Whether a rasteriser, which may be a third party's, can draw on a device of this host."""
    with Worker(f"rasteriser {rasteriser}") as apart:
        found: Survey = apart.call(survey, rasteriser, (), (device,))
    return device in found.known


def _wanted(plan: Plan, crew: DaskCrew) -> dict[tuple[str, str], list[str]]:
    """Return by host and device the workers that offer what the plan wants."""
    offers = crew.offers()
    found = {at: who for at, who in offers.items() if not plan.devices or at[1] in plan.devices}
    if not found:
        offered = sorted({device for _, device in offers})
        raise UsageError(
            "no worker offers a device of this run"
            + (f" (offered: {', '.join(offered)})" if offered else "")
            + '; start workers with e.g. --resources "llvmpipe=1"'
        )
    return found


class _alone:  # noqa: N801 - used as a function
    """Holds a lock file, so that nothing else of ours measures on the device meanwhile."""

    def __init__(self, device: str) -> None:
        # a GPU has its own clock; what software draws shares the cores
        name = device if device.startswith("gpu") else CPU
        # In a folder of the user's, where nobody else can have put a file of that name; hosts may
        # share the folder, but not their devices.
        host = file_stem(socket.gethostname())
        self._path = system.cache_file(f"{host}-{file_stem(name)}.lock")

    def __enter__(self) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._stream = self._path.open("a")
        system.lock(self._stream)

    def __exit__(self, *_: object) -> None:
        self._stream.close()


def _packed(folder: Path) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                archive.write(file, file.relative_to(folder).as_posix())
    return content.getvalue()


def _unpack(content: bytes, folder: Path) -> None:
    """Put a host's run into the folder here, where the host does not write to it itself."""
    if (folder / CASES).exists():
        return
    with clear_errors(folder), zipfile.ZipFile(io.BytesIO(content)) as archive:
        archive.extractall(folder)


def _merge(out: Path, runs: Mapping[Path, str]) -> None:
    """Make the run of what the hosts measured; one that is there was made of fewer of them."""
    found = [merging.on_host(latest(read_run(path)), host) for path, host in runs.items()]
    with clear_errors(out):
        for file in ("run.json", CASES):
            (out / file).unlink(missing_ok=True)
        for folder in (POLYGONS, drawings.FOLDER):
            shutil.rmtree(out / folder, ignore_errors=True)
    merging.merge(found, out)
