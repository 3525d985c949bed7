"""What E says of many views: the claim of docs/theory.md, by quadrature and by counts."""

from __future__ import annotations

import numpy as np
import pytest

from harness.frame import frame_of, view_of
from harness.models.in_place import opened, retriangulate
from harness.models.seen import read
from harness.models.views import DISTANCE, VIEWS, ball_of
from harness.rasterisers.reference import predict
from harness.triangulating.frames import original
from tests.models.various import solid


def test_the_mean_manhattan_length_over_all_views_is_the_length():
    """A segment as seen from all sides, turned on the screen in all ways: midpoint quadrature."""
    steps = 400
    height = (np.arange(steps) + 0.5) / steps * 2 - 1  # uniform on a sphere (Archimedes)
    turn = (np.arange(steps) + 0.5) / steps * 2 * np.pi
    seen = np.sqrt(1 - height**2)  # the sine of the angle to the line of sight
    manhattan = np.abs(np.cos(turn)) + np.abs(np.sin(turn))
    assert seen.mean() == pytest.approx(np.pi / 4, rel=1e-3)
    assert np.outer(seen, manhattan).mean() == pytest.approx(1.0, rel=1e-3)


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """A plate, the same with shorter diagonals, and by how much they are shorter."""
    folder = tmp_path_factory.mktemp("law")
    before, after = folder / "before.glb", folder / "after.glb"
    solid().export(before)
    done = retriangulate(before, after)
    return before, after, done.before - done.after


def expected_and_counted(both, pixels: int) -> tuple[float, float, float]:
    """Return helper lanes saved by E, by Q of each view, and as they are counted."""
    before, after, shorter = both
    lanes = []
    for path in (before, after):
        scene = read(str(path), pixels=pixels)
        frame = frame_of(scene, view_of(scene))
        found = original(frame)
        totals = found.predicted.totals
        counted = predict(frame.points, frame.join(found.parts))["helper_lanes"].sum()
        lanes.append((4 * totals["expected_quads"] - totals["area"], int(counted)))
    (part,) = [part for group in opened(before)[1] for part in group]
    ball = ball_of([part.mesh.positions])
    scale = pixels * np.sqrt(DISTANCE**2 - 1) / (2 * ball.radius * DISTANCE)
    # `shorter` has each diagonal twice, as a side of two triangles
    by_e = VIEWS / 2 * scale * (shorter / 2)
    by_q, counted = np.subtract(*lanes)
    return by_e, by_q, counted


def test_e_expects_what_is_saved_where_slivers_are_some_pixels_high(both):
    by_e, by_q, counted = expected_and_counted(both, 1024)
    assert by_e == pytest.approx(counted, rel=0.1)
    assert by_q == pytest.approx(counted, rel=0.02)


def test_of_a_small_model_q_alone_is_right(both):
    by_e, by_q, counted = expected_and_counted(both, 16)
    assert by_e > 3 * counted > 0
    assert by_q == pytest.approx(counted, rel=0.05)
