"""The figures of docs/findings.md and of its tables."""

from __future__ import annotations

import math
import operator

from docs.held import Held, Sentence, Table, flips, profiles, simulated, tables
from docs.held.lookups import percent, three, two
from docs.held.others import apart, intervals, states
from harness.figures.intervals import RUN_SCATTER

FIRST: list[Held] = [
    simulated.IN_SHORT,
    simulated.WITH_SHADER,
    *simulated.IN_WHOLE,
    Sentence("one CPU, an AMD EPYC {}/{} ({}-bit) unless", tables.processor),
    Sentence(
        "in {} of ear clipping's time for city footprints, in {} for Helsinki's, in {} for letters"
        " and in {} for counties. Delaunay's triangles take {}, {}, {} and {}.",
        lambda: [
            two(tables.drawn(s, 1024, n))
            for n in (tables.BEST_FOR_H, "delaunay")
            for s in tables.SCENES
        ],
    ),
    Sentence(
        "its drawings take {} to {} % longer than those of the best for H",
        lambda: [
            percent(min(map(tables.slower, tables.SCENES)), 1),
            f"{math.ceil(1000 * max(map(tables.slower, tables.SCENES))) / 10:g}",
        ],
    ),
    Sentence(
        "its error in a scene's helper lanes, in ratio to ear clipping's, is {} % (root mean"
        " square of the log ratio). That of H + T, the first order of it, is {} %.",
        lambda: [tables.error_of_prediction(1), tables.error_of_prediction(2)],
    ),
    Sentence(
        "by helper lanes with a median correlation of {}, H with {} and the paper's A with {}",
        lambda: [
            three(tables.correlation(c, "helper_lanes")["value"])
            for c in ("expected_quads", "half_perimeter", "overdraw")
        ],
    ),
    Sentence(
        "trusting Q costs a mean of up to {} % more helper lanes on the four scenes. Trusting H"
        " costs {} to {} %. Trusting A costs {} % on letters and {} % on counties; ear clipping"
        " costs {} % and {} %.",
        lambda: [
            max((tables.worst(s, "Q") for s in tables.SCENES), key=float),
            min((tables.worst(s, "H") for s in tables.SCENES), key=float),
            max((tables.worst(s, "H") for s in tables.SCENES), key=float),
            *(
                tables.worst(s, who)
                for who in ("A", "ear clipping")
                for s in ("glyphs", "counties")
            ),
        ],
    ),
    Sentence(
        "Of {} correlations with counters, {} are equal to the last digit. Those with times, within"
        " polygons, differ by up to {}.",
        tables.again,
    ),
    Sentence(
        "Of {} comparisons of equal code, half of them while another program came and went, {}"
        " were called a regression; of {} in which 3 % of one drawing's triangles were drawn"
        " twice, {} were found",
        tables.called,
    ),
    *profiles.FIRST,
]
"""The first page's."""

TABLES: list[Held] = [
    Table(
        "| | helper lanes | partial quads | time, work 0 | time, work 8 | box tests"
        " | time, box walk |",
        tables.predicts,
    ),
    Table(
        "| helper lanes, viewport | city: Q | H | A | Helsinki: Q | H | A |",
        tables.sizes("helper_lanes"),
    ),
    Table(
        "| partial quads, viewport | city: Q | H | A | Helsinki: Q | H | A |",
        tables.sizes("partial_quads"),
    ),
    Sentence(
        "With helper lanes H has {}, D {} and A {}. Q, the best within a polygon, has {},",
        lambda: [
            tables.pooled(c) for c in ("half_perimeter", "shape", "overdraw", "expected_quads")
        ],
    ),
    Sentence(
        "the mean over {} polygons of the city that fill the viewport, {} of Helsinki, {} letters"
        " and {} counties",
        lambda: [
            tables.regret("cpu", scene, 1024, "H", "helper_lanes")["polygons"]
            for scene in tables.SCENES
        ],
    ),
    Table(
        "| chosen by | city, 256 px | city, 1024 px | Helsinki, 256 px | Helsinki, 1024 px |",
        tables.regrets("city", "helsinki"),
    ),
    Table(
        "| chosen by | letters, 256 px | letters, 1024 px | counties, 256 px | counties, 1024 px |",
        tables.regrets("glyphs", "counties"),
    ),
    Sentence(
        "at most {} % more quads than the best possible at 1024 px on all four scenes, and at most"
        " {} % more at 256 px. At 1024 px the largest mean is {} % for H's choice and {} % for"
        " A's.",
        lambda: [
            percent(max(tables.quads_regret(px, who)), 2)
            for px, who in ((1024, "Q"), (256, "Q"), (1024, "H"), (1024, "A"))
        ],
    ),
    Sentence(
        "the 500 footprints of the city at 1024 px have {} helper lanes. The optimum for H has {},"
        " ear clipping {}. What is above the limit is the price of diagonals. Choosing them well"
        " saves {} % of the price",
        tables.limit,
    ),
    Sentence(
        "reach at most {} to either side up to 1024 px on city, Helsinki and letters, and at most"
        " {} elsewhere.",
        lambda: [tables.widest(True), tables.widest(False)],
    ),
    Table(
        "| scene, px | Delaunay | `refine` | greedy | manifold | best for A | best for Q |"
        " `flips:beauty` | L1 flips | `refined` | best for H | **calibrated** |"
        " calibrated over Delaunay |",
        tables.choice,
    ),
    Sentence(
        "1024 px: it takes {}, the best for H takes {} and Delaunay {}. On one that walks"
        " rows, at 256 and 1024 px, the best for H takes {} and {}, the best for A {} and {}.",
        lambda: [
            *(tables.boxes(n, 1024) for n in ("optimal:overdraw", tables.BEST_FOR_H, "delaunay")),
            *(
                tables.boxes(n, px, "scanline")
                for n in (tables.BEST_FOR_H, "optimal:overdraw")
                for px in (256, 1024)
            ),
        ],
    ),
    Table(
        "| | city: own | cache | walk | Helsinki: own | cache | walk | letters: own | cache | walk"
        " | counties: own | cache | walk |",
        tables.orders,
    ),
    Sentence(
        "in its own order its ratio is {} % above that of a walk on the city, {} % on Helsinki,"
        " {} % on letters and {} % on counties",
        tables.own_order_costs,
    ),
    Sentence(
        "With one iteration, the calibrated optimum takes {} of ear clipping's time. With 64 it"
        " takes {}; there the best for Q takes {}. With 4 samples and one iteration it takes {}.",
        lambda: [
            tables.work(tables.CALIBRATED, 1, 1),
            tables.work(tables.CALIBRATED, 64, 1),
            tables.work("optimal:expected-quads", 64, 1),
            tables.work(tables.CALIBRATED, 1, 4),
        ],
    ),
    Sentence("In partial quads, counted later, it is {} and {}.", tables.of_the_paper),
    Sentence(
        "{} points of the Pareto fronts of A and D were drawn beside the least-A ends",
        lambda: [str(sum(tables.fronts("opengl").values()))],
    ),
    Sentence(
        "{} of them are shown to be faster than their end. On OpenGL, {} are faster and {} are"
        " slower.",
        lambda: [
            str(tables.fronts("bounding-box")["faster"]),
            str(tables.fronts("opengl")["faster"]),
            str(tables.fronts("opengl")["slower"]),
        ],
    ),
    Sentence(
        "for each of {} generated footprints and the scenes' rings, solved {} times",
        tables.on_the_device,
    ),
    Sentence(
        "they rise from {} of ear clipping's to {}.",
        lambda: [
            two(end(tables.rotated("optimal:overdraw@0", "helper_lanes")))
            for end in (operator.itemgetter(0), max)
        ],
    ),
    flips.PARTIAL,
    flips.PAID,
    Table(
        "| | best for H | refined | best for Q | best for A | Delaunay | Q | H | A |",
        tables.on_devices,
    ),
    Sentence("Of 11 findings, {}, {}, {} and {} hold on them.", tables.holding),
    Table(
        "| beside the run | runs | quiet | disturbed | not to be trusted | reference draw, ms"
        " | best for H | false regressions | wrong sentences | planted, found |",
        states,
    ),
    Sentence("{} of {} pairs of quiet runs' ratios to ear clipping differ", apart),
    Sentence("from one run to the next: {} %", lambda: [f"{100 * RUN_SCATTER:g}"]),
    *profiles.TABLES,
    Table("| interval of | kinds of data | holds, least | a simpler one | not kept |", intervals),
]

DEFINITIONS = (
    r"the table is\s+at commit 280b409",
    r"\b95 %|500 areas of Helsinki|one of 1 % more quads|up to 64 corners",
    r"\b\d+( and \d+)? px",
    r"\b\d+ (city )?polygons|\d+ footprints of the city",
    r"2x2|4x4|4q|4Q",
    r"work [08] |up to 80 triangulations",
    r"With 64 it|With 4 samples",
    r"0 to 90 degrees in steps of 5|at 0 degrees",
    r"A = \d+|All 47",
    r"triangles of 8 px\^2|\b16:1|request 82887",
    r"\b(1|8|64):1|:1 (and|on)|of 8 and of 64 px\^2|64x64|16 px|, 24 of each scene",
    r"from 11 to 16 px",
    r"by 8 to 28 %(?s:.*?)group of draws",  # of laws.py
    r"the truth is known, 2,000|of laws 400 devices|in 93 %",  # of interval_coverage.py
    r"costs at most 1 %\s+more quads|correlation of 0\.95 or more",
    r"3 % of one drawing's|Of 11 findings|below 3 % are not|to within 0\.04",
    r"12 polygons are wide",
    r"Of the 47 triangulations(?s:.*?)conforming alone [^\n]*",
    r"above both simple rules(?s:.*?)0\.48 of its time|[Ww]ith it, 2\.96(?s:.*?)commit 280b409",
)
"""Not measured, or at a commit that is named: what was chosen, levels of confidence, exact counts
that tests of the code hold."""
