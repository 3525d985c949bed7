"""The content of a measuring page equals the drawings of the run."""

import base64
from dataclasses import replace

import numpy as np
import pytest

from harness.errors import InputError
from harness.frame import View
from harness.page.page_data import make_page_content
from harness.page.result import COUNTERS
from harness.rasterisers.reference import count_per_triangle
from harness.results.run_folder import read_geometry
from tests.conftest import assert_refused, require_ok


def decode(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def test_page_contains_frames_triangles_and_counts_of_the_run(small_run):
    content = make_page_content(small_run)
    assert content["base"] == "ear-clipping"
    assert [view["resolution"] for view in content["views"]] == [128, 64]
    for view in content["views"]:
        view_id = View(view["resolution"], view["rotation"], view["fit"])
        drawing = read_geometry(small_run, view_id)
        points = decode(view["points"], "<i4").reshape(-1, 2)
        assert np.array_equal(points, drawing.points)
        assert sum(view["sizes"]) == len(points)
        for name, case in view["cases"].items():
            rows = decode(case["rows"], "<u4").reshape(-1, 3)
            assert np.array_equal(rows, drawing.triangles[name])
            predicted = count_per_triangle(points, rows.astype(np.int32))
            for counter in COUNTERS:
                assert decode(case[counter], "<u4").sum() == predicted[counter].sum()
            assert case["record"]["triangles"] == len(rows)


def test_run_with_one_triangulation_is_refused(small_run):
    single = replace(small_run, records=small_run.records[:1])
    with pytest.raises(InputError, match="no stored frame with two or more"):
        make_page_content(single)


def test_command_writes_one_file(harness, small_run):
    out, _ = require_ok(harness("page", str(small_run.path), "-o", "page.html"))
    assert "page: page.html" in out
    assert_refused(harness("page", "nowhere"), "nowhere")
