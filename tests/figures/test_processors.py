"""Which devices the processor draws on, whose times are kept apart by processor."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.figures.processors import of_cpu
from harness.stored.folder import Run


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
