"""Which document cites which figures, those of single pages, and what `study all` sets beside.

`harness/study/replication.py` holds each claim of `study all`, on our own scenes.
"""

import tomllib
from functools import cache
from pathlib import Path

from docs.held import Held, findings, flips, simulated, tables
from docs.held.findings import SCENES, correlation, gain, ordered, regret, rotated
from docs.held.lookups import REFERENCE
from docs.held.names import BEST_FOR_A, BEST_FOR_H, BEST_FOR_Q
from harness.frame import View, make_frame
from harness.rasterisers.reference import predict
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse
from scenes import load


@cache
def _picture() -> list[int]:
    """Return pixels, and helper lanes by ear clipping and by the best for H, of overdraw.png.

    `raster-harness inspect city --polygon 438` draws it; counters are exact anywhere.
    """
    frame = make_frame([load("city").polygons[438]], View(64))
    ears, best = (
        predict(frame.points, frame.join(triangulate_polygons(parse(n), frame.polygons).parts))
        for n in ("ear-clipping", BEST_FOR_H)
    )
    return [sum(ears["fragments"]), *(sum(each["helper_lanes"]) for each in (ears, best))]


README: Held = {
    **simulated.IN_SHORT,
    "cover the same {:,} pixels.": lambda: _picture()[:1],
    "There are {:,} on the left and {:,} on the right.": lambda: _picture()[1:],
    "in {:.2f} of ear clipping's time on a ... {:.2f} ... {:.2f} ... {:.2f} on": lambda: [
        gain(s, 1024, BEST_FOR_H) for s in SCENES
    ],
    "at 1024 px in {:.2f} of ear clipping's time by the best for Q, and in {:.2f} by the best for"
    " H; on letters these are {:.2f} and {:.2f}": lambda: [
        findings.on_gpu(s, 1024, n) for s in ("city", "glyphs") for n in (BEST_FOR_Q, BEST_FOR_H)
    ],
    "are predicted to {:.1f} %": lambda: [findings.error_of_prediction("by_quads")],
    "| after earcut, L1 flips | city | letters | U.S. states |": flips.IN_SHORT,
    "city, 500 polygons, 1024 px: opengl on llvmpipe": lambda: (
        (REFERENCE / "llvmpipe/city/table.txt").read_text().splitlines()[1:]
    ),
}


def _ranks(measure: str, *criteria: str) -> list[float]:
    """Return correlations within a polygon of the city, each with its interval."""
    rows = (correlation(criterion, measure) for criterion in criteria)
    return [row[column] for row in rows for column in ("value", "ci_low", "ci_high")]


CLAIMS: Held = {
    'Q_RANKS_LANES = "{:.3f} ({:.3f} to {:.3f})"': lambda: _ranks("helper_lanes", "expected_quads"),
    'H_BEFORE_A_BY_LANES = "{:.3f} ({:.3f} to {:.3f}), A {:.3f} ({:.3f} to {:.3f})"': lambda: (
        _ranks("helper_lanes", "half_perimeter", "overdraw")
    ),
    'H_BEFORE_A_BY_TIME = "{:.3f} ({:.3f} to {:.3f}), A {:.3f} ({:.3f} to {:.3f})"': lambda: _ranks(
        "time_work_0", "half_perimeter", "overdraw"
    ),
    'A_RANKS_TESTS = "{:.3f}"': lambda: [
        correlation("overdraw", "bbox_tests", "bounding-box")["value"]
    ],
    'D_IS_LAST = "{:.3f} ({:.3f} to {:.3f})"': lambda: _ranks("helper_lanes", "shape"),
    'H_AGAINST_EAR_CLIPPING = "{:.3f} of its time': lambda: [gain("city", 1024, BEST_FOR_H)],
    'H_AGAINST_DELAUNAY = "{:.3f} of its time': lambda: [
        gain("city", 1024, BEST_FOR_H, "delaunay")
    ],
    'H_AGAINST_DELAUNAY_WALKED = "{:.3f} of its time (Helsinki, 1024 px); {:.3f} on'
    " letters": lambda: [
        ordered(s, BEST_FOR_H, "delaunay")["walk"] for s in ("helsinki", "glyphs")
    ],
    'REGRET_OF_Q = "{:.2%} % ({:.2%} to {:.2%}) (city, 1024 px)"': lambda: regret(
        "city", 1024, "Q", "quads"
    )[["mean", "ci_low", "ci_high"]],
    'H_TURNED = "{:.2f} at the worst angle': lambda: [rotated(BEST_FOR_H + "@0").max()],
    'A_TURNED = "{:.2f} at the worst angle': lambda: [rotated(BEST_FOR_A + "@0").max()],
}

DOCUMENTS: dict[str, Held] = {
    "README.md": README,
    "docs/findings.md": findings.FIRST,
    "docs/findings-tables.md": tables.TABLES,
    "docs/flips.md": flips.HELD,
    "docs/studies/skybox.md": simulated.HELD,
    "docs/studies/whole-gpu.md": simulated.WHOLE_HELD,
    "harness/study/replication.py": CLAIMS,
    "docs/upstream.md": flips.UPSTREAM,
}


def not_measured(name: str) -> list[str]:
    """Return patterns of the numbers of a document that nobody measured."""
    patterns = tomllib.loads((Path(__file__).parent / "not_measured.toml").read_text())
    return [each for start, some in patterns.items() if name.startswith(start) for each in some]
