"""Viewport sizes at which the choice of a triangulator matters: counted, not timed.

A scene is triangulated and counted at each size as in a run, by the exact CPU reference. A device's
profile converts the counts to milliseconds; the triangulation is timed.
"""

from __future__ import annotations

import io
import math
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness import atomic
from harness.errors import UsageError
from harness.frame import View, frame_of
from harness.metrics.decision import MIN_PIXELS, MIN_SAVED_SHARE
from harness.profile.counted import TERMS, count_triangles, design_of
from harness.profile.law import FORMS, VERTICES, Law, compute_stage_times
from harness.profile.profile import is_of_this_machine, origin_of, read_law, read_profile
from harness.rasterisers.base import Options, order_submission
from harness.rasterisers.vertex_batches import count_vertices
from harness.style import ONE_COLUMN, STYLE, choose_looks, format_count, make_grid, make_plain_table
from harness.triangulating.recipes import Recipe
from harness.triangulating.triangulate import time_in_rounds, triangulate_polygons
from scenes import Scene
from scenes.spec import import_optional
from triangulators.errors import suggest

if TYPE_CHECKING:
    from rich.table import Table

MAIN_PART = 0.8
"""Minimum part of the largest saving that the recommended triangulator reaches."""

MIN_TIMED_S, TIMED_ROUNDS = 0.2, 3
"""Shorter triangulations are timed in several rounds, of which the minimum counts."""

CONTRIBUTED = Path(__file__).parents[1] / "results" / "reference" / "profiles"
"""Contributed profiles; an installed wheel has none."""


@dataclass(frozen=True)
class DeviceCosts:
    """A device's law, from a profile.

    costs : seconds for each of `counted.TERMS`, (t,)
    form : one of `law.FORMS`
    law : the law with its covariance, or None if the profile stores no times
    origin : the device and processor on which the profile was measured
    is_here : True if this machine has the device and processor
    """

    name: str
    costs: NDArray[np.float64]
    form: str = "sum"
    law: Law | None = None
    origin: str = ""
    is_here: bool = True

    @property
    def stages(self) -> list[str]:
        """The names of its stages."""
        return list(FORMS[self.form])


COUNTED = (
    "fragments",
    "quads",
    "helper_lanes",
    "partial_quads",
    "covering_triangles",
    "vertex_batches",
    "transformed_vertices",
)
"""Counters, see `count_triangles`."""

Cost = dict[str, Any]
"""Cost of one triangulator's triangles: `COUNTED`; `triangulate_s`, CPU seconds; `draw`, the
modelled draw time in seconds, and `draw_walk`, that in the order of a walk; `stage`, which of the
device's stages is slowest; and `saved_95`, the 95 % interval of the saved share of the base's draw
time. All from `draw` on are None without a device."""

REMEDIES = {
    "triangles": "fewer covering triangles",
    "pixels": "fewer quads",
    "triangles and pixels": "fewer covering triangles and quads",
    "arithmetic": "fewer quads",
}
"""What shortens a stage that depends on the triangulation; that of vertices depends on the order
of triangles."""


@dataclass(frozen=True)
class Size:
    """Costs of a scene at one size.

    resolution : side of the viewport in px, which the scene fills
    polygons : number of polygons that all triangulators triangulate
    skipped : number of polygons that vanish on the grid, or on which a triangulator fails
    polygon_px : median of the longer sides of the polygons' bounding boxes
    costs : by triangulator, the base first
    """

    resolution: int
    polygons: int
    skipped: int
    polygon_px: float
    costs: dict[str, Cost]

    @property
    def covered(self) -> int:
        """Covered pixels, equal for all triangulators."""
        return int(next(iter(self.costs.values()))["fragments"])

    @property
    def saved(self) -> dict[str, float]:
        """Saved share, by triangulator, of the base's draw time, or of its lanes without device."""
        spent = {n: c["quads"] if c["draw"] is None else c["draw"] for n, c in self.costs.items()}
        base = next(iter(spent.values()))
        return {name: 1.0 - cost / base if base else 0.0 for name, cost in spent.items()}

    @property
    def matters(self) -> bool:
        """True if savings reach `MIN_SAVED_SHARE`, over enough pixels for a conclusion."""
        return max(self.saved.values()) >= MIN_SAVED_SHARE and self.covered >= MIN_PIXELS


@dataclass(frozen=True)
class Sizes:
    """Costs of a scene at several sizes, the smallest first.

    device : the device whose draw times are modelled, or None
    source : the user's name of the scene or file
    """

    scene: str
    device: DeviceCosts | None
    sizes: tuple[Size, ...]
    source: str = "FILE"

    @property
    def largest(self) -> Size | None:
        """The size with the largest saving, or None if the triangulator does not matter."""
        mattering = [size for size in self.sizes if size.matters]
        return max(mattering, key=lambda size: max(size.saved.values()), default=None)

    @property
    def recommended(self) -> str:
        """The fastest triangulator with `MAIN_PART` of the largest saving, or the base."""
        if self.largest is None:
            return next(iter(self.sizes[0].costs))
        saved, costs = self.largest.saved, self.largest.costs
        enough = [n for n, share in saved.items() if share >= MAIN_PART * max(saved.values())]
        return min(enough, key=lambda name: float(costs[name]["triangulate_s"]))

    @property
    def measure(self) -> str:
        """Name of the saved quantity."""
        return f"draw time on {self.device.name}" if self.device else "shaded lanes"

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {
            "scene": self.scene,
            "device": self.device.name if self.device else None,
            "measured_on": self.device.origin if self.device else None,
            "unit": "s" if self.device else None,
            "sizes": [asdict(size) for size in self.sizes],
            "matters_at": [size.resolution for size in self.sizes if size.matters],
            "matters_share": MIN_SAVED_SHARE,
            "sentence": summarise(self),
            "stages": list(list_stages(self)),
            "recommended": self.recommended,
            "next": format_next_step(self),
        }


def read_costs(name: str, *folders: Path) -> DeviceCosts:
    """Return the costs of a profile: a file, or the name of a profile in `folders` or contributed.

    Raises UsageError if the profile is missing, invalid or refused.
    """
    profiles = {
        file.stem: file
        for folder in (CONTRIBUTED, *folders)
        for file in sorted(folder.glob("*.json"))
        if not file.stem.endswith(".refused")
    }
    if name not in profiles and not Path(name).exists():
        hint = suggest(
            name, sorted(profiles), cutoff=0.4, fallback="raster-harness profile makes one"
        )
        raise UsageError(f"--profile {name}: neither a file nor a known name; {hint}")
    return read_profile(profiles.get(name, Path(name)), _make_costs)


def _make_costs(profile: Any) -> DeviceCosts:
    costs = {term["name"]: float(term["cost"]) for term in profile["terms"]}
    device, law = profile["device"], read_law(profile)
    seconds = np.array([costs[term] for term in TERMS])
    origin = origin_of(device), is_of_this_machine(device)
    return DeviceCosts(str(device["name"]), seconds, profile["form"], law, *origin)


def count_size(
    scene: Scene, recipes: Sequence[Recipe], view: View, device: DeviceCosts | None
) -> Size:
    """Return the costs of the scene at one size, for two or more `recipes`.

    Raises UsageError if the scene defines the view, or no polygon can be drawn at this size.
    """
    frame = frame_of(scene, view)
    results = {str(recipe): triangulate_polygons(recipe, frame.polygons) for recipe in recipes}
    drawn = np.all([result.drawn for result in results.values()], axis=0)
    if not drawn.any():
        raise UsageError(
            f"{scene.name}: no polygon triangulated by all triangulators at {view.resolution} px; "
            "give a larger size, or fewer triangulators"
        )
    seconds = [result.seconds for result in results.values()]
    if sum(seconds) < MIN_TIMED_S:
        rounds = time_in_rounds(recipes, frame.polygons, TIMED_ROUNDS, 0)
        seconds = [min(samples) for samples in rounds]
    counters, walk = [], Options(order="walk")
    for result in results.values():
        parts = [part if ok else None for part, ok in zip(result.parts, drawn, strict=True)]
        triangles = frame.join(parts)
        walked = count_vertices(frame, order_submission(frame, triangles, walk))
        counts = count_triangles(frame, triangles)
        counters.append(counts | {f"{name}_walk": value for name, value in walked.items()})
    costs = dict(zip(results, _list_costs(counters, seconds, device), strict=True))
    low, high = frame.polygons.bounds()
    polygon_px = float(np.median((high - low)[drawn].max(axis=1)))
    polygons = int(drawn.sum())
    return Size(view.resolution, polygons, len(scene.polygons) - polygons, polygon_px, costs)


def _list_costs(
    counters: Sequence[dict[str, int]], seconds: Sequence[float], device: DeviceCosts | None
) -> list[Cost]:
    """Return the cost of each triangulator from counters and seconds, the base first."""
    costs: list[Cost] = [
        {name: counts[name] for name in COUNTED}
        | {"triangulate_s": cpu_s}
        | dict.fromkeys(("draw", "draw_walk", "stage", "saved_95"))
        for counts, cpu_s in zip(counters, seconds, strict=True)
    ]
    if device is not None:
        design = design_of(counters)
        walked = design_of(
            [counts | {n: counts[f"{n}_walk"] for n in VERTICES} for counts in counters]
        )
        times = compute_stage_times(design, device.costs, device.form)
        walk_times = compute_stage_times(walked, device.costs, device.form)
        for cost, row, draw, walk in zip(costs, design, times, walk_times, strict=True):
            cost["draw"], cost["draw_walk"] = float(draw.max()), float(walk.max())
            cost["stage"] = device.stages[int(draw.argmax())]
            if device.law is not None and times[0].max() > 0:
                cost["saved_95"] = device.law.saved_interval(row, design[0], device.costs)
    return costs


def summarise(sizes: Sizes) -> str:
    """Return a sentence: the sizes at which the triangulator matters, and the largest saving."""
    base = next(iter(sizes.sizes[0].costs))
    covered = max(size.covered for size in sizes.sizes)
    if covered < MIN_PIXELS:
        return f"Inconclusive: at most {covered:,} pixels are covered; give a larger size."
    mattering = [size for size in sizes.sizes if size.matters]
    ends = (mattering or sizes.sizes)[:: max(1, len(mattering or sizes.sizes) - 1)]
    across = " to ".join(str(size.resolution) for size in ends)
    if not mattering:
        return (
            f"It does not matter for you: at {across} px no triangulator saves "
            f"{MIN_SAVED_SHARE:.0%} of {base}'s {sizes.measure}."
        )
    largest = sizes.largest or mattering[0]
    best = max(largest.saved.items(), key=itemgetter(1))[0]
    text = (
        f"It matters at {across} px, most at {largest.resolution} px "
        f"({_format_pixels(largest.polygon_px, 2)} per polygon): "
        f"{best} saves {_format_saving(largest, best)} of {base}'s {sizes.measure}"
    )
    if sizes.device:
        cost, base_cost = (largest.costs[name] for name in (best, base))
        more = cost["triangulate_s"] - base_cost["triangulate_s"]
        draws = math.ceil(more / (base_cost["draw"] - cost["draw"]))
        text += f"; break-even after {format_count(draws, 'draw')}" if draws > 0 else ""
    return f"{text}."


def list_stages(sizes: Sizes) -> Iterator[str]:
    """Yield for each size the base's slowest stage, if the device has several, and its remedy."""
    if sizes.device is None or len(sizes.device.stages) == 1:
        return
    for size in sizes.sizes:
        base, cost = next(iter(size.costs.items()))
        best = max(size.saved, key=lambda name: size.saved[name])
        text = f"At {size.resolution} px {base} is bound by {cost['stage']}: "
        if cost["stage"] in REMEDIES:
            saving = f"use {best}, which saves {_format_saving(size, best)}"
            text += f"{REMEDIES[cost['stage']]}; {saving if best != base else f'keep {base}'}"
        else:
            walk = 1.0 - cost["draw_walk"] / cost["draw"]
            saving = f"use --order walk, which saves {walk:.1%}"
            text += f"the order of triangles decides; {saving if walk > 0 else 'keep its order'}"
        yield f"{text}."


def _format_saving(size: Size, name: str) -> str:
    """Format the saved share of the base's cost, with the interval if known."""
    interval = size.costs[name].get("saved_95")
    text = f"{size.saved[name]:.1%}"
    return f"{text} (95 % CI {100 * interval[0]:.1f} to {interval[1]:.1%})" if interval else text


def format_next_step(sizes: Sizes) -> str:
    """Return the recommended triangulator, with a command and a Python call."""
    name, size = sizes.recommended, sizes.largest
    if size is None:
        return f"Next: keep {name}."
    return (
        f"Next: use {name}, the fastest triangulator with most of the saving "
        f"({_format_saving(size, name)}): raster-harness triangulate "
        f"{shlex.quote(sizes.source)} -o OUT.glb --triangulator {name}, or in Python "
        f'triangulators.triangulate(polygon, "{name}").'
    )


def _format_pixels(side: float, digits: int) -> str:
    """Format a side with significant digits, without exponent."""
    return f"{side:,.0f} px" if side >= 10 ** (digits - 1) else f"{side:.{digits}g} px"


def make_tables(sizes: Sizes) -> Iterator[Table]:
    """Yield a table for each quantity: the base's value, and other triangulators relative to it."""
    kinds = [
        ("triangulate_s", "ms to triangulate", 1e3, ".3g"),
        ("quads", "lanes shaded", 4.0, ",.0f"),
        ("covering_triangles", "covering triangles", 1.0, ",.0f"),
        ("transformed_vertices", "transformed vertices", 1.0, ",.0f"),
    ]
    if sizes.device:
        kinds.append(("draw", f"ms of a draw on {sizes.device.name}", 1e3, ".4g"))
    base = next(iter(sizes.sizes[0].costs))
    heads = [f">{name}" for name in ("size", "per polygon", *sizes.sizes[0].costs)]
    for name, quantity, unit, form in kinds:
        table = make_plain_table(f"{sizes.scene}: {quantity}; others relative to {base}", *heads)
        for size in sizes.sizes:
            first, *costs = (cost[name] for cost in size.costs.values())
            ratios = (f"{cost / first:.3f}" if first else "-" for cost in costs)
            sides = str(size.resolution), _format_pixels(size.polygon_px, 3)
            table.add_row(*sides, format(unit * first, form), *ratios)
        yield table


def draw_chart(sizes: Sizes, file: Path) -> None:
    """Draw the savings of each triangulator over the size, as PNG or SVG by the file's suffix."""
    matplotlib = import_optional("matplotlib", file, "plots")
    base = next(iter(sizes.sizes[0].costs))
    at = [size.resolution for size in sizes.sizes]
    with matplotlib.rc_context(STYLE):
        figure, (panel,) = make_grid((ONE_COLUMN, 2.3))
        for name, look in choose_looks(list(sizes.sizes[0].costs)).items():
            saved = [100 * size.saved[name] for size in sizes.sizes]
            panel.plot(at, saved, label=name, color=look.colour, marker=look.marker, markersize=4)
        panel.set_xscale("log", base=2)
        panel.set_xticks(at, [str(size) for size in at])
        panel.set_xlabel("side of the viewport, px")
        panel.set_ylabel(f"saved of {base}'s\n{sizes.measure}, %")
        panel.legend(fontsize=7)
        content = io.BytesIO()
        figure.savefig(content, format=file.suffix.removeprefix(".").lower())
    atomic.write(file, content.getvalue())
