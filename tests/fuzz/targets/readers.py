"""Whatever bytes a file holds, its reader gives sound polygons or one clear line."""

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from tests.fuzz.damage import PLACE, byte_edit, edit_bytes
from tests.fuzz.target import target
from tests.scenes.samples import (
    KINDS,
    NAMES,
    damaged,
    outcome,
    packed,
    sound_or_refused,
    unpacked,
    whole,
)


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


def spoilt(data: bytes, edits: list[dict[str, Any]]) -> bytes:
    """The bytes with some changed, removed or doubled."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "file")
        file.write_bytes(data)
        edit_bytes(file, edits)
        return file.read_bytes()


kind = st.sampled_from(KINDS)


@target("cut-file", st.fixed_dictionaries({"kind": kind, "place": PLACE}))
def check_cut(value: dict[str, Any]) -> None:
    data = whole(value["kind"])[f"a.{value['kind']}"]
    length = value["place"] % len(data)
    outcome(value["kind"], data[:length], length)


edits = st.lists(byte_edit, min_size=1, max_size=6)


@target("spoilt-file", st.fixed_dictionaries({"kind": kind, "edits": edits}))
def check_spoilt(value: dict[str, Any]) -> None:
    data = whole(value["kind"])[f"a.{value['kind']}"]
    outcome(value["kind"], spoilt(data, value["edits"]))
