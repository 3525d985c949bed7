"""The figures of docs/studies/map-tiles.md."""

from __future__ import annotations

from docs.held import Held, Sentence, Table
from docs.held.lookups import Row, interval, one, percent, some, table_row, three, two, whole

LANES, BYTES, VIEWS = (f"map-tiles/{name}.csv" for name in ("lanes", "bytes", "views"))
BASE, REFINED, FLIPS = "ear-clipping", "earcut-refine", "flips:l1"
BEST, BEST_Q = "optimal:half-perimeter", "optimal:expected-quads"
PLACES = {"helsinki": "Helsinki", "sanfrancisco": "San Francisco"}


def _subjects() -> list[dict[str, str]]:
    found = some(LANES, triangulator=BASE)
    return [{"data": row["data"], "zoom": row["zoom"]} for row in found]


def _named(where: dict[str, str]) -> str:
    return f"{PLACES[where['data']]}, {where['zoom']}"


def lanes() -> list[str]:
    """Return, for each zoom, helper lanes in ratio to ear clipping's."""
    lines = []
    for where in _subjects():
        base = one(LANES, triangulator=BASE, **where)
        cells = []
        for name in (REFINED, FLIPS, BEST, BEST_Q):
            row = one(LANES, triangulator=name, **where)
            within = interval(row["low"], row["high"], three) if row["low"] else ""
            cells.append(f"{three(row['ratio'])} {within}".strip())
        counted = [whole(base[name]) for name in ("tiles", "polygons", "dropped", "helper_lanes")]
        lines.append(table_row(_named(where), *counted, *cells))
    return lines


def _best(name: str, packing: str, where: dict[str, str]) -> Row:
    """Return the row of the order that adds the fewest bytes."""
    found = some(BYTES, triangulator=name, packing=packing, **where)
    return min(found, key=lambda row: int(row["added"]))


def _each(row: Row) -> str:
    return two(int(row["added"]) / int(row["triangles"]))


def added() -> list[str]:
    """Return, for each zoom, what triangles in their best order add to tiles."""
    lines = []
    for where in _subjects():
        cells = []
        for name in (BASE, REFINED, BEST, BEST_Q):
            row = _best(name, "gzip", where)
            share = percent(int(row["added"]) / int(row["tile_bytes"]))
            cells.append(f"{share} % ({_each(row)}, {row['order']})")
        packed = [_each(_best(BEST, packing, where)) for packing in ("none", "brotli", "zstd")]
        plain = _best(BASE, "gzip", where)["tile_bytes"]
        lines.append(table_row(_named(where), whole(plain), *cells, *packed))
    return lines


def orders() -> list[str]:
    """Return, for each order, bytes a triangle and vertices shaded a triangle, over all zooms."""
    lines = []
    for data, place in PLACES.items():
        for order in ("native", "walk", "vertex-cache", "sorted", "sorted-back"):
            cells = []
            for name in (BASE, REFINED, BEST):
                rows = some(BYTES, data=data, triangulator=name, order=order, packing="gzip")
                sums = [
                    sum(int(row[column]) for row in rows)
                    for column in ("added", "vertices_shaded", "triangles")
                ]
                cells += [two(sums[0] / sums[2]), two(sums[1] / sums[2])]
            lines.append(table_row(place, order, *cells))
    return lines


def views() -> list[str]:
    """Return, for each zoom, the share of the saving that stays in other views."""
    lines = []
    for where in _subjects():
        cells = []
        for name in (BEST, BEST_Q):
            chosen = one(VIEWS, triangulator=name, scale=1.0, turn=0, **where)
            full = 1.0 - float(chosen["ratio"])
            for turn in (0, 30):
                rows = some(VIEWS, triangulator=name, turn=turn, **where)
                kept = [(1.0 - float(row["ratio"])) / full for row in rows]
                cells.append(f"{two(min(kept))} to {two(max(kept))}")
        lines.append(table_row(_named(where), *cells))
    return lines


def _saved(name: str) -> list[float]:
    return [1.0 - float(one(LANES, triangulator=name, **each)["ratio"]) for each in _subjects()]


def _ends(shares: list[float]) -> list[str]:
    return [percent(min(shares)), percent(max(shares))]


def _shares(name: str) -> list[float]:
    rows = [_best(name, "gzip", where) for where in _subjects()]
    return [int(row["added"]) / int(row["tile_bytes"]) for row in rows]


def _bytes_of(name: str) -> list[str]:
    rows = [_best(name, "gzip", where) for where in _subjects()]
    each = [int(row["added"]) / int(row["triangles"]) for row in rows]
    return [two(min(each)), two(max(each))]


def _of_the_optimum() -> list[str]:
    pairs = zip(_saved(REFINED), _saved(BEST), strict=True)
    return _ends([refined / best for refined, best in pairs])


TABLES: list[Held] = [
    Table(
        "| data, zoom | tiles | polygons | lost | ear clipping's helper lanes | earcut-refine |"
        " L1 flips | optimum for H | optimum for Q |",
        lanes,
    ),
    Table(
        "| data, zoom | bytes, gzip | ear clipping | earcut-refine | optimum for H |"
        " optimum for Q |"
        " H, not packed | H, Brotli | H, zstd |",
        added,
    ),
    Table(
        "| data | order | ear clipping: bytes | vertices | earcut-refine: bytes | vertices |"
        " optimum for H: bytes | vertices |",
        orders,
    ),
    Table("| data, zoom | H, upright | H, turned | Q, upright | Q, turned |", views),
]

SENTENCES: list[Held] = [
    Sentence(
        "the optimum for Q saves {} to {} % of ear clipping's helper lanes, and that for H {} to"
        " {} %",
        lambda: [*_ends(_saved(BEST_Q)), *_ends(_saved(BEST))],
    ),
    Sentence(
        "Its triangles add {} to {} % to a tile that is packed by gzip, {} to {} bytes a triangle,",
        lambda: [*_ends(_shares(BEST_Q)), *_bytes_of(BEST_Q)],
    ),
    Sentence(
        "`earcut-refine` gets {} to {} % of the optimum's saving for H.",
        _of_the_optimum,
    ),
    Sentence(
        "where ear clipping's triangles add {} to {} %.",
        lambda: _ends(_shares(BASE)),
    ),
]

STUDY = TABLES + SENTENCES

STUDY_PLAN = (
    r"(?s)^.*?\n---\n",
    r"(?s)## Second question.*?\n---\n",
    r"Run on 2026-11-23",
    r"\b95 %",
    r"(?m)^\d\. ",
    r"zoom 1[45]|0\.7 to 1\.4|30 degrees",
    r"0 of 262,144",  # tests/ports/test_map_client.py
)
"""The plan was registered before anything was measured; it is never changed."""
