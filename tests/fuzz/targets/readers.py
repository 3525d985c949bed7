"""Readers of random files: valid polygons or a single error line."""

import tempfile
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from tests.fuzz.damage import POSITION, apply_byte_edits, byte_edits
from tests.fuzz.target import target
from tests.scenes.samples import KINDS, load_or_refuse, make_files, outcome

kind = st.sampled_from(KINDS)


@target("svg-path-data", st.text(alphabet="MmLlHhVvCcQqAaSsTtZz0123456789.,- e", max_size=60))
def check_path_data(data: str) -> None:
    """Read path data of random letters and numbers."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.svg")
        path.write_text(f'<svg><path d="{data}"/></svg>')
        load_or_refuse(path)


@target("truncated-file", st.fixed_dictionaries({"kind": kind, "position": POSITION}))
def check_truncated(value: dict[str, Any]) -> None:
    data = make_files(value["kind"])[f"a.{value['kind']}"]
    length = value["position"] % len(data)
    outcome(value["kind"], data[:length], length)


edits = st.lists(byte_edits, min_size=1, max_size=6)


@target("damaged-file", st.fixed_dictionaries({"kind": kind, "edits": edits}))
def check_damaged(value: dict[str, Any]) -> None:
    data = make_files(value["kind"])[f"a.{value['kind']}"]
    outcome(value["kind"], apply_byte_edits(data, value["edits"]))
