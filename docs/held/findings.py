"""The figures of docs/findings.md and of its tables."""

from __future__ import annotations

from docs.held import Held, Sentence, Table, flips, profiles, tables
from docs.held.lookups import matched, one, percent, three, two, whole
from docs.held.others import apart, states
from harness.figures.ratios import RUN_SCATTER

FIRST: list[Held] = [
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
            percent(max(map(tables.slower, tables.SCENES)), 1),
        ],
    ),
    Sentence(
        "its error is {} % (root mean square). H + T, the first order of it, is off by {} %",
        lambda: [tables.error_of_prediction(1), tables.error_of_prediction(2)],
    ),
    Sentence(
        "by helper lanes with a correlation of {}, H with {} and the paper's A with {}",
        lambda: [
            three(tables.correlation(c, "helper_lanes")["value"])
            for c in ("expected_quads", "half_perimeter", "overdraw")
        ],
    ),
    Sentence(
        "trusting Q costs at most {} % more helper lanes on any of the four scenes. Trusting H"
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
        "Of {} correlations with counters, {} are equal to the last digit. Those with times differ"
        " by at most {}.",
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
        "| | helper lanes | time, work 0 | time, work 8 | box tests | time, box walk |",
        tables.predicts,
    ),
    Sentence(
        "H has a rank correlation of {}, {} and {} with helper lanes, and A has {}, {} and {} (12",
        lambda: tables.lanes_of("half_perimeter") + tables.lanes_of("overdraw"),
    ),
    Sentence(
        "With time, H has {} and A {} on zink, {} and {} on OSMesa, {} and {} on softpipe. On a"
        " rasteriser that walks rows, all criteria predict the time badly: H has {}.",
        lambda: [
            *(tables.city("zink", c, "time_work_0") for c in ("half_perimeter", "overdraw")),
            *(
                tables.city("osmesa", c, "time_work_0", "osmesa")
                for c in ("half_perimeter", "overdraw")
            ),
            *(tables.city("softpipe", c, "time_work_0") for c in ("half_perimeter", "overdraw")),
            tables.city("llvmpipe", "half_perimeter", "time_work_0", "scanline"),
        ],
    ),
    Table("| viewport | city: Q | H | A | Helsinki: Q | H | A |", tables.sizes),
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
        " {} % more at 256 px. H's choice shades at most {} % more at 1024 px, A's at most {} %.",
        lambda: [
            percent(max(tables.quads_regret(px, who)), 2)
            for px, who in ((1024, "Q"), (256, "Q"), (1024, "H"), (1024, "A"))
        ],
    ),
    Table(
        "| chosen by | city, 256 px | Helsinki, 256 px | letters, 256 px | city, 1024 px"
        " | Helsinki, 1024 px | letters, 1024 px |",
        tables.regrets_of_times,
    ),
    Sentence(
        "At 256 px, H costs {} % on llvmpipe and {} % on zink, Q {} and {} %, A {} and {} %,"
        " Delaunay {} and {} %, D {} and {} %, ear clipping {} and {} %. At 1024 px, H costs {} and"
        " {} %, Q {} and {} %, A {} and {} %, ear clipping {} and {} %.",
        lambda: [
            figure
            for px, names in (
                (256, ("H", "Q", "A", "Delaunay", "D", "ear clipping")),
                (1024, ("H", "Q", "A", "ear clipping")),
            )
            for who in names
            for figure in tables.pair(who, px)
        ],
    ),
    Sentence(
        "the 500 footprints of the city at 1024 px have {} helper lanes. The optimum for H has {},"
        " ear clipping {}. What is above the limit is the price of diagonals. Choosing them well"
        " saves {} % of the price",
        tables.limit,
    ),
    Sentence(
        "D's advantage over H is then {} % (`llvmpipe/gains-glyphs-shuffled`), in place of {} %.",
        lambda: [tables.d_over_h("shuffled"), tables.d_over_h("native")],
    ),
    Sentence(
        "reach at most {} to either side up to 1024 px on city, Helsinki and letters, and at most"
        " {} elsewhere.",
        lambda: [tables.widest(True), tables.widest(False)],
    ),
    Table(
        "| scene, px | Delaunay | `refine` | greedy | manifold | best for A | best for Q |"
        " L1 flips | `refined` | best for H | **calibrated** | calibrated over Delaunay |",
        tables.choice,
    ),
    Sentence(
        "the calibrated optimum is {} and {} % faster than the best for H, and the best for D is"
        " faster than the best for H, too, by {} and {} %.",
        lambda: [
            tables.faster(n, px) for n in (tables.CALIBRATED, "optimal:shape") for px in (256, 512)
        ],
    ),
    Sentence(
        "takes {} and {} of ear clipping's time on zink, {} and {} on OSMesa",
        lambda: [
            tables.on(d, tables.CALIBRATED, px) for d in ("zink", "osmesa") for px in (256, 1024)
        ],
    ),
    Sentence(
        "1024 px: it takes {}, the best for H takes {} and Delaunay {}. There the paper is right."
        " On a rasteriser that walks rows, the best for H takes {} and {}, the best for A {} and"
        " {}.",
        lambda: [
            *(tables.boxes(n, 1024) for n in ("optimal:overdraw", tables.BEST_FOR_H, "delaunay")),
            *(
                tables.boxes(n, px, "scanline")
                for n in (tables.BEST_FOR_H, "optimal:overdraw")
                for px in (256, 1024)
            ),
        ],
    ),
    Sentence(
        "run the vertex shader {} times. The optimum's, walked from neighbour to neighbour, run it"
        " {} times",
        lambda: [
            whole(tables.of("gains-glyphs", n, 256)["driver_vertex_invocations"])
            for n in ("delaunay", tables.BEST_FOR_H)
        ],
    ),
    Table(
        "| | city: own | cache | walk | Helsinki: own | cache | walk | letters: own | cache | walk"
        " | counties: own | cache | walk |",
        tables.orders,
    ),
    Sentence(
        "its own order costs it {} % on the city, {} % on Helsinki, {} % on letters and {} % on"
        " counties",
        tables.own_order_costs,
    ),
    Sentence(
        "its helper lanes rise from {} of ear clipping's to {}, and its time from {} to {}. The"
        " best for H stays within {} % of one that is triangulated anew at each angle: its time is"
        " {} to {} and its lanes {} to {} of ear clipping's.",
        lambda: [
            two(tables.rotated("optimal:overdraw@0", "helper_lanes")[0]),
            two(max(tables.rotated("optimal:overdraw@0", "helper_lanes"))),
            two(tables.turned("optimal:overdraw@0")[0]),
            two(max(tables.turned("optimal:overdraw@0"))),
            percent(
                max(
                    a / b - 1.0
                    for a, b in zip(
                        tables.turned(f"{tables.BEST_FOR_H}@0"),
                        tables.turned(tables.BEST_FOR_H),
                        strict=True,
                    )
                ),
                1,
            ),
            two(min(tables.turned(f"{tables.BEST_FOR_H}@0"))),
            two(max(tables.turned(f"{tables.BEST_FOR_H}@0"))),
            two(min(tables.rotated(f"{tables.BEST_FOR_H}@0", "helper_lanes"))),
            two(max(tables.rotated(f"{tables.BEST_FOR_H}@0", "helper_lanes"))),
        ],
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
    Sentence(
        "after {} draws of the city, {} of Helsinki and {} of the counties, at 1024 px on"
        " llvmpipe; `refined` after {}, {} and {}",
        lambda: tables.break_even(tables.BEST_FOR_H) + tables.break_even(tables.REFINED),
    ),
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
        "for each of {} generated footprints and all scenes",
        lambda: matched("llvmpipe/optimum-equality.txt", r"footprints on the device: ([\d,]+)"),
    ),
    flips.BOUGHT,
    flips.SMALL,
    flips.PAID,
    Table(
        "| | best for H | refined | best for Q | best for A | Delaunay | Q | H | A |",
        tables.on_devices,
    ),
    Sentence(
        "interval holds the truth: in {} % of them or more, and in {} % or more where one polygon has"
        " a quarter of the sum",
        tables.covering,
    ),
    Sentence("Of 11 findings, {}, {}, {} and {} hold on them.", tables.holding),
    Sentence(
        "the best for H takes {} of ear clipping's time on the city in a run of fifteen"
        " triangulators, and {} in one of seven",
        lambda: [
            two(tables.drawn("city", 1024, tables.BEST_FOR_H)),
            two(one("llvmpipe/city/summary.csv", triangulator=tables.BEST_FOR_H)["time_ratio"]),
        ],
    ),
    Table(
        "| processor | beside the run | runs | reference draw, ms | best for H | Delaunay |", states
    ),
    Sentence(
        "{} of {} pairs are further apart than both allow, and {} of {} pairs of runs in four"
        " processes each. Chance gives one in twenty. So an interval holds by how much runs"
        " scatter as well, which the first of these told: with that it is {} and {} of these"
        " pairs, and {} of {} on the second processor.",
        lambda: [n for place, n in enumerate(apart()) if place not in (5, 7)],
    ),
    Sentence(
        "measured on an AMD EPYC {}/{} before",
        lambda: list(matched("llvmpipe/states.txt", r"AMD EPYC (\d+)/(\d+), ")),
    ),
    Sentence(
        "Of {} ratios of times, {} differ by less than 1 % from those measured here, {} by more than"
        " 3 %; the most is {} %.",
        lambda: [
            str(len(shares := tables.on_two_processors())),
            str(sum(each < 0.01 for each in shares)),
            str(sum(each > 0.03 for each in shares)),
            percent(max(shares), 1),
        ],
    ),
    Sentence("from one run to the next: {} %", lambda: [f"{100 * RUN_SCATTER:g}"]),
    *profiles.TABLES,
]

DEFINITIONS = (
    r"\b95 %|less than 1 % from|more than 3 %",
    r"\b\d+( and \d+)? px",
    r"\b\d+ and 1024 px",
    r"\b256 and 512",
    r"\b\d+ (city )?polygons|counties: \d+|\d+ footprints of the city",
    r"2x2|4x4|1/256|1/16|4q|4Q|Below 1 ",
    r"earcut 3\.2|work [08] |up to 50 triangulations|700 designed draws|of 1,024 indices",
    r"With 64 it|With 4 samples",
    r"0 to 90 degrees in steps of 5|at 0 degrees",
    r"A = \d+|\b3D models|18 of the 47|the 29 without|All 47",
    r"\b(1|8|64):1|:1 (and|on)|of 8 and of 64 px\^2|64x64|16 px|, 24 of each scene",
    r"with 2 % of the resamples|it is 1 % now",
    r"costs at most 1 %\s+more quads|correlation of 0\.95 or more",
    r"3 % of one drawing's|Of 11 findings|below 1 % are not|within 3 % of each other",
    r"A model of sums from coordinates was fitted(?s:.*?)pixel of H 8\.0 ns",
    r"run the same number of instructions, to 0\.1 %(?s:.*?)at commit cebf081",
    r"sheet metal with cut-outs saves 23 to 33 %[^.]*5 to 8 %",
    r"Of the 47 triangulations(?s:.*?)conforming alone [^\n]*",
    r"above both simple rules(?s:.*?)0\.48 of its time|[Ww]ith it, 2\.96(?s:.*?)commit 280b409",
)
"""Not measured, or at a commit that is named: what was chosen, levels of confidence, exact counts that tests of the code hold."""
