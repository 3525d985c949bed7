"""The figures of docs/studies/map-tiles.md."""

from __future__ import annotations

import math

from collections.abc import Callable

from docs.held import Held, Sentence, Table
from docs.held.lookups import Row, fixed, interval, one, percent, some, table_row, three, two, whole

FILES = ("lanes", "bytes", "views", "times", "machine", "client", "many")
LANES, BYTES, VIEWS, TIMES, MACHINE, CLIENT, MANY = (f"map-tiles/{name}.csv" for name in FILES)
AGAIN = "map-tiles/times-again.csv"
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


def _kept(name: str, where: dict[str, str], **view: float) -> str:
    """Return from least to most the share of the saving that stays in views."""
    chosen = one(VIEWS, triangulator=name, pitch=0, scale=1.0, turn=0, **where)
    full = 1.0 - float(chosen["ratio"])
    rows = some(VIEWS, triangulator=name, **view, **where)
    kept = [(1.0 - float(row["ratio"])) / full for row in rows]
    return f"{two(min(kept))} to {two(max(kept))}"


def views() -> list[str]:
    """Return, for each zoom, the share of the saving that stays in other views."""
    turns = [(name, turn) for name in (BEST, BEST_Q) for turn in (0, 30)]
    return [
        table_row(_named(where), *(_kept(name, where, pitch=0, turn=turn) for name, turn in turns))
        for where in _subjects()
    ]


def tilted() -> list[str]:
    """Return the same for views of a tilted camera."""
    ways = [(n, pitch, turn) for n in (BEST, BEST_Q) for pitch in (30, 60) for turn in (0, 30)]
    return [
        table_row(_named(where), *(_kept(n, where, pitch=p, turn=turn) for n, p, turn in ways))
        for where in _subjects()
    ]


def _time(where: dict[str, str], place: str, name: str) -> Row:
    return one(TIMES, where=place, name=name, **where)


def _ms(where: dict[str, str], place: str, name: str) -> float:
    return float(_time(where, place, name)["ms"])


def drawn() -> list[str]:
    """Return, for each zoom, the time to draw a tile, in ratio to ear clipping's."""
    lines = []
    for where in _subjects():
        cells = []
        for name in (REFINED, FLIPS, BEST, BEST_Q):
            row = _time(where, "draw", name)
            cells.append(f"{three(row['ratio'])} {interval(row['low'], row['high'], three)}")
        slower = two(one(MACHINE, **where)["slower"])
        lines.append(table_row(_named(where), slower, two(_ms(where, "draw", BASE)), *cells))
    return lines


def made() -> list[str]:
    """Return, for each zoom, ms a tile to triangulate it in a client and on a server."""
    ways = [("browser", name) for name in ("earcut", "refine", "l1")]
    ways += [("python", "mapbox_earcut")]
    ways += [("server", name) for name in (REFINED, FLIPS, BEST, BEST_Q)]
    return [
        table_row(_named(where), *(two(_ms(where, *way)) for way in ways)) for where in _subjects()
    ]


RATES = (1, 10, 100)
"""Mbit/s."""


def _download_ms(where: dict[str, str], name: str, rate: float) -> float:
    """Return what the triangles' bytes take a tile."""
    row = _best(name, "gzip", where)
    tiles = int(one(LANES, triangulator=name, **where)["tiles"])
    return int(row["added"]) / tiles * 8 / (rate * 1e3)


def _saved_ms(where: dict[str, str], name: str, base: str = BASE) -> float:
    """Return what a draw of a tile takes less than the base's, by ratios."""
    ratios = [float(_time(where, "draw", each)["ratio"]) for each in (base, name)]
    return _ms(where, "draw", BASE) * (ratios[0] - ratios[1])


def _draws(cost: float, saved: float) -> str:
    """Return after how many draws a cost in ms has paid."""
    if cost <= 0:
        return "at once"
    return "never" if saved <= 0 else whole(math.ceil(cost / saved))


def _at_rates(cells: list[str]) -> str:
    return " / ".join(cells)


def paid() -> list[str]:
    """Return, for each zoom, when triangles in a tile, and flips in the client, have paid."""
    lines = []
    for where in _subjects():
        earcut, flips = _ms(where, "browser", "earcut"), _ms(where, "browser", "l1")
        cells = [_at_rates([two(_download_ms(where, BEST, rate)) for rate in RATES])]
        for name in (BEST, BEST_Q):
            costs = [_download_ms(where, name, rate) - earcut for rate in RATES]
            cells.append(_at_rates([_draws(cost, _saved_ms(where, name)) for cost in costs]))
        cells.append(_draws(flips, _saved_ms(where, FLIPS)))
        costs = [_download_ms(where, BEST, rate) - earcut - flips for rate in RATES]
        cells.append(_at_rates([_draws(cost, _saved_ms(where, BEST, FLIPS)) for cost in costs]))
        lines.append(table_row(_named(where), *cells))
    return lines


def many() -> list[str]:
    """Return, for each archive, what a census of it took."""
    names = ("seconds", "core_seconds", "worker_mb", "command_mb")
    return [
        table_row(
            whole(row["polygons"]),
            whole(row["tiles"]),
            whole(int(row["file_bytes"]) / 1e6),
            *(whole(row[name]) for name in names),
            whole(row["load"]),
        )
        for row in some(MANY)
    ]


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
    Table(
        "| polygons | tiles | file, MB | seconds | core seconds | a worker, MB |"
        " the command, MB | load |",
        many,
    ),
    Table(
        "| data, zoom | H, 30 | H, 30, turned | H, 60 | H, 60, turned | Q, 30 | Q, 30, turned |"
        " Q, 60 | Q, 60, turned |",
        tilted,
    ),
    Table(
        "| data, zoom | slower | ear clipping, ms a tile | earcut-refine | L1 flips |"
        " optimum for H | optimum for Q |",
        drawn,
    ),
    Table(
        "| data, zoom | npm earcut | its refine | L1 flips | mapbox_earcut | earcut-refine |"
        " flips:l1 | optimum for H | optimum for Q |",
        made,
    ),
    Table(
        "| data, zoom | download, ms a tile | H has paid after draws | Q has paid after |"
        " flips in the client after | H against these after |",
        paid,
    ),
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


def _least_and_most(column: str, form: Callable[[object], str]) -> list[str]:
    found = [float(row[column]) for row in some(MACHINE)]
    return [form(min(found)), form(max(found))]


def one_digit(value: object) -> str:
    """Write with one digit after the point."""
    return fixed(value, 1)


def _meeting() -> list[str]:
    """Return of how many ratios of draw times the intervals of two runs meet."""
    pairs = [
        (row, one(AGAIN, where="draw", **{key: row[key] for key in ("data", "zoom", "name")}))
        for row in some(TIMES, where="draw")
        if row["name"] != BASE
    ]
    meet = sum(
        float(a["low"]) <= float(b["high"]) and float(b["low"]) <= float(a["high"])
        for a, b in pairs
    )
    return [whole(meet), whole(len(pairs))]


def _of_earcut(name: str) -> list[str]:
    found = [_ms(w, "browser", name) / _ms(w, "browser", "earcut") for w in _subjects()]
    return [two(min(found)), two(max(found))]


def _range(found: list[int]) -> list[str]:
    return [whole(min(found)), whole(max(found))]


def _flips_pay() -> list[int]:
    pairs = ((_ms(w, "browser", "l1"), _saved_ms(w, FLIPS)) for w in _subjects())
    return [math.ceil(cost / saved) for cost, saved in pairs]


def _pays_beside_flips() -> list[int]:
    found = []
    for where in _subjects():
        spared = _ms(where, "browser", "earcut") + _ms(where, "browser", "l1")
        cost = _download_ms(where, BEST, 10) - spared
        found.append(math.ceil(cost / _saved_ms(where, BEST, FLIPS)))
    return found


def _pixels(*columns: str) -> list[str]:
    return [whole(sum(int(row[name]) for row in some(CLIENT))) for name in columns]


SENTENCES += [
    Sentence(
        "Over all 40 tiles of the five zooms, {} of {} pixels differ (`client.csv`). Of these, {} are",
        lambda: _pixels("differ", "pixels", "left_out"),
    ),
    Sentence("The other {} lie less than 1/16 px from", lambda: _pixels("clipped")),
    Sentence(
        "the load was {} to {} on its two cores, and the reference draw took {} to {} of the best"
        " time known",
        lambda: [*_least_and_most("load", one_digit), *_least_and_most("slower", two)],
    ),
    Sentence(
        "`refine` takes more: {} to {} of earcut's time once more. Flips take {} to {}, so",
        lambda: [*_of_earcut("refine"), *_of_earcut("l1")],
    ),
    Sentence("of {} of {} ratios the two intervals meet", _meeting),
    Sentence("need no byte, have paid after {} to {} draws,", lambda: _range(_flips_pay())),
    Sentence("in the tile needs {} to {} draws at 10 Mbit/s", lambda: _range(_pays_beside_flips())),
    Sentence("For {} pixels there is neither reason.", lambda: _pixels("other")),
]

STUDY = TABLES + SENTENCES

STUDY_PLAN = (
    r"(?s)^.*?\n---\n",
    r"(?s)## Second question.*?\n---\n",
    r"Run on 2026-11-23",
    r"\b95 %",
    r"(?m)^\d\. ",
    r"by 30 and by 60|[HQ], [36]0|1[01]\. It holds|quads of 2x2 pixels",
    r"zooms? 1[2-6]( and 1[34])?|0\.7 to\s+1\.4|[36]0 degrees|1, 10 and 100|(1|10|100) Mbit/s|blocks of 4x4",
    r"0 of 262,144|less than 1/16 px|all 40 tiles",  # tests/ports/test_map_client.py
)
"""The plan was registered before anything was measured; it is never changed."""
