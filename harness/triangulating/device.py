"""The device that triangulates, as the command line names it."""

from __future__ import annotations

from harness.progress import Reporter
from triangulators import measure_device
from triangulators.devices import CPU, check_name
from triangulators.gpu.device_context import DeviceFailed


def get_ready(device: str, reporter: Reporter) -> str:
    """Return the device, opened, and measured against the CPU if it never was; "cpu" if it fails.

    Raises
    ------
    triangulators.UnknownName
        if no machine has a device of that name
    """
    check_name(device)
    if device == CPU:
        return CPU
    try:
        with reporter.if_long(f"measuring {device} against the CPU, once ...", 1.0):
            measure_device(device)
    except DeviceFailed as error:
        reporter.warn(f"{error}; the CPU does all")
        return CPU
    return device
