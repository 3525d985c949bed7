"""Decisions: the sentence, the table and the ranking of a group agree; break-even."""

import io
import itertools
import math

import numpy as np
import pytest
from rich.console import Console

from harness.metrics import break_even as break_even_module
from harness.metrics import decision as decision_module
from harness.metrics.break_even import BreakEven, _solve_interval_end
from harness.metrics.decision import decide_run, format_advice
from harness.metrics.groups import compute_time_ratio
from harness.metrics.statistics import RUN_SCATTER
from harness.report.content import make_content
from harness.summary import VERDICTS, list_rows, print_summary
from tests.harness.test_summary import SAMPLES, record, show
from tests.records import make_group, make_record, make_run

DRAWS = {"faster": 0.9, "level": 1.0, "slower": 1.1, "untimed": None}
TRIANGULATING = {"quicker": 0.2, "longer": 0.9, "once": 0.9, "unknown": None}
COUNTS = {"fewer": 900, "same": 1000, "more": 1100}


def make_fields(name, draws="level", triangulating="longer", counts="same", **changes):
    factor, seconds = DRAWS[draws], TRIANGULATING[triangulating]
    fields = record(name, factor or 1.0, counters={"helper_lanes": COUNTS[counts]}, **changes)
    noise = np.random.default_rng(len(name)).permutation(SAMPLES)
    if factor is None:
        del fields["time"]
    elif name != "ear-clipping":
        samples = 100 * factor * (0.9 * np.array(SAMPLES) + 0.1 * noise)
        fields["time"] |= {"samples_s": samples.tolist(), "median_s": float(np.median(samples))}
    if seconds is not None:
        fields["triangulate_s"] = seconds
        if triangulating != "once":
            fields["triangulate_samples_s"] = [seconds * (1 + 0.01 * k) for k in range(6)]
    return fields


def base():
    samples_s = [0.5 * (1 + 0.01 * k) for k in range(6)]
    return make_fields("ear-clipping") | {"triangulate_s": 0.5, "triangulate_samples_s": samples_s}


def decide(records):
    return decision_module.decide_group(make_group(records))


def break_even(record, base):
    typed = [make_record(**fields) for fields in (record, base)]
    if record is base:
        typed[1] = typed[0]
    return break_even_module.compute_break_even(*typed, compute_time_ratio(*typed))


NAMES = ("ear-clipping", "delaunay", "greedy")
COMBINATIONS = list(itertools.product(DRAWS, TRIANGULATING, COUNTS))


def make_priced(name, factor, seconds, **changes):
    """Return a record with draws of `factor` times the base's, triangulated in `seconds`."""
    fields = make_fields(name, "faster", **changes) | {"triangulate_s": seconds}
    samples = (np.array(fields["time"]["samples_s"]) * factor / DRAWS["faster"]).tolist()
    fields["time"] |= {"samples_s": samples, "median_s": float(np.median(samples))}
    return fields


@pytest.mark.parametrize(
    ("factor", "seconds", "chosen"),
    [
        (0.83, 0.6, "greedy"),  # 17 of 20 %
        (0.85, 0.6, "delaunay"),  # 15 of 20 %
        (0.83, 0.95, "delaunay"),  # not cheaper
        (0.83, None, "delaunay"),
    ],
)
def test_cheapest_triangulator_with_most_of_the_saving_is_recommended(factor, seconds, chosen):
    records = [base(), make_priced("delaunay", 0.8, 0.9), make_priced("greedy", factor, seconds)]
    decision = decide(records)
    assert (decision.choice.name, decision.best.name) == (chosen, "delaunay")
    sentence = format_advice(decision)
    assert f": {chosen}, the cheapest triangulator with most of the saving: " in sentence
    assert ("; delaunay saves the most, 20." in sentence) == (chosen == "greedy")
    ratio = decision.choice.ratio
    saved, high, low = (100 * (1 - end) for end in (ratio.value, ratio.low, ratio.high))
    interval = f"(95 % CI {math.floor(10 * low) / 10}-{math.ceil(10 * high) / 10} %)"
    assert f"saving: {saved:.1f} % of ear-clipping's draw time {interval}" in sentence


def test_counts_recommend_by_the_same_rule():
    fewest = make_fields("delaunay", "untimed", counts="fewer")
    cheap = make_fields("greedy", "untimed") | {"triangulate_s": 0.1}
    for lanes, chosen in ((919, "greedy"), (921, "delaunay")):
        cheap["counters"] = {"helper_lanes": lanes}
        decision = decide([base(), fewest, cheap])
        assert (decision.choice.name, decision.best.name) == (chosen, "delaunay")
    cheap["counters"] = {"helper_lanes": 919}
    sentence = format_advice(decide([base(), fewest, cheap]))
    assert ": greedy, the cheapest triangulator with most of the saving: 919 helper" in sentence
    assert "; delaunay has the lowest exact count, 900 helper lanes, 10.0 % fewer" in sentence


@pytest.mark.parametrize(("draws", "triangulating", "counts"), COMBINATIONS)
def test_sentence_table_and_ranking_agree(draws, triangulating, counts):
    """A second triangulator in each combination of states, and a third that is slower."""
    other = make_fields("delaunay", draws, triangulating, counts)
    slow = make_fields("greedy", "slower" if draws != "untimed" else "untimed", counts="more")
    first = base()
    if draws == "untimed":
        del first["time"]
    records = [first, other, slow]
    decision = decide(records)
    sentence = format_advice(decision)
    lines = show(records, width=160).splitlines()
    rows = {word: line for line in lines[2:] if (word := (line.split() or [""])[0]) in NAMES}
    content = make_content(make_run(records))
    cases = {case["row"]["triangulator"]: case for case in content["cases"]}
    assert list(rows) == [standing.name for standing in decision.standings]
    assert sorted(cases, key=lambda name: cases[name]["rank"]) == list(rows)
    assert content["groups"][0]["answer"] == sentence
    assert sentence in " ".join(line.strip() for line in lines)
    assert ("break-even" in lines[1]) == any(each.break_even for each in decision.standings)
    for standing in decision.standings:
        row = cases[standing.name]["row"]
        if standing is decision.base or standing.ratio is None:
            continue
        assert row["verdict"] == standing.ratio.verdict
        break_even_text = row.get("break_even")
        assert (break_even_text is None) == (standing.break_even is None)
        if break_even_text is not None:
            assert rows[standing.name].rstrip().endswith(standing.break_even.short_text)
            assert break_even_text == standing.break_even.text
            is_saving = break_even_text.startswith(("after", "at once"))
            assert is_saving == (row["verdict"] == "faster")
            undecided = break_even_text == "not significant"
            assert undecided == (row["verdict"] == "not significant")
            slower = break_even_text.startswith(("never", "up to"))
            assert slower == (row["verdict"] == "slower")
        elif any(other.break_even for other in decision.standings):
            assert rows[standing.name].rstrip().endswith(VERDICTS[row["verdict"]])
    chosen = ": delaunay, the cheapest triangulator with most of the saving: "
    assert (f"{chosen}10.2 % of ear-clipping's draw time" in sentence) == (draws == "faster")
    if draws == "faster":
        break_even_text = {"quicker": ", break-even at once", "once": ", break-even after about"}
        break_even_text["unknown"] = " %)"
        assert break_even_text.get(triangulating, ", break-even after ") in sentence
    elif draws == "slower":
        assert ": ear-clipping; all other triangulators are significantly slower" in sentence
    elif counts == "fewer":
        assert f"{chosen}900 helper lanes, 10.0 % fewer than ear-clipping" in sentence
        assert ("no time is significantly lower" in sentence) == (draws == "level")
    else:
        assert ": ear-clipping; no other" in sentence or ": ear-clipping has the" in sentence


def test_choice_is_significantly_faster_even_if_ranked_second():
    wild = make_fields("delaunay", "faster")
    samples = np.array(wild["time"]["samples_s"]) * np.array([0.5, 1.6] * 4)
    wild["time"] |= {"samples_s": samples.tolist(), "median_s": 0.08}
    sure = make_fields("greedy", "faster")
    decision = decide([base(), wild, sure])
    assert [standing.name for standing in decision.standings].index("delaunay") < 2
    assert decision.standings[0].ratio.verdict != "slower"
    assert decision.choice.name == "greedy"


def test_no_recommendation_if_every_triangulator_skipped_polygons():
    drawn = {"fan": 229, "strip": 100, "delaunay": 499}
    records = [
        make_fields(name, verdict, polygons=drawn[name], polygons_skipped=500 - drawn[name])
        for name, verdict in zip(drawn, ("faster", "faster", "slower"), strict=True)
    ]
    decision = decide(records)
    assert [standing.name for standing in decision.standings] == ["delaunay", "fan", "strip"]
    assert not any(standing.complete for standing in decision.standings)
    assert not decision.timed
    obstacle = "every triangulator skipped polygons (delaunay drew the most: 499 of 500)."
    assert format_advice(decision).endswith(f": {obstacle}")
    decision = decide([*records, base()])
    assert decision.choice.name == decision.standings[0].name == "ear-clipping"
    assert [standing.complete for standing in decision.standings] == [True, False, False, False]


@pytest.mark.parametrize(("covered", "advised"), [(0, False), (1, False), (63, False), (64, True)])
def test_no_recommendation_below_the_minimum_of_pixels(covered, advised):
    records = [base(), make_fields("delaunay", "faster")]
    for fields in records:
        fields["counters"] |= {"fragments": covered}
    sentence = format_advice(decide(records))
    assert (": delaunay, the cheapest " in sentence) is advised
    pixels = "1 pixel" if covered == 1 else f"{covered} pixels"
    ending = f": the polygons cover {pixels} in all (at least 64 are needed)."
    assert sentence.endswith(ending) is not advised


def test_few_pixels_choose_the_first_complete_record():
    part = base() | {"polygons": 400, "polygons_skipped": 100}
    records = [part, make_fields("greedy", "slower"), make_fields("delaunay", "faster")]
    for fields in records:
        fields["counters"] |= {"fragments": 9}
    decision = decide(records)
    assert (decision.reason, decision.choice.name) == ("few pixels", "delaunay")


def test_base_is_kept_if_counters_and_times_are_equal():
    decision = decide([base(), make_fields("delaunay")])
    ending = ": ear-clipping; no other triangulator is significantly faster, and none saves 1 %"
    assert format_advice(decision).endswith(f"{ending} by exact count.")
    assert decision.choice.name == "ear-clipping"


@pytest.mark.parametrize(("quads", "decides"), [(996, False), (991, False), (989, True)])
def test_counter_decides_if_it_saves_one_percent_of_the_shaded_lanes(quads, decides):
    """1 % of the quads may be a large share of the helper lanes."""
    first, other = base(), make_fields("delaunay")
    for entry, count in ((first, 1000), (other, quads)):
        entry["counters"] = {"helper_lanes": 4 * count - 3900, "quads": count, "fragments": 3900}
    decision = decide([first, other])
    assert decision.reason == ("counter" if decides else "undecided")
    assert (decision.choice.name == "delaunay") == decides


def test_count_is_compared_with_the_base_only_for_equal_polygons():
    complete, part = base(), base() | {"polygons": 400, "polygons_skipped": 100}
    fewer, more = make_fields("delaunay", counts="fewer"), make_fields("greedy", counts="more")
    count = "delaunay, the cheapest triangulator with most of the saving: 900 helper lanes"
    sentence = format_advice(decide([complete, fewer, more]))
    assert f"{count}, 10.0 % fewer than ear-clipping" in sentence
    for records in ([part, fewer, more], [complete, more]):
        decision = decide(records)
        assert decision.reason == "counter"
        assert "fewer than" not in format_advice(decision)


def test_no_recommendation_without_or_with_one_record():
    assert decide([]) is None
    assert format_advice(decide([])).startswith("No recommendation: no case was measured")
    sentence = format_advice(decide([base()]))
    assert "ear-clipping has no other triangulator to compare with" in sentence


def test_untimed_records_rank_by_counter_relative_to_the_base():
    greedy = make_fields("greedy", "untimed", counts="fewer")
    records = [greedy, make_fields("ear-clipping", "untimed")]
    costs = [(entry.name, entry.cost) for entry in decide(records).standings]
    assert costs == [("greedy", pytest.approx(0.9)), ("ear-clipping", 1.0)]
    for entry in records:
        entry["counters"] = {}
    assert [entry.cost for entry in decide(records).standings] == [math.inf, math.inf]


def test_record_without_time_ranks_by_a_metric_of_both():
    untimed = make_fields("delaunay", "untimed", counts="more")
    names = [s.name for s in decide([base(), untimed, make_fields("greedy", "faster")]).standings]
    assert names == ["greedy", "ear-clipping", "delaunay"]
    del untimed["counters"]
    assert decide([base(), untimed]).standings[-1].cost == math.inf


def test_first_of_equal_counts_is_chosen_over_a_higher_one():
    equal = [make_fields(name, "untimed", counts="fewer") for name in ("delaunay", "greedy")]
    decision = decide([make_fields("ear-clipping", "untimed"), *equal])
    assert (decision.reason, decision.choice.name) == ("counter", "delaunay")


def test_incomplete_default_base_is_not_chosen():
    part, complete = base() | {"polygons": 400}, [make_fields("delaunay"), make_fields("greedy")]
    decision = decide([part, *complete])
    assert (decision.base.name, decision.choice.name) == ("ear-clipping", "delaunay")
    assert not decision.timed
    assert not decide([base(), make_fields("delaunay", "untimed")]).timed
    assert decide([base(), make_fields("delaunay")]).timed


@pytest.mark.parametrize(
    ("polygons", "expected"), [((3, 5, 5), "b"), ((None, 1, 1), "b"), ((None, None, None), "a")]
)
def test_default_base_is_the_first_with_most_polygons(polygons, expected):
    measured = [make_record(name, polygons=n) for name, n in zip("abc", polygons, strict=True)]
    assert make_group([make_record("z", status="failed"), *measured]).base.name == expected
    assert make_group([]).base is None


ROUNDS = 12


def make_timed(name, seconds, factor=1.0, scatter=0.0, seed=0):
    """Return a record with draws of `factor` times 0.1 s and triangulation times of `seconds`."""
    noise = np.random.default_rng(seed).normal(0, scatter, ROUNDS)
    samples = (seconds * (1 + noise - noise.mean())).tolist()
    return record(name, factor, triangulate_s=seconds, triangulate_samples_s=samples)


BASE = make_timed("ear-clipping", 0.5)


def test_break_even_is_extra_time_over_saving_per_draw():
    even = break_even(make_timed("optimal", 1.49, 0.8), BASE)  # 0.02 s of 0.1 s less
    # The draw times have no scatter: the interval is the scatter between runs.
    saved = 0.1 * (1 - 0.8 * np.exp([RUN_SCATTER * 1.96, -RUN_SCATTER * 1.96]))
    low, high = sorted(0.99 / saved)
    assert (even.draws, even.low, even.high) == pytest.approx((49.5, low, high), rel=1e-4)


def test_scatter_of_either_time_widens_the_interval():
    exact = make_timed("optimal", 1.5, 0.8)
    rough = make_timed("optimal", 1.5, 0.8, scatter=0.1)
    even = break_even(rough, BASE)
    assert even.draws == pytest.approx(50)
    student = 2.2009851600916384  # 11 degrees of freedom
    reach = student * np.std(rough["triangulate_samples_s"], ddof=1) / math.sqrt(ROUNDS) / 0.02
    drawing = 50 * 0.8 * RUN_SCATTER * 1.96 / 0.2
    combined = math.hypot(reach, drawing)
    assert (even.low, even.high) == pytest.approx((50 - combined, 50 + combined), rel=3e-3)
    rng = np.random.default_rng(1)
    draws = {"samples_s": (0.08 * rng.lognormal(0, 0.02, 8)).tolist()}
    noisy = {**exact, "time": {**exact["time"], **draws}}
    steady = {**BASE, "time": {**BASE["time"], "samples_s": [0.1] * 8, "ci95_s": [0.1, 0.1]}}
    single = break_even(noisy, steady)
    assert single.low < 50 < single.high
    unsure = {**steady, "time": {**steady["time"], "ci95_s": [0.09, 0.11]}}
    wider = break_even(noisy, unsure)
    assert wider.low < single.low < single.high < wider.high
    both = {**noisy, "triangulate_samples_s": rough["triangulate_samples_s"]}
    combined = break_even(both, steady)
    assert combined.low < single.low < single.high < combined.high


@pytest.mark.parametrize(
    ("factor", "seconds", "text", "short_text"),
    [
        (0.8, 1.49, "after 50 draws (48 to 51)", "50 (48-51)"),
        *((0.8, seconds, "at once", "at once") for seconds in (0.4, 0.5)),
        *((1.0, seconds, "not significant", "n.s.") for seconds in (1.5, 0.4)),
        *((1.25, seconds, "never (slower)", "never") for seconds in (1.5, 0.5)),
        (1.25, 0.24, "up to 10 draws (10 to 11)", "up to 10 (10-11)"),
    ],
)
def test_break_even_text_of_each_combination(factor, seconds, text, short_text):
    even = break_even(make_timed("other", seconds, factor), BASE)
    assert (even.text, even.short_text) == (text, short_text)


def test_break_even_without_rounds_has_no_interval():
    base = record("ear-clipping", triangulate_s=0.5)
    even = break_even(record("optimal", 0.8, triangulate_s=1.49), base)
    assert even.text == "after about 50 draws (triangulated once)"
    assert (even.short_text, even.low, even.high) == ("50 (?)", None, None)


def test_break_even_interval_starts_at_zero_draws():
    even = break_even(make_timed("other", 0.51, 0.8, scatter=0.1), BASE)
    assert even.low == 0
    assert 0 < even.draws < even.high
    assert even.text.startswith("after 1 draw (0 to ")


def test_break_even_is_undefined_without_times_or_for_the_base():
    base = record("ear-clipping", triangulate_s=0.5)
    assert break_even(record("not timed", triangulate_s=0.1, time=None), base) is None
    assert break_even(record("of an older version"), base) is None
    assert break_even(base, base) is None


def test_break_even_interval_is_rounded_outwards_and_may_be_unbounded():
    assert BreakEven("after", 4.0, 4.0, 4.0).text == "after 4 draws (3 to 4)"
    assert BreakEven("after", 10.2, 4.0, math.inf).text == "after 11 draws (3 or more)"
    assert BreakEven("after", 0.3, 0.2, 0.4).text == "after 1 draw (0 to 1)"
    assert BreakEven("after", -0.2, -2.0, 2.4).text == "at once (0 to 3 draws)"
    assert BreakEven("after", 0.0, 0.0, math.inf).text == "at once (0 or more draws)"
    assert _solve_interval_end(5.0, 4.0, 2.0, 0.0, -1) == math.inf  # the saving may be zero


def test_each_pair_of_records_is_compared_at_most_once(monkeypatch):
    pairs = []

    def counted(record, base, *rest, **more):
        pairs.append((record.name, base.name))
        return compute_time_ratio(record, base, *rest, **more)

    monkeypatch.setattr("harness.metrics.groups.compute_time_ratio", counted)
    names = ("delaunay", "greedy", "fan", "strip", "sweep")
    run = make_run([base(), *(make_fields(name, "faster") for name in names)])
    decided = decide_run(run)
    print_summary(decided, Console(file=io.StringIO()))
    assert len(list_rows(decided)) == 1 + len(names)
    make_content(run, decided)
    assert len(pairs) == len(set(pairs)) == 1 + len(names)
