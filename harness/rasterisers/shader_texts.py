"""The shaders' texts, in GLSL and WGSL."""

from __future__ import annotations

from functools import cache
from importlib.resources import files


@cache
def shader(name: str) -> str:
    """Return the text of a file in shaders/, e.g. "draw.wgsl"."""
    return files("harness.rasterisers").joinpath("shaders", name).read_text(encoding="utf-8")
