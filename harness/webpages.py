"""What HTML pages are made with: templates, and one file with everything in it."""

from __future__ import annotations

import base64
import gzip
import json
import os
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness import atomic

if TYPE_CHECKING:
    from jinja2 import Template


def static(package: str, name: str) -> str:
    """Return the text of a file in a package's folder static/."""
    return (resources.files(package) / "static" / name).read_text(encoding="utf-8")


def packed(content: dict[str, Any]) -> str:
    """Return the content as base64 of compressed JSON, which no HTML parser can misread."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode("ascii")


def encoded(values: NDArray[Any]) -> str:
    """Return base64 of an array's bytes."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


def is_stream(file: Path) -> bool:
    """Return whether `file` is a pipe or this program's standard output, to be written into."""
    try:
        return file.is_fifo() or os.path.samestat(file.stat(), os.fstat(1))
    except OSError:
        return False


def write_whole(file: Path, text: str) -> None:
    """Write `file` whole or not at all; a pipe and standard output are written into."""
    if is_stream(file):
        file.write_bytes(text.encode())
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    atomic.write(file, text.encode())


@cache
def template(package: str, name: str) -> Template:
    """Return the file `name` of the templates/ of `package`.

    What it shows is escaped, and what it names must be there.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined  # only where a page is written

    environment = Environment(
        loader=PackageLoader(package),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    return environment.get_template(name)
