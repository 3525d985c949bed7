"""Errors of laws on draws outside their fit: the committed results are computed again."""

import pandas as pd
import pytest

from scripts.studies import accuracy


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return pd.DataFrame(accuracy.compare_laws())


def test_committed_results_follow_from_committed_measurements(rows):
    """Run `scripts/studies/accuracy.py compare` after a change to the law or to a profile."""
    stored = pd.read_csv(accuracy.REFERENCE / "law-accuracy.csv")
    columns = ["profile", "form", "set", "compared", "large", "signs", "additive_signs", "draws"]
    pd.testing.assert_frame_equal(stored[columns], rows[columns], check_dtype=False)
    errors = [name for name in rows if name.endswith("rms")]
    assert stored[errors].to_numpy() == pytest.approx(
        rows[errors].to_numpy(), abs=1e-5, nan_ok=True
    )


def test_arithmetic_is_a_stage_of_its_own():
    """In the draws of an H200: fitted to one size, it predicts the other sizes."""
    rows = pd.DataFrame(accuracy.compare_forms()).set_index("form")
    stored = pd.read_csv(accuracy.REFERENCE / "law-arithmetic.csv", index_col="form")
    assert rows["lane_ps"].to_numpy() == pytest.approx(stored["lane_ps"].to_numpy(), abs=1e-3)
    assert rows.index[rows["chosen"]].tolist() == ["maximum of four stages"]
    assert rows.loc["maximum of four stages", "absolute_rms"] < 0.10
    assert rows.loc["maximum of three stages", "absolute_rms"] > 0.25


def test_stages_predict_scenes_that_were_not_fitted(rows):
    """The bounds on the errors were set before the measurement."""
    gpu = rows[rows["profile"] == "opengl-h200"].set_index("set")
    assert gpu.loc["first", "relative_rms"] < 0.05
    assert gpu.loc["extended", "relative_rms"] < 0.06
    assert gpu.loc["first", "absolute_rms"] < 0.20
    for name in ("first", "extended", "second"):
        assert gpu.loc[name, "signs"] == gpu.loc[name, "large"] > 20
    additive = gpu["additive_relative_rms"]
    assert (gpu["relative_rms"] < additive)[["first", "extended", "second"]].all()


def test_software_is_predicted(rows):
    software = rows[(rows["profile"] != "opengl-h200") & (rows["set"] == "all")]
    assert len(software) == 5
    assert (software[["relative_rms", "absolute_rms"]] < 0.07).all(axis=None)
    assert (software["signs"] > 0.9 * software["large"]).all()
