"""Single polygons that are hard to triangulate (combs, needles, ...), and the paper's polygon."""

from collections.abc import Callable

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from scenes.repair import arrange_in_rows, clean
from scenes.scene import Scene, SceneError

MAX_VERTICES = 100_000
_SIDE = 100.0  # every polygon fills a square of about this side

Ring = NDArray[np.float64]
Shape = Ring | tuple[Ring, list[Ring]]


def build(*, seed: int = 0, vertices: int = 200, family: str = "all") -> Scene:
    """Return one polygon of each family, or of the named one, with about `vertices` vertices."""
    if not 12 <= vertices <= MAX_VERTICES:
        raise SceneError(f"stress: vertices={vertices} is out of range: give 12 to {MAX_VERTICES}")
    if family != "all" and family not in FAMILIES:
        raise SceneError(f"stress: unknown family {family!r} (choose from {', '.join(FAMILIES)})")
    families = list(FAMILIES) if family == "all" else [family]
    polygons = []
    for number, name in enumerate(FAMILIES):
        if name in families:
            # Seeded by family, so that a polygon does not depend on which families are requested.
            shape = FAMILIES[name](np.random.default_rng([seed, number]), vertices)
            polygons.append(shapely.Polygon(*(shape if isinstance(shape, tuple) else (shape,))))
    rounded = shapely.transform(np.array(polygons), lambda xy: np.round(xy, 9) + 0.0)
    cleaned = clean(rounded, families)
    return Scene(
        name="stress",
        polygons=arrange_in_rows(list(cleaned.polygons)),
        units="units",
        description="combs, spirals, stars, needles, fractals, random polygons",
        licence="generated, no rights reserved",
        parameters={"vertices": vertices, "family": family, "seed": seed},
        dropped=cleaned.dropped,
        repaired=cleaned.repaired,
    )


def build_comb(rng: Generator, n: int) -> Ring:
    """Return a comb: a bar with narrow prongs of uneven lengths."""
    prongs = n // 4
    x = np.repeat(np.linspace(0, _SIDE, 2 * prongs), 2)
    lengths = rng.uniform(0.6, 1.0, prongs) * _SIDE
    y = np.full((prongs, 4), 0.1 * _SIDE)
    y[:, 1:3] = lengths[:, None]
    y[0, 0] = y[-1, 3] = 0.0
    return np.column_stack([x, y.ravel()])


def build_sawtooth(rng: Generator, n: int) -> Ring:  # noqa: ARG001
    """Return a band whose upper and lower edges are saws."""
    x = np.linspace(0, _SIDE, n // 2)
    up = np.where(np.arange(len(x)) % 2, 0.95, 0.55) * _SIDE
    down = np.where(np.arange(len(x)) % 2, 0.45, 0.05) * _SIDE
    return np.concatenate([np.column_stack([x, up]), np.column_stack([x, down])[::-1]])


def build_spiral(rng: Generator, n: int) -> Ring:  # noqa: ARG001
    """Return a band that winds inwards up to six times, once for every 24 vertices."""
    turns = max(1, min(6, n // 24))
    t = np.linspace(0, 2 * np.pi * turns, n // 2)
    outer = _SIDE / 2 * (1 - t / (2 * np.pi * (turns + 0.75)))
    width = 0.6 * _SIDE / 2 / (turns + 0.75)
    arms = np.column_stack([np.cos(t), np.sin(t)])
    return np.concatenate([outer[:, None] * arms, ((outer - width)[:, None] * arms)[::-1]])


def build_star(rng: Generator, n: int) -> Ring:  # noqa: ARG001
    """Return a star of long thin spikes: every second vertex is near the centre."""
    spikes = n // 2
    t = np.pi / spikes * np.arange(2 * spikes)
    r = np.where(np.arange(2 * spikes) % 2, 0.05, 0.5) * _SIDE
    return np.column_stack([r * np.cos(t), r * np.sin(t)])


def build_koch(rng: Generator, n: int) -> Ring:  # noqa: ARG001
    """Return the deepest Koch snowflake of at most n vertices."""
    points = _SIDE / 2 * np.exp(2j * np.pi * np.arange(3) / 3)
    while 4 * len(points) <= n:
        step = (np.roll(points, -1) - points) / 3
        # Vertices run counter-clockwise, so a right turn points outwards.
        tip = points + step + step * np.exp(-1j * np.pi / 3)
        points = np.column_stack([points, points + step, tip, points + 2 * step]).ravel()
    return np.column_stack([points.real, points.imag])


def build_near_collinear(rng: Generator, n: int) -> Ring:
    """Return a square with vertices on its sides, displaced by up to a millionth of the side."""
    per_side = n // 4
    along = np.sort(rng.uniform(0.01, 0.99, (4, per_side - 1)), axis=1)
    offsets = rng.uniform(-1e-6, 1e-6, along.shape)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    sides = []
    for k in range(4):
        a, b = corners[k], corners[(k + 1) % 4]
        normal = np.array([-(b - a)[1], (b - a)[0]])
        points = a + along[k][:, None] * (b - a) + offsets[k][:, None] * normal
        sides.append(np.concatenate([[a], points]))
    return _SIDE * np.concatenate(sides)


def build_sliver(rng: Generator, n: int) -> Ring:
    """Return a bent band ten thousand times longer than wide."""
    x = np.concatenate([[0.0], np.sort(rng.uniform(0, 1, n // 2 - 2)), [1.0]]) * _SIDE
    y = 0.2 * _SIDE * np.sin(x / _SIDE * np.pi)
    low, high = np.column_stack([x, y]), np.column_stack([x, y + 1e-4 * _SIDE])
    return np.concatenate([low, high[::-1]])


def build_needle_holes(rng: Generator, n: int) -> Shape:
    """Return a square with triangular holes a thousand times longer than wide."""
    count = max(1, (n - 4) // 3)
    columns = int(np.ceil(np.sqrt(count)))
    cell = _SIDE / columns
    row, column = np.divmod(np.arange(count), columns)
    centre = (np.column_stack([column, row]) + 0.5) * cell
    turn = rng.uniform(0, np.pi, count)
    along = np.column_stack([np.cos(turn), np.sin(turn)]) * 0.45 * cell
    across = np.column_stack([-along[:, 1], along[:, 0]]) * 1e-3
    holes = np.stack([centre - along, centre + along, centre + across], axis=1)
    square = _SIDE * np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    return square, list(holes)


def build_random_star(rng: Generator, n: int) -> Ring:
    """Return a ring with vertices at random angles and radii about a centre that sees all of it."""
    t = np.sort((np.arange(n) + rng.uniform(0, 0.9, n)) * 2 * np.pi / n)
    r = rng.uniform(0.2, 0.5, n) * _SIDE
    return np.column_stack([r * np.cos(t), r * np.sin(t)])


def build_random_monotone(rng: Generator, n: int) -> Ring:
    """Return a polygon of two random chains from left to right, one above the other."""
    x = np.sort(rng.uniform(0, 1, n - 2))
    upper = rng.random(n - 2) < 0.5
    y = np.where(upper, rng.uniform(0.52, 1.0, n - 2), rng.uniform(0.0, 0.48, n - 2))
    inner = np.column_stack([x, y])
    ends = np.array([[-0.01, 0.5], [1.01, 0.5]])
    return _SIDE * np.concatenate([ends[:1], inner[~upper], ends[1:], inner[upper][::-1]])


def build_random_maze(rng: Generator, n: int) -> Ring:
    """Return the outline of a random spanning tree of a grid, with perturbed vertices.

    The outline visits each point of a grid of half the cells' pitch once. Vertices are displaced by
    less than half of the distance between neighbours, so the polygon stays simple for every tree.
    """
    side = max(2, round(np.sqrt(n / 4)))
    opens_right, opens_up = _draw_spanning_tree(rng, side)
    opens_left, opens_down = np.roll(opens_right, 1, axis=0), np.roll(opens_up, 1, axis=1)
    x = y = 0
    path = []
    for _ in range(4 * side * side):
        path.append((x, y))
        cell = x // 2, y // 2
        # Keep the tree on the left: follow a branch that begins here, otherwise go around the cell.
        if y % 2 == 0:
            if x % 2 == 0:
                x, y = (x, y - 1) if opens_down[cell] else (x + 1, y)
            else:
                x, y = (x + 1, y) if opens_right[cell] else (x, y + 1)
        elif x % 2 == 1:
            x, y = (x, y + 1) if opens_up[cell] else (x - 1, y)
        else:
            x, y = (x - 1, y) if opens_left[cell] else (x, y - 1)
    points = np.array(path) + rng.uniform(-0.35, 0.35, (len(path), 2))
    return np.asarray(_SIDE / (2 * side) * points)


def _draw_spanning_tree(rng: Generator, side: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return flags (side, side) of cells joined to the right, and to the upper neighbour."""
    cell = np.arange(side**2).reshape(side, side)
    a = np.concatenate([cell[:-1].ravel(), cell[:, :-1].ravel()])
    b = np.concatenate([cell[1:].ravel(), cell[:, 1:].ravel()])
    weight = rng.permutation(len(a)) + 1.0
    tree = minimum_spanning_tree(coo_array((weight, (a, b)), shape=(side**2, side**2))).tocoo()
    joined = np.zeros((2, side, side), dtype=bool)
    rightwards = tree.col - tree.row == side
    for direction, is_selected in enumerate((rightwards, ~rightwards)):
        joined[direction].ravel()[tree.row[is_selected]] = True
    return joined[0], joined[1]


FAMILIES: dict[str, Callable[[Generator, int], Shape]] = {
    "comb": build_comb,
    "sawtooth": build_sawtooth,
    "spiral": build_spiral,
    "star": build_star,
    "koch": build_koch,
    "near-collinear": build_near_collinear,
    "sliver": build_sliver,
    "needle-holes": build_needle_holes,
    "random-star": build_random_star,
    "random-monotone": build_random_monotone,
    "random-maze": build_random_maze,
}

# Vertices of the paper's polygon, clockwise, in the paper's order.
_PAPER = ((3, 7), (0, 8), (1, 11), (7, 11), (7, 6), (6, 3), (3, 0), (1, 3), (3, 2))


def paper(*, seed: int = 0) -> Scene:  # noqa: ARG001 - every scene takes a seed
    """Return the polygon reconstructed from Kryvda and Sulema's Table 1: 9 vertices, area 46."""
    return Scene(
        name="paper",
        polygons=[shapely.orient_polygons(shapely.Polygon(_PAPER))],
        units="units",
        description="test polygon of the paper's Table 1",
        licence="facts",
        credit="reconstructed from Table 1 of Kryvda and Sulema",
    )
