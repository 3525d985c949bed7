"""The summary table on a terminal: within 80 columns, colour only on terminals."""

import io
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from harness.metrics.decision import decide_run
from harness.metrics.groups import group_run, replace_base
from harness.results.run_folder import read_run
from harness.summary import print_summary
from tests.conftest import assert_refused, require_ok
from tests.harness.test_cli import MOCK
from tests.records import make_run

SAMPLES = [1.0e-3, 1.1e-3, 0.9e-3, 1.0e-3, 1.05e-3, 0.95e-3, 1.0e-3, 1.02e-3]


def record(name: str, factor: float = 1.0, polygons: int = 500, **changes: object) -> dict:
    """Return fields of a record whose draws take `factor` of 0.1 s."""
    counters = {"fragments": 123456, "quads": 45678, "helper_lanes": int(992759 * factor)}
    samples_s = [100 * factor * s for s in SAMPLES]
    time = {"samples_s": samples_s, "median_s": 0.1 * factor, "reference_s": SAMPLES}
    fields = {"triangulator": name, "polygons": polygons, "counters": counters, "time": time}
    return fields | changes


def show(records: list[dict], base: str = "", **options: Any) -> str:
    output = io.StringIO()
    console = Console(**{"file": output, "width": 80, **options})
    print_summary(decide_run(make_run(records, base=base)), console)
    return output.getvalue()


RECORDS = [
    record("ear-clipping"),
    record("optimal:half-perimeter", 0.8),
    record("worst:half-perimeter", 1.5),
    record("fan", 0.3, polygons=229, reason="skipped polygon 0 and 270 more"),
    record("optimal:mixed=1.25/0.375/0.0625", 0.9),
]


def test_the_ranking_fits_eighty_columns_with_full_names():
    text = show(RECORDS)
    assert max(len(line) for line in text.splitlines()) <= 80
    for fields in RECORDS[:4]:
        assert fields["triangulator"] in text
    # A longer name continues on the next line.
    joined = "".join(line.split()[0] for line in text.splitlines())
    assert "optimal:mixed=1.25/0.375/0.0625" in joined
    assert "…" not in text


def test_large_numbers_fit_eighty_columns():
    counters = {"fragments": 98765432, "quads": 26000000, "helper_lanes": 9876543}
    counters["covering_triangles"] = 1234567
    complete = {"ear-clipping": 1098, "optimal:half-perimeter": 1098, "max-area": 1060}
    records = [record(name, 1.0, n, counters=counters) for name, n in complete.items()]
    text = show(records)
    assert all(part in text for part in ("optimal:half-perimeter", "9,876,543"))
    assert max(len(line) for line in text.splitlines()) <= 80


def test_the_fastest_comes_first_and_incomplete_ones_last():
    assert "229 of 500 done" in show(RECORDS, width=120)
    names = ["optimal:half-perimeter", "ear-clipping", "worst:half-perimeter", "fan"]
    first_words = (line.split()[0] for line in show(RECORDS).splitlines()[2:])
    assert [word for word in first_words if word in names][:4] == names


def test_regret_is_shown_after_covering_triangles_if_there_is_room():
    counters = {"fragments": 9000, "quads": 4000, "helper_lanes": 7000, "covering_triangles": 3456}
    minimum = {"polygons": 500, "quads": 3650, "shaded": 4000, "fragments": 9000}
    names = ("ear-clipping", "optimal:half-perimeter")
    records = [record(name, counters=counters, least=minimum) for name in names]
    wide, narrow = (show(records, width=width) for width in (96, 95))
    assert "helpers covering regret draw ms" in wide.splitlines()[1]
    assert "7,000    3,456  25.0%" in wide
    assert max(len(line) for line in wide.splitlines()) <= 96
    assert "helpers covering draw ms" in narrow.splitlines()[1]
    assert "covering" not in show(RECORDS, width=120)  # a rasteriser without this counter


@pytest.mark.parametrize("terminal", [True, False])
def test_only_terminals_get_colour(terminal):
    text = show(RECORDS, force_terminal=terminal, color_system="standard" if terminal else None)
    assert ("\x1b[" in text) is terminal


def test_ascii_terminals_get_ascii():
    raw = io.BytesIO()
    output = io.TextIOWrapper(raw, encoding="ascii")
    print_summary(decide_run(make_run(RECORDS[:4])), Console(file=output, width=80))
    output.flush()
    text = raw.getvalue().decode("ascii")
    assert "0.800 (0.795-0.805) faster" in text


def rounds(*samples_s: float) -> dict:
    median_s, reference_s = sorted(samples_s)[len(samples_s) // 2], [1e-3] * len(samples_s)
    return {"samples_s": list(samples_s), "median_s": median_s, "reference_s": reference_s}


def test_the_interval_is_printed_and_order_follows_the_paired_ratio():
    """Medians of disturbed samples may have another order than the common rounds."""
    records = [
        record("ear-clipping", time=rounds(*[0.1] * 3, *[0.2] * 4)),
        record("delaunay", time=rounds(*[0.09] * 3, 0.18, 0.1, 0.19, 0.19)),
        record("greedy", time=rounds(*[0.12] * 7)),
    ]
    medians = {fields["triangulator"]: fields["time"]["median_s"] for fields in records}
    assert medians["greedy"] < medians["ear-clipping"]
    text = show(records)
    lines = text.splitlines()[2:5]
    assert [line.split()[0] for line in lines] == ["greedy", "delaunay", "ear-clipping"]
    assert "0.900 (0.500-0.950)" in lines[1]


def test_the_base_is_chosen_or_ear_clipping():
    assert "vs ear-clipping" in show(RECORDS)
    text = show(RECORDS, "worst:half-perimeter")
    assert "vs worst:half-perimeter" in text
    assert "0.667 (0.663-0.671) faster" in text
    assert max(len(line) for line in text.splitlines()) <= 80


def test_readers_of_a_run_use_its_base(harness, block, no_plots):
    names = ("--triangulators", "ear-clipping,delaunay", "--out", "out")
    run = ("run", "--scene", str(block), *names, *MOCK)
    answer = harness(*run, "--base", "greedy")
    assert_refused(answer, "--base greedy: not among --triangulators ear-clipping,delaunay")
    out, _ = require_ok(harness(*run, "--base", "delaunay"))
    assert "vs delaunay" in out
    stored = read_run(Path("out"))
    assert stored.base == "delaunay"
    for run, name in ((stored, "delaunay"), (replace_base(stored, "ear-clipping"), "ear-clipping")):
        assert [group.base.name for group in group_run(run)] == [name]
    answer = harness("report", "out", "--base", "ear-cliping")
    assert_refused(answer, "unknown base 'ear-cliping'; did you mean 'ear-clipping'?")
    assert harness("report", "out", "--base", "ear-clipping")[0] == 0


def test_proven_optima_are_printed_below():
    proofs = {"overdraw": (500, 0.0), "half-perimeter": (500, 0.0), "shape": (497, 0.00123)}
    proofs |= {"edge-length": (0, None), "expected-quads": (499, 0.99999)}
    optima = [
        record(f"optimal:{name}", 0.9, proven=proven, largest_gap=gap)
        for name, (proven, gap) in proofs.items()
    ]
    joined = " ".join(show([record("ear-clipping"), *optima]).split())
    assert "every polygon: optimal:overdraw, optimal:half-perimeter" in joined
    assert "497 of 500 polygons: optimal:shape; the others within 0.12%" in joined
    assert "0 of 500 polygons: optimal:edge-length; some others have no bound" in joined
    assert "499 of 500 polygons: optimal:expected-quads; some others have no" in joined
    assert "proven" not in show(RECORDS)
