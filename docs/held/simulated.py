"""The figures of docs/studies/skybox.md, and what other pages say of simulated designs."""

from __future__ import annotations

import math

from docs.held import Held, Sentence, Table
from docs.held.lookups import BEST_FOR_H, one, percent, some, table_row, two, whole

SCENES = {"helsinki": "Helsinki", "glyphs": "letters", "cad": "cad", "stress": "stress"}
PX = 256
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
    "takes {} of ear clipping's cycles on footprints of Helsinki, {} on letters, {} on sheet metal"
    " parts and {} on hostile polygons",
    lambda: [two(saved(scene, BEST_FOR_H)) for scene in SCENES],
)

WITH_SHADER = Sentence(
    "With a shader of eight cycles a quad it saves {} %, and its quads are {} % fewer",
    lambda: [
        percent(1 - mean_saved(BEST_FOR_H, "skybox:shader=8"), 1),
        percent(1 - mean_saved(BEST_FOR_H, "skybox:shader=8", "quads"), 1),
    ],
)

HELD: list[Held] = [
    Table("| cycles over ear clipping's | Helsinki | letters | cad | stress |", choices),
    Table("| scene | px | H | A | quads, counted | E |", ranked),
    Table(
        "| parameter | Delaunay | `flips:l1` | best for H | best for A"
        " | cycles a pixel of H | R^2 |",
        turned,
    ),
    Table("| cycles a quad | cycles | quads | over the larger, median | most |", shaded),
    Table("| legs | as published | exact bins | 4 cycles a quad | over 1:1 |", thin_rows),
    Sentence("In {} draws it misses the cycles by {} to {},", _missed),
    Sentence(
        "Flips stay behind the best for H by {} % on Helsinki and {} % on sheet metal parts.",
        lambda: [
            percent(saved(scene, "flips:l1") / saved(scene, BEST_FOR_H) - 1, 1)
            for scene in ("helsinki", "cad")
        ],
    ),
]

DEFINITIONS = (
    r"(?s)^.*?## Results",
    r"\b64 px\^2|\b(?:256|1024|64) px\b|R\^2|4 cycles a quad|Hypothesis \d|1:1",
    r"\| (?:0\.5|1|2|4|8) \||\| (?:Helsinki|letters|cad|stress) \| \d+ \||\| \d+:1 \|",
    r"tiles of \d+ px|blocks of 8 px|within 10 % of\s+the larger|\d+ cycles between triangles",
)
"""What was registered, and the names of rows and columns."""


BOUNDS = ("shipped", "shading", "fill", "setup")
OF_ATTILA = {"city": "city", "helsinki": "Helsinki", "glyphs": "letters", "cad": "cad"}
RANKED_BY = (
    *("half_perimeter", "overdraw", "expected_quads"),
    *("quads", "busiest_pipe_quads", "colour_misses"),
)


def in_whole(scene: str, bound: str, name: str = BEST_FOR_H, of: str = "cycles") -> dict[str, str]:
    """Return a row of ratios to ear clipping's in a whole GPU: ratio, low, high."""
    where = {"scene": scene, "bound": bound, "triangulator": name, "of": of}
    return one("attila/ratios.csv", **where)


def wholes() -> list[str]:
    """Return the table of cycles over ear clipping's, by what binds and triangulator."""
    rows = []
    for bound in BOUNDS:
        for name, label in LABELS.items():
            cells = [_three(float(in_whole(scene, bound, name)["ratio"])) for scene in OF_ATTILA]
            rows.append(table_row(f"`{bound}`", label, *cells))
    return rows


def whole_best() -> list[str]:
    """Return the table of the best for H: cycles with intervals, beside quads."""
    rows = []
    for bound in BOUNDS:
        cells = []
        for scene in OF_ATTILA:
            found = in_whole(scene, bound)
            ends = (_three(float(found[end])) for end in ("ratio", "low", "high"))
            cells.append("{} ({} to {})".format(*ends))
        rows.append(table_row(f"cycles, `{bound}`", *cells))
    quads = (in_whole(scene, BOUNDS[0], of="quads") for scene in OF_ATTILA)
    return [*rows, table_row("quads", *(_three(float(row["ratio"])) for row in quads))]


def whole_ranks() -> list[str]:
    """Return the table of correlations with cycles within polygons."""
    rows = []
    for bound in BOUNDS:
        for scene, label in OF_ATTILA.items():
            found = [one("attila/ranks.csv", scene=scene, bound=bound, by=by) for by in RANKED_BY]
            cells = (two(row["median"]) if row["median"] else "-" for row in found)
            rows.append(table_row(f"`{bound}`", label, *cells))
    return rows


def whole_orders() -> list[str]:
    """Return the table of how much order matters beside the triangulation."""
    rows = []
    for bound in BOUNDS:
        for scene, label in OF_ATTILA.items():
            row = one("attila/orders.csv", scene=scene, bound=bound)
            shares = (f"{percent(row[name], 2)} %" for name in ("triangulation", "order"))
            over = (_three(float(row[name])) for name in ("walk", "shuffled"))
            rows.append(table_row(f"`{bound}`", label, *shares, *over))
    return rows


IN_WHOLE = [
    Sentence(
        "the best for H takes {}, {}, {} and {} of ear clipping's cycles on the city, Helsinki,"
        " letters and sheet metal parts, a mean over three orders, one of them shuffled; bound by"
        " shading, {}, {}, {} and {}, which is",
        lambda: [
            two(in_whole(scene, bound)["ratio"]) for bound in BOUNDS[:2] for scene in OF_ATTILA
        ],
    ),
    Sentence(
        "as shipped those of the best for H reach from {} to {}.",
        lambda: [two(end) for end in _reach()],
    ),
    Sentence(
        "shuffled list of the same triangles takes, as a mean over a scene, {} to {} times the"
        " cycles",
        lambda: [two(end) for end in _shuffled()],
    ),
]


def _reach() -> tuple[float, float]:
    rows = [in_whole(scene, "shipped") for scene in OF_ATTILA]
    return min(float(row["low"]) for row in rows), max(float(row["high"]) for row in rows)


def _shuffled() -> tuple[float, float]:
    rows = some("attila/orders.csv", bound="shipped")
    found = [float(row["shuffled"]) for row in rows]
    return min(found), max(found)


WHOLE_HELD: list[Held] = [
    Table("| what binds | triangulator | city | Helsinki | letters | cad |", wholes),
    Table("| best for H over ear clipping | city | Helsinki | letters | cad |", whole_best),
    Table(
        "| what binds | scene | H | A | Q | quads | of the busiest pipe | colour misses |",
        whole_ranks,
    ),
    Table(
        "| what binds | scene | between triangulations | between orders | walk | shuffled |",
        whole_orders,
    ),
]

WHOLE_DEFINITIONS = (
    r"(?s)^.*?## Results",
    r"12 polygons of each|4,032 draws|\b95 %",
    r"(?m)^\d\. ",
)
