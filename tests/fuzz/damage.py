"""Damage to the files of a run: to the JSON values in them, and to their bytes."""

import copy
import json
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-3, 10**9)
    | st.floats()
    | st.sampled_from([2**63, -1e308, "", "ok", "../x", "\u2028", "\ud800"])
    | st.text(max_size=4),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=4,
)
PLACE = st.integers(0, 10**6)

value_edit = st.fixed_dictionaries(
    {
        "line": st.integers(0, 5),
        "place": PLACE,
        "do": st.sampled_from(["set", "set", "set", "remove", "swap"]),
        "value": JSON,
    }
)
byte_edit = st.fixed_dictionaries(
    {
        "place": PLACE,
        "do": st.sampled_from(["flip", "set", "drop", "double", "end"]),
        "length": st.integers(1, 60),
    }
)


def edit_values(file: Path, edits: list[dict[str, Any]]) -> None:
    """Change values in a JSON file, or in one of lines of JSON."""
    lines = file.suffix == ".jsonl"
    text = file.read_text()
    documents = [json.loads(part) for part in (text.splitlines() if lines else [text])]
    for edit in edits:
        number = edit["line"] % len(documents)
        documents[number] = _edited(documents[number], edit)
    file.write_text("".join(json.dumps(document) + "\n" for document in documents))


def _edited(document: Any, edit: dict[str, Any]) -> Any:
    paths = list(_paths(document))
    if not paths:
        return edit["value"]
    *way, last = paths[edit["place"] % len(paths)]
    changed = copy.deepcopy(document)
    holder = changed
    for step in way:
        holder = holder[step]
    if edit["do"] == "set":
        holder[last] = edit["value"]
    elif edit["do"] == "remove":
        del holder[last]
    else:  # a value that is right in another place
        source: Any = document
        for step in paths[(edit["place"] * 7 + 1) % len(paths)]:
            source = source[step]
        holder[last] = copy.deepcopy(source)
    return changed


def _paths(document: Any, way: tuple[Any, ...] = ()) -> Any:
    """Yield the way to every value in a document, tables and lists themselves too."""
    if way:
        yield way
    if isinstance(document, dict):
        for key, value in document.items():
            yield from _paths(value, (*way, key))
    elif isinstance(document, list):
        for index, value in enumerate(document[:3]):  # samples are all alike
            yield from _paths(value, (*way, index))


def edited(given: bytes, edits: list[dict[str, Any]]) -> bytes:
    """Flip a bit, set a byte, drop or double a piece, or cut off the end."""
    data = bytearray(given)
    for edit in edits:
        if not data:
            break
        place = edit["place"] % len(data)
        piece = data[place : place + edit["length"]]
        if edit["do"] == "flip":
            data[place] ^= 1 << edit["length"] % 8
        elif edit["do"] == "set":
            data[place] = (0, 1, 0x7F, 0x80, 0xFF)[edit["length"] % 5]
        elif edit["do"] == "drop":
            del data[place : place + edit["length"]]
        elif edit["do"] == "double":
            data[place:place] = piece
        else:
            del data[place:]
    return bytes(data)


def edit_bytes(file: Path, edits: list[dict[str, Any]]) -> None:
    """Do that to a file."""
    file.write_bytes(edited(file.read_bytes(), edits))
