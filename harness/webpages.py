"""Building blocks of self-contained HTML pages: templates, static files, embedded data, output."""

from __future__ import annotations

import base64
import gzip
import json
import os
from collections.abc import Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness import atomic

if TYPE_CHECKING:
    from jinja2 import Template


def read_static(package: str, name: str) -> str:
    """Return the text of a file in a package's folder static/."""
    return (resources.files(package) / "static" / name).read_text(encoding="utf-8")


def pack_json(content: Mapping[str, Any]) -> str:
    """Return the content as base64 of compressed JSON, which is safe inside HTML."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode("ascii")


def encode_array(values: NDArray[Any]) -> str:
    """Return the bytes of an array, in C order, as base64."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


def is_stream(file: Path) -> bool:
    """Return whether `file` is a pipe or this program's standard output."""
    try:
        return file.is_fifo() or os.path.samestat(file.stat(), os.fstat(1))
    except OSError:
        return False


def write_atomically(file: Path, text: str) -> None:
    """Replace `file` atomically; write directly into a pipe or standard output."""
    if is_stream(file):
        file.write_bytes(text.encode())
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    atomic.write(file, text.encode())


@cache
def load_template(package: str, name: str) -> Template:
    """Return a template of `package`; values are escaped, undefined names are errors."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # slow to import

    environment = Environment(
        loader=PackageLoader(package),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    return environment.get_template(name)
