"""Damage to the files of a run: edits of JSON values or bytes."""

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
POSITION = st.integers(0, 10**6)

value_edits = st.fixed_dictionaries(
    {
        "line": st.integers(0, 5),
        "position": POSITION,
        "action": st.sampled_from(["set", "set", "set", "remove", "swap"]),
        "value": JSON,
    }
)
byte_edits = st.fixed_dictionaries(
    {
        "position": POSITION,
        "action": st.sampled_from(["flip", "set", "drop", "double", "end"]),
        "length": st.integers(1, 60),
    }
)


def edit_file_values(file: Path, edits: list[dict[str, Any]]) -> None:
    lines = file.suffix == ".jsonl"
    text = file.read_text()
    documents = [json.loads(part) for part in (text.splitlines() if lines else [text])]
    for edit in edits:
        number = edit["line"] % len(documents)
        documents[number] = apply_value_edit(documents[number], edit)
    file.write_text("".join(json.dumps(document) + "\n" for document in documents))


def apply_value_edit(document: Any, edit: dict[str, Any]) -> Any:
    paths = list(iter_paths(document))
    if not paths:
        return edit["value"]
    *parents, last = paths[edit["position"] % len(paths)]
    changed = copy.deepcopy(document)
    parent = changed
    for step in parents:
        parent = parent[step]
    if edit["action"] == "set":
        parent[last] = edit["value"]
    elif edit["action"] == "remove":
        del parent[last]
    else:  # a valid value from another position
        source: Any = document
        for step in paths[(edit["position"] * 7 + 1) % len(paths)]:
            source = source[step]
        parent[last] = copy.deepcopy(source)
    return changed


def iter_paths(document: Any, path: tuple[Any, ...] = ()) -> Any:
    """Yield the path to every value in a document, including objects and arrays."""
    if path:
        yield path
    items: Any = ()
    if isinstance(document, dict):
        items = document.items()
    elif isinstance(document, list):
        items = enumerate(document[:3])  # further elements are similar
    for key, value in items:
        yield from iter_paths(value, (*path, key))


def apply_byte_edits(content: bytes, edits: list[dict[str, Any]]) -> bytes:
    """Return the bytes after edits: flip a bit, set a byte, drop or double a chunk, truncate."""
    data = bytearray(content)
    for edit in edits:
        if not data:
            break
        position = edit["position"] % len(data)
        chunk = data[position : position + edit["length"]]
        if edit["action"] == "flip":
            data[position] ^= 1 << edit["length"] % 8
        elif edit["action"] == "set":
            data[position] = (0, 1, 0x7F, 0x80, 0xFF)[edit["length"] % 5]
        elif edit["action"] == "drop":
            del data[position : position + edit["length"]]
        elif edit["action"] == "double":
            data[position:position] = chunk
        else:
            del data[position:]
    return bytes(data)


def edit_file_bytes(file: Path, edits: list[dict[str, Any]]) -> None:
    file.write_bytes(apply_byte_edits(file.read_bytes(), edits))
