"""The figures of docs/studies/skybox.md, and what other pages say of simulated designs."""

from __future__ import annotations

import math

from docs.held import Held, Sentence, Table
from docs.held.lookups import one, percent, some, table_row, two, whole

SCENES = {"helsinki": "Helsinki", "glyphs": "letters"}
PX = 256
BEST_FOR_H = "optimal:half-perimeter"
LABELS = {
    "delaunay": "Delaunay",
    "earcut-refine": "`earcut-refine`",
    "flips:l1": "`flips:l1`",
    BEST_FOR_H: "best for H",
    "optimal:overdraw": "best for A",
    "optimal:expected-quads": "best for Q",
}
CRITERIA = {"half_perimeter": "H", "overdraw": "A", "quads": "quads, counted", "edge_length": "E"}
SHADERS = (0.5, 1, 2, 4, 8)
PARAMETERS = {
    "": "as published",
    ":output_quads=1": "one quad a cycle",
    ":tile=16": "tiles of 16 px",
    ":tile=64": "tiles of 64 px",
    ":block=8": "blocks of 8 px",
    ":bins=exact": "exact bins",
    ":fetch=16": "16 cycles between triangles",
    ":fetch=64": "64 cycles between triangles",
}


def saved(scene: str, name: str, px: int = PX, device: str = "skybox", of: str = "cycles") -> float:
    """Return cycles, or quads, over ear clipping's."""
    where = {"device": device, "scene": scene, "resolution": px, "triangulator": name}
    return float(one("skybox/savings.csv", **where)[of])


def mean_saved(name: str, device: str = "skybox", of: str = "cycles") -> float:
    """Return the same, the geometric mean over the scenes."""
    logs = [math.log(saved(scene, name, device=device, of=of)) for scene in SCENES]
    return math.exp(sum(logs) / len(logs))


def _three(value: float) -> str:
    return f"{value:.3f}"


def choices() -> list[str]:
    """Return the table of cycles over ear clipping's."""
    rows = [
        table_row(label, *(_three(saved(scene, name)) for scene in SCENES))
        for name, label in LABELS.items()
    ]
    quads = (_three(saved(scene, BEST_FOR_H, of="quads")) for scene in SCENES)
    return [*rows, table_row("quads of the best for H", *quads)]


def ranked() -> list[str]:
    """Return the table of correlations with cycles."""
    rows = []
    for scene, label in SCENES.items():
        for px in (64, 256, 1024):
            where = {"device": "skybox", "scene": scene, "resolution": px}
            found = [one("skybox/ranks.csv", criterion=name, **where) for name in CRITERIA]
            rows.append(table_row(label, str(px), *(_three(float(r["median"])) for r in found)))
    return rows


def turned() -> list[str]:
    """Return the table of what parameters do."""
    names = ("delaunay", "flips:l1", BEST_FOR_H, "optimal:overdraw")
    rows = []
    for more, label in PARAMETERS.items():
        slope = one("skybox/slopes.csv", device=f"skybox{more}", resolution=PX)
        cells = [_three(mean_saved(name, f"skybox{more}")) for name in names]
        px, explained = (two(slope[name]) for name in ("cycles_per_px", "r_squared"))
        rows.append(table_row(label, *cells, px, explained))
    return rows


def shaded() -> list[str]:
    """Return the table of what a shader hides."""
    rows = []
    for k in SHADERS:
        found = one("skybox/border.csv", shader=k)
        device = f"skybox:shader={k:g}"
        cells = (mean_saved(BEST_FOR_H, device), mean_saved(BEST_FOR_H, device, "quads"))
        larger = (float(found["over_larger"]), float(found["most_over"]))
        rows.append(table_row(f"{k:g}", *map(_three, (*cells, *larger))))
    return rows


def thin(aspect: int, device: str = "skybox") -> float:
    """Return the mean cycles of a thin triangle over its angles."""
    rows = some("skybox/thin.csv", device=device, aspect=aspect)
    return sum(float(row["cycles"]) for row in rows) / len(rows)


def thin_rows() -> list[str]:
    """Return the table of thin triangles."""
    return [
        table_row(
            f"{aspect}:1",
            *(f"{thin(aspect, device):.1f}" for device in _THIN_ON),
            two(thin(aspect) / thin(1)),
        )
        for aspect in (1, 4, 16, 64, 256)
    ]


_THIN_ON = ("skybox", "skybox:bins=exact", "skybox:shader=4")


def _missed() -> list[str]:
    rows = some("skybox/squares.csv")
    return [whole(sum(int(row["draws"]) for row in rows)), *_extremes(rows)]


def _extremes(rows: list[dict[str, str]]) -> list[str]:
    least = min(int(float(row["least"])) for row in rows)
    return [str(least), str(max(int(float(row["most"])) for row in rows))]


IN_SHORT = Sentence(
    "takes {} of ear clipping's cycles on Helsinki's footprints and {} on letters",
    lambda: [two(saved(scene, BEST_FOR_H)) for scene in SCENES],
)

WITH_SHADER = Sentence(
    "With a shader of eight cycles a quad it saves {} %, as its quads do, {} %",
    lambda: [
        percent(1 - mean_saved(BEST_FOR_H, "skybox:shader=8"), 1),
        percent(1 - mean_saved(BEST_FOR_H, "skybox:shader=8", "quads"), 1),
    ],
)

HELD: list[Held] = [
    IN_SHORT,
    Table("| cycles over ear clipping's | Helsinki | letters |", choices),
    Table("| scene | px | H | A | quads, counted | E |", ranked),
    Table(
        "| parameter | Delaunay | `flips:l1` | best for H | best for A | cycles a pixel of H | R^2 |",
        turned,
    ),
    Table("| cycles a quad | cycles | quads | over the larger, median | most |", shaded),
    Table("| legs | as published | exact bins | 4 cycles a quad | over 1:1 |", thin_rows),
    Sentence("In {} draws it misses the cycles by {} to {},", _missed),
]

DEFINITIONS = (
    r"(?s)^.*?## Results",
    r"\b64 px\^2|\b(?:256|1024|64) px\b|R\^2|4 cycles a quad|Hypothesis \d|1:1",
    r"\| (?:0\.5|1|2|4|8) \||\| (?:Helsinki|letters) \| \d+ \||\| \d+:1 \|",
    r"tiles of \d+ px|blocks of 8 px|\d+ cycles between triangles",
)
"""What was registered, and the names of rows and columns."""
