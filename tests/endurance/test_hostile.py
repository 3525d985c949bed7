"""Bad values of every option, and inputs that are large in one way: a clear end, and soon."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from scenes import SceneError, load
from tests.fuzz.targets.options import check_option, every

MAX_S = 30.0
"""Processor time of reading; it takes less than 3 s. What is quadratic took 90 s and more."""


@pytest.mark.parametrize("command", sorted({each["command"] for each in every()}))
def test_every_bad_value_of_every_option(command, times, tell):
    """One in fifty is given to the program as a user starts it, too."""
    values = [each for each in every() if each["command"] == command]
    chosen = values[:: max(1, len(values) // times(len(values)))]
    for number, value in enumerate(chosen):
        check_option(value)
        if number % 50 == 7:
            check_option(value | {"started": True})
    tell({"bad values": len(chosen)})


def wavy(count: int) -> np.ndarray:
    """Return a valid ring, a wavy circle."""
    angle = np.arange(count) * (2 * np.pi / count)
    radius = 1000.0 * (1 + 0.1 * np.sin(40 * angle))
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))


def cells() -> shapely.Polygon:
    """Return a square with 100,000 square holes."""
    x, y = (axis.ravel()[:100_000] * 10.0 for axis in np.mgrid[:317, :317])
    holes = shapely.get_exterior_ring(shapely.box(x + 2, y + 2, x + 8, y + 8))
    return shapely.Polygon(shapely.box(0, 0, 3170, 3170).exterior, list(holes))


def svg_path() -> bytes:
    """Return an SVG path of 400,000 vertices."""
    text = "L".join(f"{x:.4f},{y:.4f}" for x, y in wavy(400_000))
    head = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="-2 -2 4 4">'
    return f'{head}<path d="M{text}Z"/></svg>'.encode()


LARGE: dict[str, Callable[[], bytes]] = {
    "holes.wkb": lambda: shapely.to_wkb(cells()),
    "crossings.wkb": lambda: shapely.to_wkb(
        shapely.Polygon(np.random.default_rng(0).uniform(0, 1000, (4_000, 2)))
    ),
    "path.svg": svg_path,
    "ring.wkb": lambda: shapely.to_wkb(shapely.Polygon(wavy(1_000_000))),
}


@pytest.mark.parametrize("name", LARGE)
def test_what_is_large_in_one_way_is_read_or_refused_soon(name, tmp_path: Path):
    """In time that grows with its size, not its square."""
    file = tmp_path / name
    file.write_bytes(LARGE[name]())
    start = time.process_time()
    if name.startswith("crossings"):
        with pytest.raises(SceneError, match="self-intersects"):
            load(str(file))
    else:
        assert len(load(str(file)).polygons) == 1
    assert time.process_time() - start < MAX_S
