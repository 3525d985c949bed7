"""Whatever bytes a file holds, its reader gives sound polygons or one clear line."""

import tempfile
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from tests.fuzz.damage import PLACE, byte_edit, edited
from tests.fuzz.target import target
from tests.scenes.samples import KINDS, load_or_refuse, outcome, whole

kind = st.sampled_from(KINDS)


@target("svg-path-data", st.text(alphabet="MmLlHhVvCcQqAaSsTtZz0123456789.,- e", max_size=60))
def any_path_data(data: str) -> None:
    """Path data of random letters and numbers."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.svg")
        path.write_text(f'<svg><path d="{data}"/></svg>')
        load_or_refuse(path)


@target("cut-file", st.fixed_dictionaries({"kind": kind, "place": PLACE}))
def check_cut(value: dict[str, Any]) -> None:
    data = whole(value["kind"])[f"a.{value['kind']}"]
    length = value["place"] % len(data)
    outcome(value["kind"], data[:length], length)


edits = st.lists(byte_edit, min_size=1, max_size=6)


@target("spoilt-file", st.fixed_dictionaries({"kind": kind, "edits": edits}))
def check_spoilt(value: dict[str, Any]) -> None:
    data = whole(value["kind"])[f"a.{value['kind']}"]
    outcome(value["kind"], edited(data, value["edits"]))
