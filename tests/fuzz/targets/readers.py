"""Whatever bytes a file holds, its reader gives sound polygons or one clear line."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path

from hypothesis import strategies as st

from tests.fuzz.target import target
from tests.scenes.samples import NAMES, damaged, packed, sound_or_refused, unpacked


def _read(name: str, text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_bytes(unpacked(text))
        sound_or_refused(path)


for _name in NAMES:
    target(f"damaged-{_name}", damaged(_name).map(packed))(partial(_read, _name))

_PATH_DATA = st.text(alphabet="MmLlHhVvCcQqAaSsTtZz0123456789.,- e", max_size=60)


@target("svg-path-data", _PATH_DATA)
def any_path_data(data: str) -> None:
    """Path data of random letters and numbers."""
    _read("a.svg", packed(f'<svg><path d="{data}"/></svg>'.encode()))
