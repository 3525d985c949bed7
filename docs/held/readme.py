"""The figures of README.md."""

from __future__ import annotations

from functools import cache

from docs.held import Block, Held, Sentence, Table, flips, simulated
from docs.held.lookups import two, whole
from docs.held.tables import BEST_FOR_H, SCENES, drawn, error_of_prediction


@cache
def _picture() -> list[str]:
    """Return pixels, and helper lanes by ear clipping and by the best for H, of overdraw.png.

    `raster-harness inspect city --polygon 438` draws it; counters are exact anywhere.
    """
    from harness.frame import View, make_frame
    from harness.rasterisers import Options, find_device, get
    from harness.triangulating.frames import triangulate_polygons
    from harness.triangulating.recipes import parse
    from scenes import load

    reference = get("reference")(find_device("reference"))
    frame = make_frame([load("city").polygons[438]], View(64))
    found = []
    for name in ("ear-clipping", BEST_FOR_H):
        parts = triangulate_polygons(parse(name), frame.polygons).parts
        counted = reference.count(frame, frame.join(parts), Options())
        found.append({key: whole(sum(counted[key])) for key in ("fragments", "helper_lanes")})
    return [found[0]["fragments"], *(each["helper_lanes"] for each in found)]


HELD: list[Held] = [
    simulated.IN_SHORT,
    Sentence("cover the same {} pixels.", lambda: _picture()[:1]),
    Sentence(
        "Thin triangles cause many of them: {} on the left, {} on the right.",
        lambda: _picture()[1:],
    ),
    Sentence(
        "drawn in {} of ear clipping's time for city footprints, {} for Helsinki's, {} for letters"
        " and {} for counties.",
        lambda: [two(drawn(scene, 1024, BEST_FOR_H)) for scene in SCENES],
    ),
    Sentence(
        "say a scene's helper lanes, in ratio to ear clipping's, to {} % (root mean square over",
        lambda: [error_of_prediction(1)],
    ),
    Table("| after earcut, L1 flips | city | letters | U.S. states |", flips.in_short),
    Block("city, ", "llvmpipe/city/table.txt"),
]

DEFINITIONS = (
    r"\b2x2\b|\b95 %|Python 3.11 to 3.13|\b1024 px|at 256 px|\b500 footprints|2-core machine",
    r"up to 2,000 vertices|than 500 vertices|512 px",
    r"Its packages take some 720 MB|array \(m, 3\)",
)
