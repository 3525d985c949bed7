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

MODEL_TRIANGULATORS = (
    "original",
    "ear-clipping",
    "delaunay",
    "optimal:edge-length",
    "optimal:half-perimeter",
)
"""Default triangulators for views of a model. One optimum is that of edge length, because edge
length is proportional to the half-perimeter averaged over rotations."""

COST_COUNTERS = ("helper_lanes", "quads", "covering_triangles", "bbox_tests")
"""Counters that represent the cost of drawing. The main counter of a rasteriser is the first of
these that it counts."""

HISTORY_METRICS = (*COST_COUNTERS, "time")
"""Default metrics of `history`."""

RESOLUTIONS = (8, 16384)
"""Lower and upper bound of the viewport's side, in pixels."""

Fit = Literal["box", "circle", "tile", "view"]
"""Names of the shapes by which a scene is fitted to the viewport, see `View`."""

FITS: tuple[Fit, ...] = get_args(Fit)
"""All values of `Fit`."""

CHOSEN_FITS = Literal["box", "circle"]
"""Fits that a user can choose; map tiles have "tile", and models "view"."""

SAMPLES = (1, 4, 8)
"""Numbers of samples per pixel."""

MAX_WORK = 65_000
"""Maximum of `Options.work`: llvmpipe silently ends a loop after 65,535 iterations."""

MAX_LOOKUPS = 64
"""Upper bound of texture lookups per fragment."""

Order = Literal["native", "walk", "vertex-cache", "morton", "shuffled"]
"""Order in which triangles are submitted to the device, see `Options`."""

ORDERS: tuple[Order, ...] = get_args(Order)

MAX_SEED = 2**63 - 1

TIMEOUT_S = 600.0
QUICK_TIMEOUT_S = 60.0
"""Time limits in seconds of a triangulator or a device, without and with --quick."""

MAX_REPEATS = 1000
"""Upper bound of `TimingSettings.processes`, as a thousand processes take hours."""

MAX_S = 1e6
"""Upper bound of options in seconds; larger values are mistakes."""


@dataclass(frozen=True)
class TimingSettings:
    """Precision and limits of timing.

    precision : target half-width, relative to the centre, of each drawing's 95 % interval: that of
        the median time, or of the time relative to the geometric mean of all candidates
    budget_s : seconds per candidate after which the rounds end, even if `precision` is not reached
    min_batch_s : minimum duration of a batch of draws; a batch also takes at least 100 steps of the
        timer
    warm_up_s : maximum duration of the warm-up of a candidate
    min_share : share of the budget that is always used, so that small differences become visible
    epochs : minimum number of epochs; at the beginning of each, all drawings are prepared again
    paired : True to compare candidates with each other; then a batch has equally many draws for all
        candidates, unless it would take longer than `MAX_BATCHES` usual batches. Otherwise the
        fixed cost of a batch, shared among fewer draws, would look like a slower draw
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

    def get_process_settings(self, number: int, spent_s: float) -> "TimingSettings | None":
        """Return the settings for process `number` (from 0), or None if the time limit is over.

        The time remaining after `spent_s` is divided equally among this process and those after it.
        The first process always starts.
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
    max_vertices : maximum number of vertices of a polygon, as optima of larger polygons take long
    all_below : a polygon with fewer triangulations than this number is measured with all its
        triangulations (including those with T-junctions, which the paper allows) instead of random
        triangulations
    """

    polygons: int = 24
    random: int = 30
    max_vertices: int = 400
    all_below: int = 100
