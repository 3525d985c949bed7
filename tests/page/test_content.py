"""What a page holds is what the run drew."""

import base64
from dataclasses import replace

import numpy as np
import pytest

from harness.errors import InputError
from harness.frame import View
from harness.page.page_data import content_of
from harness.page.result import TOLD
from harness.rasterisers.reference import predict
from harness.results import drawings
from tests.conftest import assert_refused, require_ok


def decoded(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def test_frames_triangles_and_counts_are_the_runs(small_run):
    content = content_of(small_run)
    assert content["base"] == "ear-clipping"
    assert [view["resolution"] for view in content["views"]] == [128, 64]
    for view in content["views"]:
        where = View(view["resolution"], view["rotation"], view["fit"])
        kept = drawings.read(small_run, where)
        points = decoded(view["points"], "<i4").reshape(-1, 2)
        assert np.array_equal(points, kept.points)
        assert sum(view["sizes"]) == len(points)
        for name, case in view["cases"].items():
            rows = decoded(case["rows"], "<u4").reshape(-1, 3)
            assert np.array_equal(rows, kept.triangles[name])
            predicted = predict(points, rows.astype(np.int32))
            for counter in TOLD:
                assert decoded(case[counter], "<u4").sum() == predicted[counter].sum()
            assert case["record"]["triangles"] == len(rows)


def test_one_triangulation_is_nothing_to_compare(small_run):
    alone = replace(small_run, records=small_run.records[:1])
    with pytest.raises(InputError, match="nothing to draw"):
        content_of(alone)


def test_the_command_writes_one_file(harness, small_run):
    out, _ = require_ok(harness("page", str(small_run.path), "-o", "page.html"))
    assert "page: page.html" in out
    assert_refused(harness("page", "nowhere"), "nowhere")
