"""Viewport sizes at which the choice of a triangulator matters: counted, not timed.

A scene is triangulated and counted at each size as in a run, by the exact CPU reference. A device's
profile converts the counts to milliseconds; triangulating is timed.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness import atomic
from harness.errors import UsageError
from harness.frame import Frame, View, frame_of
from harness.metrics.decision import MIN_PIXELS
from harness.profile.counted import TERMS, count_triangles, design_of
from harness.profile.profile import read_profile
from harness.style import ONE_COLUMN, STYLE, count, grid, looks, plain_table
from harness.triangulating.recipes import Recipe
from harness.triangulating.triangulate import time_in_rounds, triangulate_polygons
from scenes import Scene
from triangulators.errors import suggest

if TYPE_CHECKING:
    from rich.table import Table

MATTERS = 0.01
"""Share of ear clipping's lanes, or of its draw's time, below which what is saved is nothing."""

AGAIN_S, ROUNDS = 0.2, 3
"""Triangulating all that takes less is timed so often; the least counts."""

CONTRIBUTED = Path(__file__).parents[1] / "results" / "reference" / "profiles"
"""Profiles that people brought; a wheel has none."""


@dataclass(frozen=True)
class DeviceCosts:
    """A device's name, and the seconds that each of `counted.TERMS` costs, (t,)."""

    name: str
    costs: NDArray[np.float64]


EXACT = ("fragments", "quads", "helper_lanes", "partial_quads")
"""What is counted: see `rasterisers.reference.predict`."""

Cost = dict[str, Any]
"""What one triangulator's triangles cost: `EXACT`; `triangulate_s`, the seconds that it took; and
`draw`, the time of a draw by a device's law in seconds, None without one."""


@dataclass(frozen=True)
class Size:
    """What a scene costs at one size.

    resolution : side of the viewport in px, which the scene fills
    polygons : counted: those that the grid leaves and that all triangulators do
    left_out : polygons that the grid does not leave, or that some triangulator does not do
    polygon_px : median of the longer sides of their bounding boxes
    costs : by triangulator, the base first
    """

    resolution: int
    polygons: int
    left_out: int
    polygon_px: float
    costs: dict[str, Cost]

    @property
    def covered(self) -> int:
        """Pixels, however they are triangulated."""
        return int(next(iter(self.costs.values()))["fragments"])

    @property
    def saved(self) -> dict[str, float]:
        """Which share of the base's draw time each one saves, of its lanes without a law."""
        spent = {n: c["quads"] if c["draw"] is None else c["draw"] for n, c in self.costs.items()}
        base = next(iter(spent.values()))
        return {name: 1.0 - each / base if base else 0.0 for name, each in spent.items()}

    @property
    def matters(self) -> bool:
        """Whether something is saved, of enough pixels to tell."""
        return max(self.saved.values()) >= MATTERS and self.covered >= MIN_PIXELS


@dataclass(frozen=True)
class Sizes:
    """What a scene costs at several sizes, the smallest first, and by which law, if by any."""

    scene: str
    device: DeviceCosts | None
    sizes: tuple[Size, ...]

    @property
    def measure(self) -> str:
        """What is saved."""
        return f"draw time on {self.device.name}" if self.device else "shaded lanes"

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON-ready values."""
        return {
            "scene": self.scene,
            "device": self.device.name if self.device else None,
            "unit": "s" if self.device else None,
            "sizes": [asdict(size) for size in self.sizes],
            "matters_at": [size.resolution for size in self.sizes if size.matters],
            "matters_share": MATTERS,
            "sentence": sentence(self),
        }


def read_costs(name: str, *folders: Path) -> DeviceCosts:
    """Return the law of a profile: a file, or the name of one in `folders` or brought by people.

    Raises
    ------
    UsageError
        if there is none, or it was refused when it was made
    """
    known = {
        file.stem: file
        for folder in (CONTRIBUTED, *folders)
        for file in sorted(folder.glob("*.json"))
        if not file.stem.endswith(".refused")
    }
    if name not in known and not Path(name).exists():
        hint = suggest(name, sorted(known), cutoff=0.4, fallback="raster-harness profile makes one")
        raise UsageError(f"no profile {name}: it is neither a file nor a name; {hint}")
    return read_profile(known.get(name, Path(name)), _costs_of)


def _costs_of(profile: Any) -> DeviceCosts:
    costs = {term["name"]: float(term["cost"]) for term in profile["terms"]}
    every = np.array([costs[term] for term in TERMS])
    return DeviceCosts(str(profile["device"]["name"]), every)


def count_size(
    scene: Scene, recipes: Sequence[Recipe], view: View, device: DeviceCosts | None
) -> Size:
    """Return what the scene costs at one size, by two or more `recipes`.

    Raises
    ------
    UsageError
        if the scene brings a view of its own along, or nothing of it can be drawn at this size
    """
    frame = frame_of(scene, view)
    made = {str(recipe): triangulate_polygons(recipe, frame.polygons) for recipe in recipes}
    done = np.all([[part is not None for part in each.parts] for each in made.values()], axis=0)
    if not done.any():
        raise UsageError(
            f"{scene.name}: at {view.resolution} px no polygon is left that all triangulators do; "
            "give a larger size, or fewer of them"
        )
    seconds = [each.seconds for each in made.values()]
    if sum(seconds) < AGAIN_S:
        seconds = [min(each) for each in time_in_rounds(recipes, frame.polygons, ROUNDS, 0)]
    costs = {}
    for (name, each), taken in zip(made.items(), seconds, strict=True):
        parts = [part if ok else None for part, ok in zip(each.parts, done, strict=True)]
        costs[name] = _cost(frame, frame.join(parts), taken, device)
    low, high = frame.polygons.bounds()
    middle = float(np.median((high - low)[done].max(axis=1)))
    kept = int(done.sum())
    return Size(view.resolution, kept, len(scene.polygons) - kept, middle, costs)


def _cost(
    frame: Frame, triangles: NDArray[np.int32], seconds: float, device: DeviceCosts | None
) -> Cost:
    counted = count_triangles(frame, triangles)
    draw = None if device is None else float((design_of([counted]) @ device.costs)[0])
    return {name: counted[name] for name in EXACT} | {"triangulate_s": seconds, "draw": draw}


def sentence(found: Sizes) -> str:
    """Return whether it matters, at which sizes, and where most."""
    base = next(iter(found.sizes[0].costs))
    covered = max(size.covered for size in found.sizes)
    if covered < MIN_PIXELS:
        return f"It cannot be told: {covered:,} pixels or fewer are covered. Give a larger size."
    mattering = [size for size in found.sizes if size.matters]
    ends = (mattering or found.sizes)[:: max(1, len(mattering or found.sizes) - 1)]
    across = " to ".join(str(size.resolution) for size in ends)
    if not mattering:
        return (
            f"It does not matter for you: at {across} px no triangulator saves {MATTERS:.0%} of "
            f"{base}'s {found.measure}."
        )
    most = max(mattering, key=lambda size: max(size.saved.values()))
    best, saved = max(most.saved.items(), key=itemgetter(1))
    text = (
        f"It matters at {across} px, most at {most.resolution} px, {_pixels(most.polygon_px, 2)} a "
        f"polygon: {best} saves {saved:.1%} of {base}'s {found.measure}"
    )
    if found.device:
        own, other = (most.costs[name] for name in (best, base))
        more = own["triangulate_s"] - other["triangulate_s"]
        draws = math.ceil(more / (other["draw"] - own["draw"]))
        text += f", which pays after {count(draws, 'draw')}" if draws > 0 else ""
    return f"{text}."


def _pixels(side: float, digits: int) -> str:
    """Write a side with so many digits, never as 1e+02."""
    return f"{side:,.0f} px" if side >= 10 ** (digits - 1) else f"{side:.{digits}g} px"


def tables(found: Sizes) -> Iterator[Table]:
    """Yield a table for each measure: the base's, and the others in ratio to it."""
    kinds = [
        ("triangulate_s", "ms to triangulate", 1e3, ".3g"),
        ("quads", "lanes shaded", 4.0, ",.0f"),
        ("partial_quads", "partial quads", 1.0, ",.0f"),
    ]
    if found.device:
        kinds.append(("draw", f"ms of a draw on {found.device.name}", 1e3, ".4g"))
    base, *others = found.sizes[0].costs
    heads = [f">{name}" for name in ("size", "a polygon", base, *others)]
    for name, what, per, form in kinds:
        shown = plain_table(f"{found.scene}: {what}; others in ratio to {base}", *heads)
        for size in found.sizes:
            own, *rest = (each[name] for each in size.costs.values())
            ratios = (f"{each / own:.3f}" if own else "-" for each in rest)
            sides = str(size.resolution), _pixels(size.polygon_px, 3)
            shown.add_row(*sides, format(per * own, form), *ratios)
        yield shown


def draw_chart(found: Sizes, file: Path) -> None:
    """Draw what each triangulator saves against the size, as PNG or SVG by the file's ending."""
    import matplotlib

    base = next(iter(found.sizes[0].costs))
    at = [size.resolution for size in found.sizes]
    with matplotlib.rc_context(STYLE):
        figure, (panel,) = grid((ONE_COLUMN, 2.3))
        for name, look in looks(list(found.sizes[0].costs)).items():
            saved = [100 * size.saved[name] for size in found.sizes]
            panel.plot(at, saved, label=name, color=look.colour, marker=look.marker, markersize=4)
        panel.set_xscale("log", base=2)
        panel.set_xticks(at, [str(size) for size in at])
        panel.set_xlabel("side of the viewport, px")
        panel.set_ylabel(f"saved of {base}'s\n{found.measure}, %")
        panel.legend(fontsize=7)
        content = io.BytesIO()
        figure.savefig(content, format=file.suffix.removeprefix(".").lower())
    atomic.write(file, content.getvalue())
