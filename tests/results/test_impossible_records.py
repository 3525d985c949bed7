"""Every command that reads runs skips an impossible record and names it."""

import json
from pathlib import Path

import pytest

from tests.conftest import require_ok

IMPOSSIBLE = {
    "resolution": (4, "resolution 4: out of range (8 to 16384 pixels)"),
    "options": ({"order": "foo"}, "options.order: Input should be 'native', 'walk'"),
}
MOCK = ("--rasterisers", "tests.mock:MockRasteriser", "--triangulators", "fan,delaunay")

COMMANDS = {
    "report": ("report", "damaged"),
    "compare": ("compare", "damaged", "whole"),
    "merge": ("merge", "damaged", "whole", "--out", "merged", "--hosts", "a,b"),
    "history": ("history", "damaged", "whole"),
    "import": ("import", "damaged", "--summary", "device.json"),
    "page": ("page", "damaged"),
    "gains": ("study", "gains", "damaged", "--out", "gains"),
    "resume": ("run", "--resume", "damaged", "--force"),
}


@pytest.mark.usefixtures("no_plots", "in_process")
@pytest.mark.parametrize("field", IMPOSSIBLE)
def test_each_command_names_the_record_and_goes_on(harness, block, field):
    for name in ("damaged", "whole"):
        quick = ("--quick", "--quiet", "--resolution", "64,128", "--budget", "0.01")
        require_ok(harness("run", "--scene", str(block), "--out", name, *MOCK, *quick))
    file = Path("damaged/cases.jsonl")
    lines = file.read_text().splitlines(keepends=True)
    lines[1] = json.dumps({**json.loads(lines[1]), field: IMPOSSIBLE[field][0]}) + "\n"
    file.write_text("".join(lines))
    facts = json.loads(Path("damaged/run.json").read_text())
    del facts["written"]  # the digest would reveal the edit
    Path("damaged/run.json").write_text(json.dumps(facts))
    line = f"damaged/cases.jsonl, line 2: {IMPOSSIBLE[field][1]}"
    for name, command in COMMANDS.items():
        code, out, err = harness(*command)
        assert line in " ".join((out + err).split()), (name, code, err)
        assert "; record ignored" in out + err, name
        assert code in (0, 1, 5), (name, code, out, err)
