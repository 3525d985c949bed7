"""Defaults and limits of runs and studies; imports little, as `--help` shows these values."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

DEFAULT_TRIANGULATORS = (
    "fan",
    "ear-clipping",
    "earcut-refine",
    "delaunay",
    "refined:half-perimeter",
    "optimal:overdraw",
    "optimal:half-perimeter",
    "optimal:expected-quads",
)

# For views of a model. Edge length is proportional to the half-perimeter averaged over rotations.
MODEL_TRIANGULATORS = (
    "original",
    "ear-clipping",
    "delaunay",
    "optimal:edge-length",
    "optimal:half-perimeter",
)

# Counters that represent the cost of drawing; a rasteriser's main counter is the first it counts.
COST_COUNTERS = ("helper_lanes", "quads", "covering_triangles", "bbox_tests")
HISTORY_METRICS = (*COST_COUNTERS, "time")  # defaults of `history`

RESOLUTIONS = (8, 16384)  # bounds of the viewport's side, in pixels
Fit = Literal["box", "circle", "tile", "view"]  # how a scene is fitted to the viewport, see `View`
FITS: tuple[Fit, ...] = get_args(Fit)
CHOSEN_FITS = Literal["box", "circle"]  # by a user; map tiles have "tile", and models "view"
SAMPLES = (1, 4, 8)  # numbers of samples per pixel
MAX_WORK = 65_000  # of `Options.work`: llvmpipe silently ends a loop after 65,535 iterations
MAX_LOOKUPS = 64  # texture lookups per fragment
Order = Literal["native", "walk", "vertex-cache", "morton", "shuffled"]  # see `Options`
ORDERS: tuple[Order, ...] = get_args(Order)
MAX_SEED = 2**63 - 1
TIMEOUT_S = 600.0  # of a triangulator or a device
QUICK_TIMEOUT_S = 60.0  # the same with --quick
MAX_REPEATS = 1000  # of `TimingSettings.processes`, as a thousand processes take hours
MAX_S = 1e6  # larger values of options in seconds are mistakes


@dataclass(frozen=True)
class TimingSettings:
    """Precision and limits of timing.

    precision : target half-width, relative to the centre, of each drawing's 95 % interval: that of
        the median time, or of the time relative to the geometric mean of all candidates
    paired : True to compare candidates with each other; then a batch has equally many draws for all
        candidates, unless it would take longer than `MAX_BATCHES` usual batches. Otherwise the
        fixed cost of a batch, shared among fewer draws, would look like a slower draw
    """

    precision: float = 0.01
    budget_s: float = 1.3  # per candidate; ends the rounds, even if `precision` is not reached
    min_batch_s: float = 1e-3  # minimum of a batch of draws, which takes at least 100 timer steps
    warm_up_s: float = 0.5  # maximum per candidate
    min_share: float = 0.5  # of the budget, always used, so that small differences become visible
    paired: bool = True
    epochs: int = 6  # minimum; all drawings are prepared again at the beginning of each
    processes: int = 1  # new processes that repeat the timing, one after another
    limit_s: float | None = None  # of the rounds, shared by all processes

    def get_process_settings(self, number: int, spent_s: float) -> "TimingSettings | None":
        """Return the settings for process `number` (from 0), or None if the time limit is over.

        The remaining processes share the remaining time equally. The first process always starts.
        """
        if self.limit_s is None:
            return self
        remaining_s = max(0.0, self.limit_s - spent_s)
        if number > 0 and remaining_s == 0.0:
            return None
        return replace(self, limit_s=remaining_s / (self.processes - number))


@dataclass(frozen=True)
class StudySize:
    """Size of a study.

    A polygon with fewer than `all_below` triangulations is measured with all of them, including
    those with T-junctions, which the paper allows, instead of random triangulations.
    """

    polygons: int = 24
    random: int = 30  # random triangulations per polygon
    max_vertices: int = 400  # of a polygon, as optima of larger polygons take long
    all_below: int = 100
