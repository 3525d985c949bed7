import io

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from harness.metrics.statistics import MIN_VALUES, compute_mean_interval
from harness.study import regret
from harness.study.correlations import get_measure_title
from tests.records import make_record

NAMES = ("optimal:exact-quads", "optimal:half-perimeter", "random#0", "random#1", "worst:overdraw")
QUADS = (100, 103, 110, 120, 150)
H = (11.0, 10.0, 12.0, 13.0, 20.0)
A = (4.0, 5.0, 3.0, 6.0, 9.0)


def make_table(records: list[dict]) -> pd.DataFrame:
    return regret.make_regret_table([make_record(**fields) for fields in records])


def make_cases(polygon: str, scale: float = 1.0, seconds=None, work: int = 0) -> list[dict]:
    """Return the records of one polygon; `seconds` are the (5, rounds) draw times."""
    records = []
    for number, name in enumerate(NAMES):
        counters = {"quads": int(QUADS[number] * scale), "fragments": 300}
        predicted = {"half_perimeter": H[number], "overdraw": A[number], "shape": 1.0}
        record = {"scene": polygon, "rasteriser": "reference", "device": "cpu", "resolution": 64}
        record |= {"triangulator": name, "options": {"work": work, "samples": 1}, "polygons": 1}
        record |= {"proven": 1 if number == 0 else None, "conforming": True, "time": None}
        record |= {"counters": counters, "predicted": predicted}
        if seconds is not None:
            samples = seconds[number].tolist()
            record["time"] = {"samples_s": samples, "reference_s": [1.0] * len(samples)}
        records.append(record)
    return records


def get_row(table, **conditions):
    for name, value in conditions.items():
        table = table[table[name] == value]
    assert len(table) == 1
    return table.iloc[0]


def test_regret_is_the_extra_cost_of_the_selected_triangulation():
    table = make_table(make_cases("a"))
    by_h = get_row(table, kind="criterion", name="half-perimeter", measure="quads")
    assert (by_h["triangulator"], by_h["best"]) == ("optimal:half-perimeter", NAMES[0])
    assert by_h["regret"] == pytest.approx(0.03)
    assert by_h["least_known"]
    by_a = get_row(table, kind="criterion", name="overdraw", measure="quads")
    assert by_a["triangulator"] == "random#0"
    assert by_a["regret"] == pytest.approx(0.10)
    # A criterion that is equal for all triangulations selects none.
    assert not (table["name"] == "shape").any()
    # `worst` is excluded; random triangulations are one family.
    assert set(table[table["kind"] == "triangulator"]["name"]) == {*NAMES[:2], "random"}


def test_minimum_of_quads_is_known_with_a_proof_for_one_sample_per_pixel():
    records = make_cases("a", seconds=np.ones((len(NAMES), 24)))
    table = make_table(records)
    assert table[table["measure"] == "quads"]["least_known"].all()
    assert not table[table["measure"] == "time_work_0"]["least_known"].any()
    unproven = [{**records[0], "proven": 0}, *records[1:]]
    assert not make_table(unproven)["least_known"].any()
    for record in records:
        record["options"] = {"work": 0, "samples": 4}
    assert not make_table(records)["least_known"].any()


def test_families_count_once_per_polygon():
    records = make_cases("a") + make_cases("b", 2.0) + make_cases("c", 3.0)
    table = regret.summarise_regret(make_table(records))
    random = get_row(table, name="random", measure="quads")
    assert random["polygons"] == 3
    assert random["mean"] == pytest.approx(0.15)
    assert np.isnan(random["ci_low"]), "three equal values have no interval"
    assert random["least_known"] == 1.0


def test_counters_are_independent_of_the_work():
    records = make_cases("a") + make_cases("a", work=8)
    table = make_table(records)
    assert len(table[table["measure"] == "quads"]) == len(make_table(make_cases("a")))


def test_equal_times_show_no_regret():
    """The minimum of noisy medians is biased: one estimate is too high, the other too low."""
    rng = np.random.default_rng(5)
    records = []
    for polygon in range(60):
        noise = rng.lognormal(0.0, 0.05, (len(NAMES), 24))
        records += make_cases(f"polygon {polygon}", seconds=noise)
    table = make_table(records)
    timed = table[(table["measure"] == "time_work_0") & (table["kind"] == "criterion")]
    assert abs(timed["regret_low"].mean()) < 0.006
    assert timed["regret_high"].mean() > 0.01
    assert (timed["regret_high"] >= 0).all()
    summary = regret.summarise_regret(timed)
    assert len(summary) == 2
    assert summary["ci_low"].between(0, 0.001).all(), "a regret is at least 0"
    assert summary["ci_high"].between(0.005, 0.05).all()


def test_a_slower_choice_is_found():
    rng = np.random.default_rng(6)
    records = []
    for polygon in range(30):
        noise = rng.lognormal(0.0, 0.02, (len(NAMES), 24))
        noise[1] *= 1.05  # what half-perimeter chooses
        records += make_cases(f"polygon {polygon}", seconds=noise)
    table = regret.summarise_regret(make_table(records))
    row = get_row(table, name="half-perimeter", measure="time_work_0")
    assert row["ci_low"] < 0.05 < row["ci_high"]
    assert 0.04 < row["mean"] < 0.06


def test_rounds_of_one_epoch_do_not_confirm_each_other():
    """The positions of buffers make a drawing fast in all rounds of one epoch."""
    rng = np.random.default_rng(7)
    ends = []
    for polygon in range(40):
        epoch = np.repeat(rng.lognormal(0.0, 0.02, (len(NAMES), 6)), 4, axis=1)
        records = make_cases(f"polygon {polygon}", seconds=epoch)
        for record in records:
            record["time"]["epochs"] = [4] * 6
        timed = make_table(records).query("measure == 'time_work_0' and kind == 'criterion'")
        ends.append(timed[["regret_low", "regret_high"]].mean())
    low, high = np.mean(ends, axis=0)
    # Rounds of one epoch would have confirmed its fastest: both ends would be 1 %.
    assert low < 0.004 < 0.006 < high


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ([0.0] * MIN_VALUES, "0.00% (all equal)"),
        ([0.1] * 12, "10.00% (all equal)"),
        ([0.1, 0.2, 0.3], "20.00% (too few polygons)"),
        ([0.0] * 11 + [1.2], "10.00% (one polygon dominates)"),
        ([0.0] * 10 + [0.75] * 2, "12.50% (few polygons dominate)"),
    ],
)
def test_missing_interval_is_explained(values, text):
    records = [r for k in range(len(values)) for r in make_cases(f"p{k}")]
    table = make_table(records).query("measure == 'quads' and name == 'overdraw'").copy()
    table = table.assign(**dict.fromkeys(("regret", "regret_low", "regret_high"), values))
    assert regret.format_regret(regret.summarise_regret(table).iloc[0]) == text


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["time_work_0", "fragments", "quads", "helper_lanes"], ["quads", "helper_lanes"]),
        (["bbox_tests", "spills"], ["bbox_tests"]),
        ([], []),
    ],
)
def test_quads_or_the_main_counter_and_all_times_are_printed(names, expected):
    times = [name for name in names if name.startswith("time")]
    assert regret.select_printed_measures(names) == expected + times


def test_counter_missing_from_one_drawing_has_no_regret():
    records = make_cases("one")
    del records[2]["counters"]["quads"]
    del records[2]["counters"]["fragments"]
    assert make_table(records).empty


def test_regret_skips_failed_empty_and_t_junction_cases():
    records = make_cases("a")
    for change in ({"status": "failed"}, {"polygons": 0}, {"conforming": False}):
        bad = {**records[3], "triangulator": "random#7", **change}
        assert make_table([*records, bad]).equals(make_table(records))


def count_quads(quads):
    records = make_cases("a")
    for record, count in zip(records, quads, strict=True):
        record["counters"] = {"quads": count}
    return make_table(records)


def test_regret_is_undefined_for_a_minimum_of_zero():
    table = count_quads((0, 0, 3, 4, 5))
    assert set(table["triangulator"]) == set(NAMES[:2])
    assert (table["regret"] == 0).all()
    assert get_row(count_quads((1, 2, 3, 4, 5)), name="half-perimeter")["regret"] == 1.0


def test_times_are_relative_to_the_reference_of_their_rounds():
    """Draws take 1, 2 and 3 references in each epoch; the machine is slow in the first round."""
    reference = np.array([9.0, 1.0, 1.0] * 4)
    costs = np.ones((len(NAMES), 12))
    costs[1] = [1.0, 2.0, 3.0] * 4
    records = make_cases("a", seconds=costs * reference)
    for record in records:
        record["time"] |= {"reference_s": reference.tolist(), "epochs": [3] * 4}
    records[1]["time"] = {  # timed after a resumption, when the machine was twice as slow
        "samples_s": (2 * costs[1] * reference).tolist(),
        "reference_s": (2 * reference).tolist(),
        "epochs": [3] * 4,
    }
    row = get_row(make_table(records), name="half-perimeter", measure="time_work_0")
    assert (row["regret_low"], row["regret"], row["regret_high"]) == pytest.approx((1, 1, 1))


def test_rounds_missing_from_one_drawing_are_ignored():
    seconds = np.random.default_rng(8).lognormal(0.0, 0.05, (len(NAMES), 24))
    records, longer = (make_cases("a", seconds=seconds) for _ in range(2))
    longer[0]["time"] = {"samples_s": [*seconds[0].tolist(), 7.0], "reference_s": [1.0] * 25}
    assert make_table(longer).equals(make_table(records))
    records[1]["time"] = None
    assert "time_work_0" not in set(make_table(records)["measure"])
    for rounds, timed in ((2, True), (1, False)):
        table = make_table(make_cases("a", seconds=seconds[:, :rounds]))
        assert ("time_work_0" in set(table["measure"])) is timed


def test_summary_has_median_95th_percentile_and_maximum():
    (row,) = make_table(make_cases("a")).query("name == 'overdraw'").to_dict("records")
    table = pd.DataFrame([{**row, "polygon": str(k), "regret": k / 100} for k in range(101)])
    summary = regret.summarise_regret(table).iloc[0]
    assert (summary["median"], summary["p95"], summary["worst"]) == pytest.approx((0.5, 0.95, 1.0))


def sum_two_views(polygons: int = 1) -> pd.DataFrame:
    records = []
    for size in (128, 64):
        for number in range(polygons):
            for record in make_cases(f"polygon {number}"):
                lanes = 3 * record["counters"]["quads"]
                counters = {**record["counters"], "helper_lanes": lanes}
                records.append({**record, "resolution": size, "counters": counters})
    return regret.summarise_regret(make_table(records))


def test_printed_regrets_are_of_criteria_in_order():
    console = Console(file=io.StringIO(), width=200)
    regret.print_regret(sum_two_views(), console)
    text = console.file.getvalue()
    assert text.index(" 64 px") < text.index("128 px")
    titles = [text.index(get_measure_title(name)) for name in ("helper_lanes", "quads")]
    assert titles[0] < titles[1]  # the main one first
    rows = [line.split() for line in text.splitlines() if line.startswith("half-perimeter")]
    assert [row[1] for row in rows] == ["3.00%"] * 2
    assert "random" not in text


def test_written_tables_have_the_documented_columns(tmp_path):
    regret.write_regret([make_record(**fields) for fields in make_cases("a")], tmp_path)
    tables = {"regret": regret.SUMMARY, "regret_by_polygon": regret.COLUMNS}
    for name, columns in tables.items():
        assert tuple(pd.read_csv(tmp_path / f"{name}.csv")) == columns


def test_paper_table_has_criteria_by_rank_correlation_in_markdown_and_latex(tmp_path):
    regrets = sum_two_views()
    fields = dict(regrets.loc[0, ["rasteriser", "device"]], statistic="spearman_within")
    values = {"overdraw": 0.5, "half-perimeter": 0.75, "exact-quads": 1.0, "aspect-ratio": np.nan}
    ranks = pd.DataFrame(
        {**fields, "criterion": name, "measure": "helper_lanes", "value": value}
        | {"ci_low": 0.25 if name == "overdraw" else np.nan, "ci_high": 0.625}
        for name, value in values.items()
    )
    regret.write_paper_table(ranks, regrets, tmp_path)
    heading, _, *rows = (tmp_path / "criteria.md").read_text().splitlines()
    assert heading.endswith("| mean regret at 64 px (95 % CI) | mean regret at 128 px (95 % CI) |")
    cells = [row.split(" | ")[2:4] for row in rows]
    assert cells == [["half-perimeter", "0.75"], ["overdraw", "0.50 (0.25 to 0.62)"]]
    assert "3.00%" in rows[0]
    latex = (tmp_path / "criteria.tex").read_text()
    assert latex.startswith("\\begin{tabular}{lllrrr}\n\\toprule\ndevice & measure & criterion")
    assert latex.count("\\\\\n") == 3
    assert "3.00\\%" in latex


def test_regret_needs_two_triangulations():
    records = make_cases("p")[:2]
    assert set(make_table(records)["polygon"]) == {"p"}
    assert make_table(records[:1]).empty


def test_interval_uses_the_outer_ends():
    rng = np.random.default_rng(4)
    low, high = rng.exponential(0.01, (2, 24)) + np.array([[0.0], [0.02]])
    interval = regret.compute_regret_interval(low, high)
    assert interval == (compute_mean_interval(low)[0], compute_mean_interval(high)[1])
    assert regret.compute_regret_interval(low - 0.05, high)[0] == 0.0, "a regret is at least 0"
    assert np.isnan(regret.compute_regret_interval(low, np.zeros(24))).all()


@pytest.mark.parametrize("blocks", [2, 4])
def test_estimates_use_the_other_blocks_and_all_blocks(blocks):
    """The lower end uses the best of the other blocks, the upper end the best of all blocks."""
    logs = np.array([[0.0, 1.0, 2.0, 3.0], [2.0, 0.5, 1.0, 1.5], [1.0, 4.0, 0.0, 3.5]])
    logs = logs[:, :blocks]
    for candidate in range(3):
        crossed = []
        for block in range(blocks):
            sums = np.delete(logs, block, axis=1).sum(axis=1)
            crossed.append(logs[candidate, block] - logs[int(np.argmin(sums)), block])
        means = logs.mean(axis=1)
        ends = np.expm1([np.mean(crossed), means[candidate] - means.min()])
        assert regret.estimate_regret(np.exp(logs), candidate) == pytest.approx(tuple(ends))
