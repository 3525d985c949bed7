"""Whatever becomes of a file of any format, no polygon is lost in silence."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from tests.fuzz.damage import PLACE, byte_edit, edit_bytes
from tests.fuzz.target import target
from tests.scenes.whole_files import KINDS, outcome, whole


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
