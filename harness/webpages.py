"""Parts of self-contained HTML pages: templates, static files, packed data."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Template
    from numpy.typing import NDArray


def read_static(package: str, name: str) -> str:
    """Return the text of a file in a package's folder static/."""
    return (resources.files(package) / "static" / name).read_text(encoding="utf-8")


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


def pack_json(content: Mapping[str, Any]) -> str:
    """Return the content as base64 of compressed JSON, which is safe inside HTML."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode("ascii")


def encode_array(values: NDArray[Any]) -> str:
    """Return the bytes of an array, in C order, as base64."""
    return base64.b64encode(values.tobytes()).decode("ascii")
