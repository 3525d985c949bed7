"""One plan on many devices of many hosts: each device measures all of it; one run is made of that.

A worker offers devices as Dask's resources: `dask worker ADDRESS --resources "llvmpipe=1"`. A task
is one device and a group of cases that are timed together. It makes a run folder of its own, with
the usual resuming; the folders are merged.
"""

from __future__ import annotations

import getpass
import hashlib
import io
import json
import shutil
import socket
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.compare.matching import latest
from harness.errors import UsageError
from harness.machine import environment, system
from harness.measuring.plan import Plan
from harness.measuring.run import RunResult, run
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


@dataclass(frozen=True)
class Group:
    """Cases that are timed together, on one device of one host.

    workers : addresses of the workers there that offer the device
    plan : what is to be measured, of one rasteriser, device, view and option
    """

    host: str
    device: str
    workers: tuple[str, ...]
    plan: Plan

    @property
    def name(self) -> str:
        """Name of the group's folder: the host, the device and a digest of the plan."""
        content = json.dumps(self.plan.to_json(), sort_keys=True)
        digest = hashlib.sha256(content.encode()).hexdigest()[:16]
        return f"{self.host}-{file_stem(self.device)}-{digest}"


def measure(
    plan: Plan, out: Path, where: str, reporter: Reporter
) -> tuple[RunResult, dict[str, str]]:
    """Measure a plan on all devices that the workers at `where` offer, and merge what they found.

    Returns the run, and the groups that were set aside with the reasons.

    Raises
    ------
    UsageError
        if no worker offers a device of the plan, or hosts count differently
    """
    groups: dict[str, Group] = {}

    def place(name: str) -> dict[str, Any]:
        if name not in groups:
            return {"workers": [name.partition(" ")[2]], "allow_other_workers": False}
        group = groups[name]
        return {"workers": list(group.workers), "resources": {group.device: 1}}

    code = environment.code_version()
    crew = DaskCrew(where, reporter, place)
    try:
        groups.update({group.name: group for group in _groups(plan, crew, code, reporter)})
        tasks = {
            name: (measure_group, (group.plan.to_json(), group.device, str(out), name, code))
            for name, group in groups.items()
        }
        with reporter.parts("measuring", len(tasks), len(tasks), "groups") as show:
            ended: list[str] = []

            def done(name: str, content: bytes) -> None:
                _unpack(content, out / HOSTS / name)
                ended.append(name)
                show(len(ended), len(ended))

            aside = work_through(tasks, crew, done)
    finally:
        crew.close()
    if not ended:
        raise UsageError(f"no device measured anything: {next(iter(aside.values()))}")
    _merge(out, [groups[name] for name in ended])
    return RunResult(out, read_run(out).records, interrupted=False), aside


def measure_group(plan: Mapping[str, Any], device: str, out: str, name: str, code: str) -> bytes:
    """Measure a group on this host; returns its run folder as an archive."""
    require_code(code)
    folder = Path(out) / HOSTS / name
    with _alone(device):
        resume = (folder / "run.json").exists()
        run(Plan.from_json(plan), folder, Reporter(quiet=True), resume=resume)
    return _packed(folder)


def survey_host(rasterisers: tuple[str, ...], devices: tuple[str, ...], code: str) -> Any:
    """Return this host's name, and for each device the rasterisers that can be used with it."""
    require_code(code)
    usable = []
    for name in rasterisers:
        with Worker(f"rasteriser {name}") as apart:
            found: Survey = apart.call(survey, name, (), devices)
        usable += [(device, name) for device in devices if device in found.known]
    return socket.gethostname(), usable


def _groups(plan: Plan, crew: DaskCrew, code: str, reporter: Reporter) -> list[Group]:
    """Ask each worker that offers devices what it can do, and spell out the groups."""
    offers = crew.offers()
    tasks = {}
    for address, names in offers.items():
        wanted = tuple(name for name in names if not plan.devices or name in plan.devices)
        if wanted:
            tasks[f"survey {address}"] = (survey_host, (plan.rasterisers, wanted, code))
    if not tasks:
        offered = sorted({name for names in offers.values() for name in names})
        raise UsageError(
            "no worker offers a device of this run"
            + (f" (offered: {', '.join(offered)})" if offered else "")
            + '; start workers with e.g. --resources "llvmpipe=1"'
        )
    found: dict[tuple[str, str, str], list[str]] = {}

    def done(name: str, answer: tuple[str, list[tuple[str, str]]]) -> None:
        host, usable = answer
        for device, rasteriser in usable:
            key = (file_stem(host), device, rasteriser)
            found.setdefault(key, []).append(name.partition(" ")[2])

    for name, why in work_through(tasks, crew, done).items():
        reporter.warn(f"worker {name.partition(' ')[2]} is left out: {why}")
    if not found:
        raise UsageError("no rasteriser of this run has a device that the workers offer")
    return [
        Group(
            host,
            device,
            tuple(sorted(workers)),
            replace(
                plan, rasterisers=(name,), devices=(device,), views=(view,), options=(options,)
            ),
        )
        for (host, device, name), workers in sorted(found.items())
        for view in plan.views
        for options in plan.options
    ]


class _alone:  # noqa: N801 - used as a function
    """Holds a lock file, so that nothing else of ours measures on the device meanwhile."""

    def __init__(self, device: str) -> None:
        # a GPU has its own clock; what software draws shares the cores
        name = device if device.startswith("gpu") else CPU
        # Of this user: another one's file cannot be opened.
        stem = f"raster-harness-{file_stem(getpass.getuser())}-{file_stem(name)}"
        self._path = Path(tempfile.gettempdir()) / f"{stem}.lock"

    def __enter__(self) -> None:
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


def _merge(out: Path, groups: list[Group]) -> None:
    """Make the run of what the hosts measured; one that is there was made of fewer of them."""
    runs = [
        merging.on_host(latest(read_run(out / HOSTS / group.name)), group.host) for group in groups
    ]
    with clear_errors(out):
        for file in ("run.json", CASES):
            (out / file).unlink(missing_ok=True)
        for folder in (POLYGONS, drawings.FOLDER):
            shutil.rmtree(out / folder, ignore_errors=True)
    merging.merge(runs, out)
