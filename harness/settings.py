"""Defaults and limits of runs and studies, without heavy imports, as `--help` needs them."""

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
)

MODEL_TRIANGULATORS = (
    "original",
    "ear-clipping",
    "delaunay",
    "optimal:edge-length",
    "optimal:half-perimeter",
)
"""Defaults for a model in views: edge length is proportional to H averaged over rotations."""

COST_COUNTERS = ("helper_lanes", "quads", "covering_triangles", "bbox_tests")
"""Counters that stand for the cost, the best first."""

HISTORY_METRICS = (*COST_COUNTERS, "time")
"""What `history` follows: the counters that stand for the cost, and time."""

RESOLUTIONS = (8, 16384)
"""Lower and upper bound of the viewport's side, in pixels."""

Fit = Literal["box", "circle", "tile", "view"]
"""How a scene is mapped to the viewport, see `View`."""

FITS: tuple[Fit, ...] = get_args(Fit)

CHOSEN_FITS = Literal["box", "circle"]
"""Fits of scenes that do not define their view."""

SAMPLES = (1, 4, 8)
"""Numbers of samples per pixel."""

MAX_WORK = 65_000
"""Iterations per fragment; llvmpipe silently ends a loop after 65,535 iterations."""

MAX_LOOKUPS = 64
"""Upper bound of texture lookups per fragment."""

Order = Literal["native", "walk", "vertex-cache", "morton", "shuffled"]
"""Triangle submission order, which caches and early tests depend on; see `Options`."""

ORDERS: tuple[Order, ...] = get_args(Order)

MAX_SEED = 2**63 - 1

TIMEOUT_S = 600.0
QUICK_TIMEOUT_S = 60.0
"""Time limit of a triangulator or a device, without and with --quick."""

MAX_REPEATS = 1000
"""Upper bound of the processes in which a run is timed; a thousand take hours."""

MAX_S = 1e6
"""Upper bound of options in seconds; larger values are mistakes."""


@dataclass(frozen=True)
class TimingSettings:
    """How carefully to time.

    precision : target half-width of a drawing's 95 % interval, relative to its centre: of the
        median, or of the time relative to the geometric mean of all candidates
    budget_s : average drawing time per candidate; ends the rounds if `precision` is not reached
    min_batch_s : lower bound of a batch of draws, which also lasts 100 resolutions of the timer
    warm_up_s : longest warm-up per candidate
    least_share : share of the budget that is always spent, so that pairs reveal small differences
    epochs : lower bound of the number of times drawings are prepared, if they can be; 1: once
    paired : whether candidates are compared with each other; then all have equal draws per batch,
        since the fixed cost of a batch, shared among fewer draws, would look like a slower draw;
        up to `MAX_BATCHES` batches' length, beyond which that cost is too small to show
    processes : number of fresh processes that repeat the timing, one after another
    limit_s : time limit of the rounds, shared by all processes, or None
    """

    precision: float = 0.01
    budget_s: float = 1.3
    min_batch_s: float = 1e-3
    warm_up_s: float = 0.5
    least_share: float = 0.5
    paired: bool = True
    epochs: int = 6
    processes: int = 1
    limit_s: float | None = None

    def of_process(self, number: int, spent_s: float) -> "TimingSettings | None":
        """Return the settings of one process, or None if the time limit is over.

        It gets an equal share of the time left after `spent_s`; the first process always starts.
        """
        if self.limit_s is None:
            return self
        left_s = max(0.0, self.limit_s - spent_s)
        if number > 0 and left_s == 0.0:
            return None
        return replace(self, limit_s=left_s / (self.processes - number))


@dataclass(frozen=True)
class StudySize:
    """Size of a study.

    polygons : number of polygons of the scene
    random : random triangulations of each
    most_vertices : larger polygons are skipped, because their optima take long
    all_below : all triangulations of a polygon with fewer than this are measured instead of random
        ones, including those with T-junctions of the paper's method
    """

    polygons: int = 24
    random: int = 30
    most_vertices: int = 400
    all_below: int = 100
