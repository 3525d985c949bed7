"""ATTILA's driver on a stand-in that answers as it does; `make endurance` draws with itself."""

import gzip
import re
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError, NoRasteriser, UsageError
from harness.frame import bare_frame
from harness.rasterisers import Options
from harness.rasterisers.simulated import attila
from harness.rasterisers.simulated.attila import BINDING, Attila, Parameters, trace
from harness.rasterisers.simulated.building import Sources

SQUARE = np.array([[0, 0], [64, 0], [64, 64], [1, 64]], np.int32) * 256 // 2
BOTH = np.array([[0, 1, 2], [0, 2, 3]], np.int32)

SAID = {
    **{f"Stamps{lanes}Fragment_TT": 10 * (lanes + 1) for lanes in range(5)},
    **{f"OperatedFragments_CW-SU{pipe}": number for pipe, number in enumerate((20, 30, 40, 50))},
    "Draw_CP": 5,
    "EndGeometry_CP": 700,
    "EndFragment_CP": 1,
    "Clear_CP": 258,
    "UtilizationCycles_TT": 77,
    "ShadedVertices_FFU": 6,
    "MissesAlloc_FC_CW-SU0": 3,
    "MissesFetch_FC_CW-SU3": 4,
    "ReadBytes_CW-SU1": 64,
}


def stand_in(folder: Path, ends: str) -> None:
    """Write a program that does what the shell's line `ends` says, and the configuration."""
    (folder / "bGPU-Uni").write_text(f"#!/bin/sh\n{ends}\n")
    (folder / "bGPU-Uni").chmod(0o755)
    keys: dict[str, list[str]] = {}
    for settings in BINDING.values():
        for section, values in settings.items():
            keys.setdefault(section, []).extend(f"{key} = 4" for key in values)
    lines = (line for section, values in keys.items() for line in (f"[{section}]", *values))
    (folder / "bGPU.ini").write_text("# shipped\n" + "\n".join(lines) + "\n")


@pytest.fixture
def answering(tmp_path, monkeypatch) -> Path:
    """A stand-in that answers with SAID, and keeps what it was given."""
    with gzip.open(tmp_path / "answer.gz", "wt") as file:
        file.write(";".join(SAID) + "\n" + ";".join(map(str, SAID.values())) + "\n")
    stand_in(
        tmp_path,
        f"cp trace.txt bGPU.ini {tmp_path}/given; cp {tmp_path}/answer.gz stats.frames.csv.gz",
    )
    (tmp_path / "given").mkdir()
    monkeypatch.setattr(attila, "program", lambda: (tmp_path, {"digest": "none"}))
    return tmp_path


def test_counts_add_up_from_the_statistics_of_each_unit(answering):
    counted = Attila(Parameters()).count(bare_frame(64, SQUARE), BOTH, Options())
    assert {name: int(value) for name, value in counted.items()} == {
        "fragments": 20 + 2 * 30 + 3 * 40 + 4 * 50,
        "quads": 20 + 30 + 40 + 50,
        "helper_lanes": 4 * 140 - 400,
        "partial_quads": 20 + 30 + 40,
        "empty_quads": 10,
        "busiest_pipe_quads": 50,
        "traversal_cycles": 77,
        "shaded_vertices": 6,
        "colour_misses": 7,
        "colour_bytes": 64,
        "cycles": 706,
    }
    assert set(counted) == {*Attila.counters, "cycles"}


def test_places_are_written_without_rounding(answering):
    frame = bare_frame(64, SQUARE)
    Attila(Parameters()).count(frame, BOTH, Options())
    said = (answering / "given" / "trace.txt").read_text()
    places = [tuple(map(float, each)) for each in re.findall(r"glVertex3f\(([^,]+),([^,]+),", said)]
    np.testing.assert_array_equal(np.array(places) * 256, frame.points[BOTH.ravel()])
    assert "glViewport(0,0,64,64)" in said
    assert "GL_BLEND" not in said


@pytest.mark.parametrize("bound", BINDING)
def test_a_configuration_changes_what_it_names_and_nothing_else(answering, bound):
    Attila(Parameters(bound)).count(bare_frame(64, SQUARE), BOTH, Options())
    before = (answering / "bGPU.ini").read_text().splitlines()
    after = (answering / "given" / "bGPU.ini").read_text().splitlines()
    changed = {now for was, now in zip(before, after, strict=True) if was != now}
    wanted = {f"{key} = {value}" for each in BINDING[bound].values() for key, value in each.items()}
    assert changed == wanted
    blended = "glEnable(GL_BLEND)" in (answering / "given" / "trace.txt").read_text()
    assert blended == (bound == "fill")


def test_a_configuration_without_the_key_is_an_error():
    with pytest.raises(ValueError, match=r"no Absent in \[GPU\]"):
        attila.configured("[GPU]\nNum = 1\n[MEMORY]\nAbsent = 2\n", {"GPU": {"Absent": 3}})


@pytest.mark.parametrize("side", [96, 2048])
def test_a_viewport_that_rounds_places_is_refused(answering, side):
    with pytest.raises(UsageError, match="not exactly: choose a resolution of 64, 128"):
        Attila(Parameters()).count(bare_frame(side, SQUARE), BOTH, Options())


def test_nothing_to_draw_costs_nothing_and_starts_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(attila, "program", lambda: (tmp_path / "absent", {}))
    counted = Attila(Parameters()).count(bare_frame(64, SQUARE), BOTH[:0], Options())
    assert not any(counted.values())


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ("echo 'panic: no buffer'; exit 3", "ended with 3: panic: no buffer"),
        ("exit 0", "ended with 0"),
        ("printf 'a;b\\n1;2\\n3;4\\n' | gzip > stats.frames.csv.gz", "drew 2 frames where one"),
    ],
)
def test_a_simulator_that_fails_is_told_in_a_line(tmp_path, ends, words):
    stand_in(tmp_path, ends)
    drawn = trace(bare_frame(64, SQUARE), BOTH, blended=False)
    with pytest.raises(HarnessError, match=words):
        attila.run(tmp_path, drawn, {})


def test_quads_that_go_lost_on_the_way_are_noticed(answering, monkeypatch):
    monkeypatch.setitem(SAID, "OperatedFragments_CW-SU3", 49)
    with gzip.open(answering / "answer.gz", "wt") as file:
        file.write(";".join(SAID) + "\n" + ";".join(map(str, SAID.values())) + "\n")
    with pytest.raises(HarnessError, match="140 quads traversed, 139 were written"):
        Attila(Parameters()).count(bare_frame(64, SQUARE), BOTH, Options())


def test_sources_are_held_against_one_digest(tmp_path, monkeypatch):
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "a.cpp").write_text("int a;\n")
    monkeypatch.setenv("ITS_SOURCES", str(tmp_path))
    wrong = Sources("ITS_SOURCES", "clone it", ("src",), "0" * 64, ())
    assert "is not as it was published: clone it" in wrong.problem()
    with pytest.raises(NoRasteriser, match="clone it"):
        wrong.folder()
    # `sha256sum src/a.cpp | sha256sum`
    digest = "fb3315490ee3f4e3dc5ed456de18e740d0eb7b0558926e7aee7b60eba4fbca56"
    right = Sources("ITS_SOURCES", "clone it", ("src",), digest, ())
    assert right.problem() is None
    assert right.folder() == tmp_path
    monkeypatch.chdir(tmp_path.parent)
    monkeypatch.setenv("ITS_SOURCES", tmp_path.name)
    assert right.folder() == tmp_path
    (tmp_path / "src" / "b.cpp").touch()
    assert right.problem() is not None
    monkeypatch.delenv("ITS_SOURCES")
    assert "ITS_SOURCES is not set" in right.problem()
