"""The ranking on a terminal: it fits 80 columns, and has colour only where one looks at it."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from harness.summary import BARS, print_summary

SAMPLES = [1.0e-3, 1.1e-3, 0.9e-3, 1.0e-3, 1.05e-3, 0.95e-3, 1.0e-3, 1.02e-3]


def record(name: str, factor: float = 1.0, polygons: int = 500, **changes: object) -> dict:
    return {
        "key": name,
        "scene": "city",
        "triangulator": name,
        "rasteriser": "opengl",
        "device": "llvmpipe",
        "resolution": 1024,
        "rotation": 0.0,
        "status": "ok",
        "reason": None,
        "polygons": polygons,
        "counters": {"fragments": 123456, "quads": 45678, "helper_lanes": int(992759 * factor)},
        "time": {
            "samples_s": [100 * factor * s for s in SAMPLES],
            "median_s": 0.1 * factor,
            "reference_s": SAMPLES,
        },
        **changes,
    }


def printed(records: list[dict], **options: object) -> str:
    output = io.StringIO()
    print_summary(records, Console(file=output, width=80, **options))  # type: ignore[arg-type]
    return output.getvalue()


RECORDS = [
    record("ear-clipping"),
    record("optimal:half-perimeter", 0.8),
    record("worst:half-perimeter", 1.5),
    record("fan", 0.3, polygons=229, reason="skipped polygon 0 and 270 more"),
    record("optimal:rotation-averaged-overdraw", 0.9),
]


def test_the_ranking_fits_eighty_columns_and_keeps_names_whole():
    text = printed(RECORDS)
    assert max(len(line) for line in text.splitlines()) <= 80
    for each in RECORDS[:4]:
        assert each["triangulator"] in text
    # A longer name goes on in the next line; nothing of it is lost.
    joined = "".join(line.split()[0] for line in text.splitlines())
    assert "optimal:rotation-averaged-overdraw" in joined
    assert "…" not in text


def test_bars_make_room_for_large_numbers():
    counters = {"fragments": 98765432, "quads": 26000000, "helper_lanes": 9876543}
    complete = {"ear-clipping": 1098, "optimal:half-perimeter": 1098, "max-area": 1060}
    records = [record(name, 1.0, n, counters=counters) for name, n in complete.items()]
    text = printed(records)
    assert "optimal:half-perimeter" in text
    assert "9,876,543" in text
    assert "█" * BARS[0] not in text
    assert "█" * BARS[-1] in text
    assert max(len(line) for line in text.splitlines()) <= 80


def test_the_fastest_comes_first_and_incomplete_ones_last():
    lines = printed(RECORDS).splitlines()
    order = [
        line.split()[0]
        for line in lines[2:]
        if line.split()[0]
        in {"optimal:half-perimeter", "ear-clipping", "worst:half-perimeter", "fan"}
    ]
    assert order[:4] == ["optimal:half-perimeter", "ear-clipping", "worst:half-perimeter", "fan"]


def test_bars_grow_with_time_and_verdicts_are_words():
    lines = {line.split()[0]: line for line in printed(RECORDS).splitlines()[2:8]}
    bars = {name: line.count("█") for name, line in lines.items()}
    assert bars["worst:half-perimeter"] == BARS[0]
    assert bars["optimal:half-perimeter"] < bars["ear-clipping"] < BARS[0]
    assert "0.800 ±0.000 faster" in lines["optimal:half-perimeter"]
    assert "slower" in lines["worst:half-perimeter"]
    assert "(229 of 500 polygons)" in lines["fan"]


@pytest.mark.parametrize("terminal", [True, False])
def test_colour_is_for_terminals_alone(terminal):
    text = printed(RECORDS, force_terminal=terminal, color_system="standard" if terminal else None)
    assert ("\x1b[" in text) is terminal


def test_a_terminal_that_knows_ascii_alone_gets_ascii():
    raw = io.BytesIO()
    output = io.TextIOWrapper(raw, encoding="ascii")
    print_summary(RECORDS, Console(file=output, width=80))
    output.flush()
    text = raw.getvalue().decode("ascii")
    assert "#" * BARS[0] in text
    assert "+-" in text
