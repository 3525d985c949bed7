"""Rasterisers paired with devices: what the cases of a plan run on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from harness import rasterisers
from harness.errors import NoRasteriser, UsageError
from harness.measuring.plan import Plan
from harness.measuring.processes import Backend, Bench
from harness.measuring.tasks import Survey, survey
from harness.measuring.worker import TaskFailed
from harness.progress import Reporter


@dataclass(frozen=True)
class Usable:
    """A backend and which of the plan's options it can draw with."""

    backend: Backend
    options: tuple[rasterisers.Options, ...]


def find_backends(plan: Plan, bench: Bench, reporter: Reporter) -> list[Usable]:
    """Pair each rasteriser with each of the plan's devices that it knows.

    One that knows none of them, such as the CPU reference, runs on its own best device. One of a
    third party that dies while it is asked is left out, with a warning.

    Raises
    ------
    UsageError, NoRasteriser
        if a name is unknown, or a device that was asked for is not here, or nothing is left
    """
    usable: list[Usable] = []
    known: set[str] = set()
    for name in plan.rasterisers:
        try:
            found = _ask(name, plan, bench)
        except TaskFailed as error:
            reporter.warn(f"rasteriser '{name}' is left out: {error}")
            continue
        if not found.options:
            raise UsageError(
                f"{name} has {rasterisers.get(name).lacking}: use opengl for "
                "--samples and --work, or add the plain case, e.g. --work 0,8"
            )
        known.update(found.known)
        usable += [Usable(Backend(name, device), found.options) for device in found.devices]
        if len(found.devices) == 1 and not found.devices[0].environment:
            bench.hand_over(_label(name), usable[-1].backend.label)
    _refuse_strange(plan, known)
    if not usable:
        raise NoRasteriser("no rasteriser is left that works")
    return usable


def _ask(name: str, plan: Plan, bench: Bench) -> Survey:
    """Ask a rasteriser what it can do here; a third party's only in a process of its own."""
    if name in rasterisers.BUILT_IN or (name not in rasterisers.names() and ":" not in name):
        return survey(name, plan.options, plan.devices)
    return bench.ask(_label(name), survey, name, plan.options, plan.devices)


def _label(name: str) -> str:
    return f"rasteriser {name}"


def _refuse_strange(plan: Plan, known: set[str]) -> None:
    strange: Sequence[str] = [device for device in plan.devices if device not in known]
    if strange:
        if plan.rasterisers[0] in rasterisers.BUILT_IN:
            rasterisers.find_device(plan.rasterisers[0], strange[0])  # raises, naming the nearest
        raise UsageError(f"no rasteriser of this run has a device '{strange[0]}'")
