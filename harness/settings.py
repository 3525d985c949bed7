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
"""Counters that represent the cost, the best first."""

HISTORY_METRICS = (*COST_COUNTERS, "time")
"""Default metrics of `history`."""

RESOLUTIONS = (8, 16384)
"""Lower and upper bound of the viewport's side, in pixels."""

Fit = Literal["box", "circle", "tile", "view"]
"""Mapping of a scene to the viewport, see `View`."""

FITS: tuple[Fit, ...] = get_args(Fit)

CHOSEN_FITS = Literal["box", "circle"]
"""Fits of scenes that do not define the view."""

SAMPLES = (1, 4, 8)
"""Numbers of samples per pixel."""

MAX_WORK = 65_000
"""Iterations per fragment; llvmpipe silently ends a loop after 65,535 iterations."""

MAX_LOOKUPS = 64
"""Upper bound of texture lookups per fragment."""

Order = Literal["native", "walk", "vertex-cache", "morton", "shuffled"]
"""Triangle submission order, which affects caches and early tests; see `Options`."""

ORDERS: tuple[Order, ...] = get_args(Order)

MAX_SEED = 2**63 - 1

TIMEOUT_S = 600.0
QUICK_TIMEOUT_S = 60.0
"""Time limit of a triangulator or a device, without and with --quick."""

MAX_REPEATS = 1000
"""Maximum number of processes in which a run is timed; a thousand take hours."""

MAX_S = 1e6
"""Upper bound of options in seconds; larger values are mistakes."""


@dataclass(frozen=True)
class TimingSettings:
    """Precision and limits of timing.

    precision : target half-width of a drawing's 95 % interval, relative to the centre: of the
        median, or of the time relative to the geometric mean of all candidates
    budget_s : average drawing time per candidate; ends the rounds if `precision` is not reached
    min_batch_s : minimum duration of a batch of draws, which also lasts 100 steps of the timer
    warm_up_s : longest warm-up per candidate
    min_share : share of the budget that is always used, so that pairs reveal small differences
    epochs : minimum number of preparations of the drawings, if they can be prepared again
    paired : True to compare candidates with each other; then all have equal draws per batch, up to
        `MAX_BATCHES` batches' length, as the fixed cost of a batch, shared among fewer draws, would
        look like a slower draw
    processes : number of new processes that repeat the timing, one after another
    limit_s : time limit of the rounds, shared by all processes, or None
    """

    precision: float = 0.01
    budget_s: float = 1.3
    min_batch_s: float = 1e-3
    warm_up_s: float = 0.5
    min_share: float = 0.5
    paired: bool = True
    epochs: int = 6
    processes: int = 1
    limit_s: float | None = None

    def of_process(self, number: int, spent_s: float) -> "TimingSettings | None":
        """Return the settings of one process, or None if the time limit is over.

        The process gets an equal share of the time remaining after `spent_s`; the first process
        always starts.
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

    polygons : number of polygons of the scene
    random : number of random triangulations per polygon
    max_vertices : maximum number of vertices of a polygon, as optima of larger ones take long
    all_below : number of triangulations below which all are measured instead of random ones,
        including the paper's triangulations with T-junctions
    """

    polygons: int = 24
    random: int = 30
    max_vertices: int = 400
    all_below: int = 100
