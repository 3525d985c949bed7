"""Bad values of all options, and large inputs: a clear result in limited time."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from scenes import SceneError, load
from tests.fuzz.targets.options import check_option, list_bad_values

MAX_READ_S = 30.0
"""CPU time limit of reading, which takes less than 3 s; quadratic algorithms took over 90 s."""


@pytest.mark.parametrize("command", sorted({value["command"] for value in list_bad_values()}))
def test_bad_values_of_options(command, scale_count, report_counts):
    """Every 50th value is also tried in a new process."""
    values = [value for value in list_bad_values() if value["command"] == command]
    sampled = values[:: max(1, len(values) // scale_count(len(values)))]
    for number, value in enumerate(sampled):
        check_option(value)
        if number % 50 == 7:
            check_option(value | {"started": True})
    report_counts({"bad values": len(sampled)})


def wavy_ring(count: int) -> np.ndarray:
    """Return a valid ring, a circle with a sine wave, (count, 2)."""
    angle = np.arange(count) * (2 * np.pi / count)
    radius = 1000.0 * (1 + 0.1 * np.sin(40 * angle))
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))


def square_with_holes() -> shapely.Polygon:
    """Return a square with 100,000 square holes."""
    x, y = (axis.ravel()[:100_000] * 10.0 for axis in np.mgrid[:317, :317])
    holes = shapely.get_exterior_ring(shapely.box(x + 2, y + 2, x + 8, y + 8))
    return shapely.Polygon(shapely.box(0, 0, 3170, 3170).exterior, list(holes))


def svg_path() -> bytes:
    """Return an SVG path of 400,000 vertices."""
    text = "L".join(f"{x:.4f},{y:.4f}" for x, y in wavy_ring(400_000))
    head = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="-2 -2 4 4">'
    return f'{head}<path d="M{text}Z"/></svg>'.encode()


LARGE_FILES: dict[str, Callable[[], bytes]] = {
    "holes.wkb": lambda: shapely.to_wkb(square_with_holes()),
    "crossings.wkb": lambda: shapely.to_wkb(
        shapely.Polygon(np.random.default_rng(0).uniform(0, 1000, (4_000, 2)))
    ),
    "path.svg": svg_path,
    "ring.wkb": lambda: shapely.to_wkb(shapely.Polygon(wavy_ring(1_000_000))),
}


@pytest.mark.parametrize("name", LARGE_FILES)
def test_large_inputs_are_read_or_refused_in_time(name, tmp_path: Path):
    """Reading takes linear, not quadratic time."""
    file = tmp_path / name
    file.write_bytes(LARGE_FILES[name]())
    start = time.process_time()
    if name.startswith("crossings"):
        with pytest.raises(SceneError, match="self-intersects"):
            load(str(file))
    else:
        assert len(load(str(file)).polygons) == 1
    assert time.process_time() - start < MAX_READ_S
