"""A sound file of each format, ways to damage one, and what its reader owes the user then."""

from __future__ import annotations

import base64
import tempfile
import zlib
from functools import cache
from pathlib import Path

from hypothesis import strategies as st

from scenes import Scene, SceneError, load
from tests.scenes.conftest import assert_sound

NAMES = (
    *("a.geojson", "a.gpkg", "a.fgb", "a.parquet", "a.wkt", "a.wkb", "a.svg"),
    *("a.city.json", "a.obj", "a.ply", "ascii.ply"),
)

SVG = (
    '<svg><g transform="scale(2)"><path d="M0 0h10v10h-10z M2 2h4v4h-4z"/><circle r="4"/></g></svg>'
)


@cache
def sample(name: str) -> bytes:
    """The bytes of a sound file, the same on every call."""
    from tests.scenes.test_files import write as write_vector
    from tests.scenes.test_readers import FACES, GABLE, HOLED, cityjson, geoparquet, ply

    makers = {
        "a.parquet": lambda path: geoparquet(path, [HOLED, None], h=[1.0, 2.0]),
        "a.wkt": lambda path: path.write_text(f"{HOLED.wkt}\n{HOLED.wkb_hex}\n"),
        "a.wkb": lambda path: path.write_bytes(HOLED.wkb),
        "a.svg": lambda path: path.write_text(SVG),
        "a.city.json": lambda path: path.write_text(cityjson()),
        "a.obj": lambda path: path.write_text(GABLE + "".join(f"f {face}\n" for face in FACES)),
        "a.ply": lambda path: path.write_bytes(ply("binary_little_endian")),
        "ascii.ply": lambda path: path.write_bytes(ply("ascii")),
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        makers.get(name, write_vector)(path)
        return path.read_bytes()


@st.composite
def damaged(draw: st.DrawFn, name: str) -> bytes:
    """The sample with bytes changed, pieces removed or doubled, and the end cut off, or some."""
    data = bytearray(sample(name))
    byte = st.sampled_from([0, 1, 0x7F, 0x80, 0xFF]) | st.integers(0, 255)
    for _ in range(draw(st.integers(0, 6))):
        data[draw(st.integers(0, len(data) - 1))] = draw(byte)
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, len(data) - 1))
        piece = data[at : at + draw(st.integers(1, 40))]
        data[at : at + len(piece)] = piece * draw(st.sampled_from([0, 2, 3]))
        if not data:
            return b""
    if draw(st.integers(0, 9)) < 3:
        del data[draw(st.integers(0, len(data))) :]
    return bytes(data)


def packed(data: bytes) -> str:
    """Bytes as text that JSON can hold."""
    return base64.b64encode(zlib.compress(data, 9)).decode()


def unpacked(text: str) -> bytes:
    """Undo `packed`."""
    return zlib.decompress(base64.b64decode(text))


def sound_or_refused(path: Path) -> Scene | None:
    """Load a file that may hold anything: sound polygons, or one clear line that names it."""
    try:
        scene = load(path)
    except SceneError as error:
        refusal = str(error)
        assert "\n" not in refusal
        assert path.name in refusal
        return None
    assert_sound(scene.polygons)
    if scene.attributes is not None:
        # some libraries look at the bytes of a text only when they are asked for it
        assert scene.attributes.to_csv()
    return scene
