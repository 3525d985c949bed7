"""Viewport sizes at which the triangulator matters, by exact counts and a device's profile."""

from __future__ import annotations

import io
import math
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness import atomic
from harness.errors import UsageError
from harness.frame import View, make_scene_frame
from harness.metrics.decision import (
    MIN_PIXELS,
    MIN_SAVED_SHARE,
    choose_recommended,
    describe_recommended,
    find_largest_saving,
)
from harness.profile.device_costs import (
    Cost,
    DeviceCosts,
    compute_saved_shares,
    count_native_and_walk,
    describe_stage,
    format_saving,
    predict_draw_costs,
)
from harness.style import (
    ONE_COLUMN,
    STYLE,
    choose_looks,
    format_count,
    make_figure,
    make_plain_table,
)
from harness.triangulating.recipes import Recipe
from harness.triangulating.triangulate import time_in_rounds, triangulate_polygons
from scenes import Scene
from scenes.spec import import_optional

if TYPE_CHECKING:
    from rich.table import Table

MIN_TIMED_S, TIMED_ROUNDS = 0.2, 3  # below this total, the minimum of several rounds is used

COST_TERMS = (
    "fragments",
    "quads",
    "helper_lanes",
    "partial_quads",
    "covering_triangles",
    "vertex_batches",
    "transformed_vertices",
)
"""Counters in the cost of a triangulator, from `count_cost_terms`. The cost also has
`triangulate_s`, in CPU seconds, and the entries of `predict_draw_costs`, None without a device."""


@dataclass(frozen=True)
class Size:
    """Costs of a scene at one size."""

    resolution: int  # side of the viewport in px, which the scene fills
    polygons: int  # triangulated by all triangulators
    skipped: int  # that vanish on the grid, or on which a triangulator fails
    polygon_px: float  # median, over the polygons, of the longer side of the bounding box
    costs: dict[str, Cost]  # by triangulator, the base first; see `COST_TERMS`

    @property
    def covered(self) -> int:
        """Number of fragments, equal for all triangulators."""
        return int(next(iter(self.costs.values()))["fragments"])

    @property
    def saved(self) -> dict[str, float]:
        """Share of the base's draw time that each triangulator saves; without device, of lanes."""
        spent = {n: c["quads"] if c["draw"] is None else c["draw"] for n, c in self.costs.items()}
        return compute_saved_shares(spent)

    @property
    def matters(self) -> bool:
        """True if a triangulator saves `MIN_SAVED_SHARE`, and enough pixels are covered."""
        return max(self.saved.values()) >= MIN_SAVED_SHARE and self.covered >= MIN_PIXELS


@dataclass(frozen=True)
class Sizes:
    """Costs of a scene at several sizes, the smallest first."""

    scene: str
    device: DeviceCosts | None  # whose draw times are modelled
    sizes: tuple[Size, ...]
    source: str = "FILE"  # the user's name of the scene or file

    @property
    def size_of_largest_saving(self) -> Size | None:
        """The size at which a triangulator saves most, or None if the choice matters at no size."""
        mattering = [size for size in self.sizes if size.matters]
        return max(mattering, key=lambda size: max(size.saved.values()), default=None)

    @property
    def recommended_triangulator(self) -> str:
        """The recommendation at the size with the largest saving; the base if no size matters."""
        if self.size_of_largest_saving is None:
            return next(iter(self.sizes[0].costs))
        costs = self.size_of_largest_saving.costs
        seconds = {name: cost["triangulate_s"] for name, cost in costs.items()}
        return choose_recommended(self.size_of_largest_saving.saved, seconds)

    @property
    def measure(self) -> str:
        """Name of the cost of which `Size.saved` is a share."""
        return f"draw time on {self.device.name}" if self.device else "shaded lanes"

    def to_json(self) -> dict[str, Any]:
        """Return the output of `inspect --sizes --json`, JSON-ready."""
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
            "recommended": self.recommended_triangulator,
            "next": format_next_step(self),
        }


def count_size(
    scene: Scene, recipes: Sequence[Recipe], view: View, device: DeviceCosts | None
) -> Size:
    """Return the costs of the scene at one size, for two or more `recipes`."""
    frame = make_scene_frame(scene, view)
    results = {str(recipe): triangulate_polygons(recipe, frame.polygons) for recipe in recipes}
    drawn = np.all([result.drawn for result in results.values()], axis=0)
    drawn &= ~np.isin(frame.source, frame.source[~drawn])  # all pieces of a polygon, or none
    if not drawn.any():
        raise UsageError(
            f"{scene.name}: no polygon triangulated by all triangulators at {view.resolution} px; "
            "give a larger size, or fewer triangulators"
        )
    seconds = [result.seconds for result in results.values()]
    if sum(seconds) < MIN_TIMED_S:
        rounds = time_in_rounds(recipes, frame.polygons, TIMED_ROUNDS, 0)
        seconds = [min(samples) for samples in rounds]
    counters = []
    for result in results.values():
        parts = [part if ok else None for part, ok in zip(result.parts, drawn, strict=True)]
        counters.append(count_native_and_walk(frame, frame.join_triangles(parts)))
    costs = dict(zip(results, _list_costs(counters, seconds, device), strict=True))
    low, high = frame.polygons.bounds()
    polygon_px = float(np.median((high - low)[drawn].max(axis=1)))
    polygons = len(np.unique(frame.source[drawn]))
    return Size(view.resolution, polygons, len(scene.polygons) - polygons, polygon_px, costs)


def _list_costs(
    counters: Sequence[dict[str, int]], seconds: Sequence[float], device: DeviceCosts | None
) -> list[Cost]:
    unknown: list[Cost] = [dict.fromkeys(("draw", "draw_walk", "stage", "saved_95"))]
    draws = predict_draw_costs(counters, device) if device else unknown * len(counters)
    return [
        {name: counts[name] for name in COST_TERMS} | {"triangulate_s": cpu_s} | draw
        for counts, cpu_s, draw in zip(counters, seconds, draws, strict=True)
    ]


def summarise(sizes: Sizes) -> str:
    """Return a sentence: the sizes at which the triangulator matters, and the largest saving."""
    base = next(iter(sizes.sizes[0].costs))
    covered = max(size.covered for size in sizes.sizes)
    if covered < MIN_PIXELS:
        return f"Inconclusive: at most {covered:,} pixels are covered; give a larger size."
    counted = [size for size in sizes.sizes if size.covered >= MIN_PIXELS]
    mattering = [size for size in counted if size.matters]
    across = _format_range([size.resolution for size in sizes.sizes], mattering or counted)
    if not mattering:
        return (
            f"The triangulator does not matter: at {across} px none saves "
            f"{MIN_SAVED_SHARE:.0%} of {base}'s {sizes.measure}."
        )
    largest = sizes.size_of_largest_saving or mattering[0]
    best = find_largest_saving(largest.saved)
    text = (
        f"The triangulator matters at {across} px, most at {largest.resolution} px "
        f"({_format_pixels(largest.polygon_px, 2)} per polygon): "
        f"{best} saves {_format_saving(largest, best)} of {base}'s {sizes.measure}"
    )
    if sizes.device:
        cost, base_cost = (largest.costs[name] for name in (best, base))
        more = cost["triangulate_s"] - base_cost["triangulate_s"]
        draws = math.ceil(more / (base_cost["draw"] - cost["draw"]))
        text += f"; break-even after {format_count(draws, 'draw')}" if draws > 0 else ""
    return f"{text}."


def _format_range(resolutions: Sequence[int], named: Sequence[Size]) -> str:
    """Format sizes as "32 to 128", or one by one if some of `resolutions` between are missing."""
    numbers = [size.resolution for size in named]
    first = resolutions.index(numbers[0])
    if list(resolutions[first : first + len(numbers)]) == numbers:
        return f"{numbers[0]} to {numbers[-1]}" if len(numbers) > 1 else str(numbers[0])
    return ", ".join(map(str, numbers))


def list_stages(sizes: Sizes) -> Iterator[str]:
    """Yield each size's slowest stage of the base, with a remedy; nothing for a single stage."""
    if sizes.device is not None and len(sizes.device.stages) > 1:
        for size in sizes.sizes:
            yield describe_stage(f"{size.resolution} px", size.costs, sizes.device)


def _format_saving(size: Size, name: str) -> str:
    return format_saving(size.saved[name], size.costs[name].get("saved_95"))


def format_next_step(sizes: Sizes) -> str:
    """Return the recommended triangulator, with a command and a Python call."""
    name, size = sizes.recommended_triangulator, sizes.size_of_largest_saving
    if size is None:
        return f"Next: keep {name}."
    return (
        f"Next: use {describe_recommended(name)}, {_format_saving(size, name)}: "
        f"raster-harness triangulate "
        f"{shlex.quote(sizes.source)} -o OUT.glb --triangulator {name}, or in Python "
        f'triangulators.triangulate(polygon, "{name}").'
    )


def _format_pixels(side: float, digits: int) -> str:
    """Format a length in px with at least `digits` significant digits, without exponent."""
    return f"{side:,.0f} px" if side >= 10 ** (digits - 1) else f"{side:.{digits}g} px"


def make_tables(sizes: Sizes) -> Iterator[Table]:
    """Yield a table for each quantity: the base's value, and the other triangulators' ratios."""
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
        figure, (panel,) = make_figure((ONE_COLUMN, 2.3))
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
