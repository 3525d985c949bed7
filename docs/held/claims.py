"""The figures in `harness/study/replication.py`: each claim of `study all`, on our own scenes."""

from __future__ import annotations

from docs.held import Held, Sentence, tables
from docs.held.lookups import percent, three, two
from docs.held.tables import BEST_FOR_H


def _ranks(measure: str, *criteria: str) -> list[str]:
    """Return correlations within a polygon of the city, each with its interval."""
    rows = (tables.correlation(criterion, measure) for criterion in criteria)
    return [three(row[column]) for row in rows for column in ("value", "ci_low", "ci_high")]


HELD: list[Held] = [
    Sentence('Q_RANKS_LANES = "{} ({} to {})"', lambda: _ranks("helper_lanes", "expected_quads")),
    Sentence(
        'H_BEFORE_A_BY_LANES = "{} ({} to {}), A {} ({} to {})"',
        lambda: _ranks("helper_lanes", "half_perimeter", "overdraw"),
    ),
    Sentence(
        'H_BEFORE_A_BY_TIME = "{} ({} to {}), A {} ({} to {})"',
        lambda: _ranks("time_work_0", "half_perimeter", "overdraw"),
    ),
    Sentence(
        'A_RANKS_TESTS = "{}"',
        lambda: [three(tables.correlation("overdraw", "bbox_tests", "bounding-box")["value"])],
    ),
    Sentence('D_IS_LAST = "{} ({} to {})"', lambda: _ranks("helper_lanes", "shape")),
    Sentence(
        'H_AGAINST_EAR_CLIPPING = "{} of its time',
        lambda: [three(tables.drawn("city", 1024, BEST_FOR_H))],
    ),
    Sentence(
        'H_AGAINST_DELAUNAY = "{} of its time',
        lambda: [three(tables.gain("city", 1024, BEST_FOR_H, "delaunay")["time_ratio"])],
    ),
    Sentence(
        'H_AGAINST_DELAUNAY_WALKED = "{} of its time (Helsinki, 1024 px); {} on letters',
        lambda: [
            three(tables.ordered(scene, BEST_FOR_H, base="delaunay")["walk"])
            for scene in ("helsinki", "glyphs")
        ],
    ),
    Sentence(
        'REGRET_OF_Q = "{} % ({} to {}) (city, 1024 px)"',
        lambda: [
            percent(tables.regret("cpu", "city", 1024, "Q", "quads")[column], 2)
            for column in ("mean", "ci_low", "ci_high")
        ],
    ),
    Sentence(
        'H_TURNED = "{} at the worst angle',
        lambda: [two(max(tables.rotated(f"{BEST_FOR_H}@0", "helper_lanes")))],
    ),
    Sentence(
        'A_TURNED = "{} at the worst angle',
        lambda: [two(max(tables.rotated("optimal:overdraw@0", "helper_lanes")))],
    ),
]

DEFINITIONS = (r"\d+ px\)", r"(?s)^.*?(?=\nQ_RANKS_LANES)", r"(?s)\n_NOTHING.*$")
