"""Map tiles and models with damage at random: read or refused in a line, and soon."""

from __future__ import annotations

import copy
import json
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import UsageError
from harness.models.in_place import retriangulate
from harness.models.seen import read
from scenes import SceneError, load
from scenes.slices import Chosen, cut_tiles, read_tiles
from scenes.tiles.archives import Place, PMTiles
from scenes.tiles.read import FILE
from tests.models.various import MODELS
from tests.scenes.test_tiles import Compression, three_archives

MOST_S = 10.0
"""Processor time of one input, most of which take some milliseconds."""

HOSTILE: tuple[Any, ...] = (
    *(-1, 0, 1, 2**31, 2**63, 10**30, -0.5, 1e308, True, None),
    *("", "x", "../x", "\0", [], {}, [-1], [[]], {"a": 1}, "SCALAR", "VEC2"),
)


def spoilt(data: bytes, chance: np.random.Generator) -> bytes:
    """Bytes changed, cut off, said twice, or large numbers put in."""
    made = bytearray(data)
    for _ in range(chance.integers(1, 5)):
        place = int(chance.integers(0, len(made)))
        kind = chance.integers(0, 4)
        if kind == 0:
            made[place] = int(chance.integers(0, 256))
        elif kind == 1:
            del made[place : place + int(chance.integers(1, 64))]
        elif kind == 2:
            made[place:place] = made[place : place + int(chance.integers(1, 64))]
        else:
            made[place : place + 9] = b"\xff" * 9
        made = made or bytearray(b"\0")
    return bytes(made)


def spoilt_json(told: Any, chance: np.random.Generator) -> Any:
    """A value somewhere in it is another one."""
    made = copy.deepcopy(told)
    for _ in range(chance.integers(1, 4)):
        at = made
        while True:
            keys = list(at) if isinstance(at, dict) else range(len(at))
            key = keys[int(chance.integers(0, len(keys)))]
            if isinstance(at[key], (dict, list)) and at[key] and chance.random() < 0.9:
                at = at[key]
                continue
            at[key] = HOSTILE[int(chance.integers(0, len(HOSTILE)))]
            break
    return made


def require_a_clear_end(call: Any) -> bool:
    """Whether it came to an answer; what is refused is so in one line."""
    begun, said = time.process_time(), None
    try:
        call()
    except (SceneError, UsageError) as error:
        said = str(error)
    assert said is None or (said and "\n" not in said)
    assert time.process_time() - begun < MOST_S
    return said is None


@pytest.mark.parametrize("kind", ["tile", "pmtiles", "mbtiles"])
def test_tiles(kind, times, tell, tmp_path: Path):
    tiles = PMTiles(FILE)
    names = tiles.names(16)[:3]
    content = {name: tiles.read(name) or b"" for name in names}
    whole = three_archives(tmp_path, content, Compression.NONE)
    data = content[names[0]] if kind == "tile" else Path(whole[kind]).read_bytes()
    suffix = ".mvt" if kind == "tile" else f".{kind}"
    chance, read_whole = np.random.default_rng(len(kind)), 0
    count = times(20_000)
    for number in range(count):
        file = tmp_path / f"{number}{suffix}"
        file.write_bytes(spoilt(data, chance))
        read_whole += require_a_clear_end(lambda f=file: load(f"{f}:pixels=512"))
        require_a_clear_end(lambda f=file: _census(f))
        file.unlink()
    tell({"inputs": count, "read": read_whole})
    assert 0 < read_whole < count


def _census(file: Path) -> None:
    for rows in cut_tiles(str(file), None).rows:
        assert rows is not None
        for tile in read_tiles(str(file), rows, Chosen()):
            assert isinstance(tile.name, str | Place)


@pytest.mark.parametrize("name", ["plain.glb", "textured.glb", "morphed.glb", "strip.glb"])
@pytest.mark.parametrize("what", ["json", "bytes"])
def test_models(name, what, times, tell, tmp_path: Path):
    data = MODELS[name](tmp_path / name).read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    told, rest = json.loads(data[20 : 20 + size]), data[20 + size :]
    chance, done = np.random.default_rng(len(name)), 0
    count = times(4_000)
    for number in range(count):
        source = tmp_path / f"{number}.glb"
        if what == "json":
            text = json.dumps(spoilt_json(told, chance)).encode()
            text += b" " * (-len(text) % 4)
            head = struct.pack(
                "<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON"
            )
            source.write_bytes(head + text + rest)
        else:
            source.write_bytes(spoilt(data, chance))
        done += require_a_clear_end(lambda s=source: retriangulate(s, None))
        require_a_clear_end(lambda s=source: read(str(s), views=4, pixels=64))
        source.unlink()
    tell({"inputs": count, "read": done})
    assert done < count
