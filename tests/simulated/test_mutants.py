"""Five mistakes in the raster slice: each is seen by what the tests of the right one look at."""

from __future__ import annotations

import shutil

import numpy as np

from harness.errors import HarnessError
from harness.rasterisers.reference import predict
from harness.rasterisers.simulated import skybox
from harness.rasterisers.simulated.skybox import work
from tests.simulated.conftest import BESIDE, triangles_of

MUTANTS = (
    "an edge's extent is forgotten",
    "a queue is popped while its evaluator is stalled",
    "a block does not wait for its other quads",
    "a block does not wait for a full queue",
    "a quad's pixels are transposed",
)

MISTAKES = {
    "VX_raster_te.sv": {
        "(tile_extents[i] >> tile_level)": {1: "((i == 2) ? 0 : (tile_extents[i] >> tile_level))"},
        "fifo_arb_onehot[i] && ~output_stall": {2: "fifo_arb_onehot[i]"},
    },
    "VX_raster_be.sv": {
        "fifo_valid_in && (~fifo_ready_in || ~batch_sent_all)": {
            3: "fifo_valid_in && ~fifo_ready_in",
            4: "fifo_valid_in && fifo_ready_in && ~batch_sent_all",
        },
    },
    "VX_raster_qe.sv": {
        "i * edges_in[q][k][0] + j * edges_in[q][k][1]": {
            5: "j * edges_in[q][k][0] + i * edges_in[q][k][1]"
        },
    },
}
"""File -> what stands there -> what stands there in a mutant, by its number."""

COUNTED = ("fragments", "quads", "partial_quads")

CHOICE = 'int mutant; initial if (!$value$plusargs("mutant=%d", mutant)) mutant = 0;\n'


def all_in_one(folder):
    """Write sources that are the mutant whose number the program is told, or none of them."""
    shutil.copytree(BESIDE / "hw" / "rtl", folder)
    for name, mistakes in MISTAKES.items():
        file = folder / "raster" / name
        text = file.read_text()
        for right, others in mistakes.items():
            assert text.count(right) == 1, right
            chosen = right
            for number, wrong in others.items():
                chosen = f"((mutant == {number}) ? ({wrong}) : ({chosen}))"
            text = text.replace(right, chosen)
        body = text.index(");", text.index("module VX_raster")) + 3
        file.write_text(text[:body] + CHOICE + text[body:])
    return folder


def test_five_mutants_are_seen_and_three_of_them_by_back_pressure_alone(buildable, tmp_path):
    parameters = {"TILE_LOGSIZE": 5, "BLOCK_LOGSIZE": 2}
    rtl = all_in_one(tmp_path / "rtl")
    frame, triangles = triangles_of(128, 30, seed=8)
    whole = np.array([0, 0, 127, 127], np.int64)
    todo = work(frame.points, triangles, [slice(0, len(triangles))], whole, 32, exact=False)
    expected = predict(frame.points, triangles)

    def seen(output_quads: int, shader: float) -> list[int]:
        file, _ = skybox.program(rtl, {**parameters, "OUTPUT_QUADS": output_quads})
        found, sound = [], None
        for number in range(len(MUTANTS) + 1):
            script = tmp_path / f"mutant-{number}"
            script.write_text(f"#!/bin/sh\nexec timeout 60 {file} +mutant={number}\n")
            script.chmod(0o755)
            try:
                drawn = skybox.run(script, todo, whole, shader, keep_quads=True)
            except HarnessError:
                found.append(number)
                continue
            columns = dict(zip(skybox.COUNTS, drawn.counts.T, strict=True))
            right = all((columns[name] == expected[name]).all() for name in COUNTED)
            quads = drawn.quads.tolist()  # where and with which mask: counts miss a transposition
            sound = quads if number == 0 else sound
            if not right or quads != sound:
                found.append(number)
        return found

    assert seen(1, shader=3) == [1, 2, 3, 4, 5]
    assert seen(4, shader=0) == [1, 5]
