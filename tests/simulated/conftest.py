"""The published designs where their sources lie beside the repository, and triangles to draw."""

from collections.abc import Callable

import numpy as np
import pytest
from platformdirs import user_cache_path

from harness.frame import Frame
from harness.rasterisers import Device, Rasteriser, get
from harness.rasterisers.simulated import building, skybox
from tests.paths import ROOT
from tests.rasterisers.conftest import loose_triangles

BESIDE = ROOT.parent / "shared" / "data" / "skybox-rtl"


@pytest.fixture(autouse=True)
def _sources(monkeypatch: pytest.MonkeyPatch) -> None:
    """Name the sources, and keep what is built, of which a digest tells what it is."""
    kept = user_cache_path("raster-harness", appauthor=False)
    monkeypatch.setattr(building, "cache_file", lambda name: kept / name)
    if BESIDE.is_dir():
        monkeypatch.setenv(skybox.SOURCES.variable, str(BESIDE))


@pytest.fixture
def buildable(_sources: None) -> None:
    """Skip the test where Skybox cannot be built, with what a user would be told."""
    if problem := skybox.SOURCES.problem():
        pytest.skip(f"skybox: {problem}")


@pytest.fixture
def opened(buildable: None) -> Callable[[str], Rasteriser]:
    return lambda name: get("simulated")(Device(name, software=True))


KINDS = (
    *("any", "small", "below a pixel", "needle", "sliver", "on pixels' corners"),
    *("on pixels' centres", "on tiles' corners", "axis-parallel", "flat"),
)


def triangles_of(size: int, number: int, seed: int, kinds=KINDS) -> tuple[Frame, np.ndarray]:
    """Return so many triangles of each kind, each a polygon of its own, in `size` px."""
    points = [_corners(kind, size, number, seed) for kind in kinds]
    return loose_triangles(np.clip(np.concatenate(points), 0, size * 256), size)


def _corners(kind: str, size: int, number: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng([seed, KINDS.index(kind), size])
    points = rng.integers(0, size * 256 + 1, (number, 3, 2))
    if kind in ("small", "below a pixel"):
        reach = 16 * 256 if kind == "small" else 256
        points = points[:, :1] + rng.integers(-reach, reach + 1, (number, 3, 2))
    elif kind in ("needle", "sliver"):
        along = points[:, 1] - points[:, 0]
        thick = 64 if kind == "needle" else 3
        share = rng.random((number, 1))
        points[:, 2] = points[:, 0] + share * along + rng.integers(-thick, thick + 1, (number, 2))
    elif kind.startswith("on "):
        grid = 32 * 256 if "tiles" in kind else 256
        points = points // grid * grid + (128 if "centres" in kind else 0)
    elif kind == "axis-parallel":
        points[:, 1, 1] = points[:, 0, 1]
        points[:, 2, 0] = points[:, rng.integers(0, 2), 0]
    elif kind == "flat":
        points[:, 2] = points[:, 0] + (points[:, 1] - points[:, 0]) // 2
    return points
