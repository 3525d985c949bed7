"""At which sizes of the viewport the choice of a triangulator matters: counted, not timed.

A scene is triangulated and counted at each size as a run does it, by the exact CPU reference. A
device's profile makes milliseconds, or cycles, of the counts; what triangulating takes is taken by
the clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError, did_you_mean
from harness.figures.verdict import LEAST_PIXELS, listed
from harness.frame import SUBPIXEL, Frame, View, frame_of
from harness.profile.counted import TERMS, counters, design_of
from harness.profile.design import Draw
from harness.profile.profile import read_profile
from harness.style import ONE_COLUMN, STYLE, looks, plain_table
from harness.triangulating.frames import time_in_rounds, triangulate_polygons
from harness.triangulating.recipes import Recipe
from scenes import Scene

if TYPE_CHECKING:
    from rich.table import Table

MATTERS = 0.01
"""Share of ear clipping's lanes, or of its draw's time, below which what is saved is nothing."""

AGAIN_S, ROUNDS = 0.2, 3
"""Triangulating all that takes less is timed so often; the least counts."""

CONTRIBUTED = Path(__file__).parents[2] / "results" / "reference" / "profiles"
"""Profiles that people brought; a wheel has none."""


@dataclass(frozen=True)
class Law:
    """A device's name, and what each of `counted.TERMS` costs, (t,), in `unit`: s or cycles."""

    device: str
    costs: NDArray[np.float64]
    unit: str = "s"


COUNTED = ("fragments", "quads", "helper_lanes", "partial_quads")


@dataclass(frozen=True)
class Cost:
    """What one triangulator's triangles of a scene cost at one size.

    fragments, quads, helper_lanes, partial_quads : exact; see `rasterisers.reference.predict`
    triangulate_s : seconds that triangulating took
    draw : time of a draw in the unit of, and by a device's law, None without one
    """

    fragments: int
    quads: int
    helper_lanes: int
    partial_quads: int
    triangulate_s: float
    draw: float | None

    @property
    def lanes(self) -> int:
        """Lanes that are shaded, four a quad."""
        return 4 * self.quads

    def saved(self, base: Cost) -> float:
        """Return which share of the base's draw time is saved, of its lanes without a law."""
        if self.draw is None or base.draw is None:
            return 1.0 - self.lanes / base.lanes if base.lanes else 0.0
        return 1.0 - self.draw / base.draw if base.draw else 0.0


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
    def base(self) -> Cost:
        """The first triangulator's cost."""
        return next(iter(self.costs.values()))

    @property
    def tells(self) -> bool:
        """Whether so many pixels are covered that a share of them says something."""
        return self.base.fragments >= LEAST_PIXELS

    @property
    def best(self) -> str:
        """The triangulator that saves most; of equals, the one named first."""
        return max(self.costs, key=lambda name: self.costs[name].saved(self.base))

    @property
    def saved(self) -> float:
        """What that one saves; see `Cost.saved`."""
        return self.costs[self.best].saved(self.base)


@dataclass(frozen=True)
class Sizes:
    """What a scene costs at several sizes, the smallest first, and by which law, if by any."""

    scene: str
    law: Law | None
    sizes: tuple[Size, ...]

    @property
    def measure(self) -> str:
        """What is saved."""
        return f"draw time on {self.law.device}" if self.law else "shaded lanes"

    @property
    def timed(self) -> bool:
        """Whether the law's unit is that of triangulating, seconds."""
        return self.law is not None and self.law.unit == "s"

    @property
    def mattering(self) -> list[Size]:
        """The sizes at which something is saved, of enough pixels to tell."""
        return [size for size in self.sizes if size.saved >= MATTERS and size.tells]

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON-ready values."""
        matters = [size.resolution for size in self.mattering]
        return {
            "scene": self.scene,
            "device": self.law.device if self.law else None,
            "unit": self.law.unit if self.law else None,
            "sizes": [asdict(size) for size in self.sizes],
            "matters_at": matters,
            "matters_share": MATTERS,
            "sentence": sentence(self),
        }


def read_law(name: str, *folders: Path) -> Law:
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
        otherwise = "raster-harness profile makes one"
        hint = did_you_mean(name, list(known), otherwise=otherwise)
        raise UsageError(f"no profile {name}: it is neither a file nor a name; {hint}")
    file = known.get(name, Path(name))
    content = read_profile(file)
    try:
        costs = {term["name"]: float(term["cost"]) for term in content["terms"]}
        device, unit = str(content["device"]["name"]), str(content["unit"])
        return Law(device, np.array([costs[term] for term in TERMS]), unit)
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{file} is not a profile: {error!r}") from error


def count_size(scene: Scene, recipes: Sequence[Recipe], view: View, law: Law | None) -> Size:
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
        told = [
            *frame.dropped,
            *(n for each in made.values() for n in (*each.failed, *each.skipped)),
        ]
        raise UsageError(
            f"{scene.name}: at {view.resolution} px no polygon can be triangulated"
            f"{f': {told[0][1]}' if told else ''}; give a larger size, or fewer polygons"
        )
    starts, points = frame.offsets[:-1], frame.points
    boxes = np.maximum.reduceat(points, starts) - np.minimum.reduceat(points, starts)
    seconds = [each.seconds for each in made.values()]
    if sum(seconds) < AGAIN_S:
        seconds = [min(each) for each in time_in_rounds(recipes, frame.polygons, ROUNDS, 0)]
    costs = {}
    for (name, each), taken in zip(made.items(), seconds, strict=True):
        parts = [part if ok else None for part, ok in zip(each.parts, done, strict=True)]
        costs[name] = _cost(frame, frame.join(parts), taken, law)
    middle = float(np.median(boxes.max(axis=1)[done])) / SUBPIXEL
    kept = int(done.sum())
    return Size(view.resolution, kept, len(scene.polygons) - kept, middle, costs)


def _cost(frame: Frame, triangles: NDArray[np.int32], seconds: float, law: Law | None) -> Cost:
    counted = counters(Draw("own", "own", "own", frame, triangles))
    draw = None if law is None else float((design_of([counted]) @ law.costs)[0])
    return Cost(**{name: counted[name] for name in COUNTED}, triangulate_s=seconds, draw=draw)


def sentence(found: Sizes) -> str:
    """Return whether it matters, at which size most, and below which not."""
    base = next(iter(found.sizes[0].costs))
    first, last = found.sizes[0].resolution, found.sizes[-1].resolution
    if not any(size.tells for size in found.sizes):
        covered = max(size.base.fragments for size in found.sizes)
        return f"It cannot be told: {covered:,} pixels or fewer are covered. Give a larger size."
    if not found.mattering:
        across = f"from {first} to {last} px" if last > first else f"at {first} px"
        return (
            f"It does not matter for you: {across} no triangulator saves {MATTERS:.0%} of "
            f"{base}'s {found.measure}."
        )
    most = max(found.sizes, key=lambda size: size.saved)
    own = most.costs[most.best]
    where = f"{most.resolution} px, {most.polygon_px:.2g} px a polygon,"
    text = f"It matters: at {where} {most.best} saves {most.saved:.1%} of {base}'s {found.measure}"
    if own.draw is not None and most.base.draw is not None and found.timed:
        more, less = own.triangulate_s - most.base.triangulate_s, most.base.draw - own.draw
        draws = math.ceil(more / less)
        text += f", which pays after {draws:,} draw{'s' * (draws > 1)}" if draws > 0 else ""
    near = [
        name
        for name, cost in most.costs.items()
        if name != most.best and cost.saved(most.base) >= most.saved - MATTERS
    ]
    text += f"; {listed(near)} save{'s' * (len(near) == 1)} nearly as much" if near else ""
    low, high = found.mattering[0].resolution, found.mattering[-1].resolution
    text += f". Below {low} px nothing is gained" if low > first else ""
    text += f". Above {high} px nothing is gained" if high < last else ""
    return f"{text}."


def tables(found: Sizes) -> Iterator[Table]:
    """Yield a table for each measure: the base's, and what the others save of it."""
    kinds = [("lanes", "lanes shaded", 1.0), ("partial_quads", "partial quads", 1.0)]
    if found.law:
        per, called = (1e3, "ms") if found.law.unit == "s" else (1.0, found.law.unit)
        kinds.append(("draw", f"{called} of a draw on {found.law.device}", per))
    base, *others = found.sizes[0].costs
    heads = [f">{name}" for name in ("size", "a polygon", base, *others)]
    for name, what, unit in kinds:
        shown = plain_table(f"{found.scene}: {what}; what others save of them", *heads)
        for size in found.sizes:
            own = getattr(size.base, name) * unit
            saved = [1 - getattr(size.costs[each], name) * unit / (own or 1) for each in others]
            written = f"{own:.4g}" if name == "draw" else f"{own:,.0f}"
            shares = (f"{each:.1%}" if own else "-" for each in saved)
            shown.add_row(f"{size.resolution}", f"{size.polygon_px:.3g} px", written, *shares)
        yield shown
    shown = plain_table(f"{found.scene}: ms to triangulate; what others take more", *heads)
    for size in found.sizes:
        own = size.base.triangulate_s
        more = (f"{1e3 * (size.costs[each].triangulate_s - own):+.3g}" for each in others)
        sides = f"{size.resolution}", f"{size.polygon_px:.3g} px"
        shown.add_row(*sides, f"{1e3 * own:.3g}", *more)
    yield shown


def draw_chart(found: Sizes, file: Path) -> None:
    """Draw what each triangulator saves against the size, as PNG or SVG by the file's ending."""
    import matplotlib
    from matplotlib.figure import Figure

    base, *others = found.sizes[0].costs
    at = [size.resolution for size in found.sizes]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(ONE_COLUMN, 2.3))
        panel = figure.subplots()
        for name, look in looks([base, *others]).items():
            saved = [100 * size.costs[name].saved(size.base) for size in found.sizes]
            style: Any = {"color": look.colour, "marker": look.marker, "markersize": 4}
            panel.plot(at, saved, label=name, linewidth=1.3, **style)
        panel.set_xscale("log", base=2)
        panel.set_xticks(at, [f"{size}" for size in at])
        panel.minorticks_off()
        panel.set_xlabel("side of the viewport, px")
        panel.set_ylabel(f"saved of {base}'s\n{found.measure}, %")
        panel.legend(fontsize=7)
        figure.savefig(file)
