"""What a run measures, how carefully, and within which limits: all that `--help` needs to know."""

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
"""Of a model that is seen from several sides: the length is the mean of H over rotations."""

COST_COUNTERS = ("helper_lanes", "quads", "bbox_tests")
"""Counters that stand for the cost, the best first."""

HISTORY_METRICS = (*COST_COUNTERS, "time")
"""What `history` follows: the counters that stand for the cost, and time."""

RESOLUTIONS = (8, 16384)
"""Least and most pixels along a side of the viewport."""

Fit = Literal["box", "circle", "tile", "view"]
"""How the scene is laid on the viewport."""

FITS: tuple[Fit, ...] = get_args(Fit)

CHOSEN_FITS = Literal["box", "circle"]
"""Those of scenes that do not bring their view along."""

SAMPLES = (1, 4, 8)
"""Per pixel."""

MOST_WORK = 65_000
"""Iterations a fragment: llvmpipe ends a loop, in silence, after 65,535 rounds."""

Order = Literal["native", "walk", "vertex-cache", "morton", "shuffled"]
"""In which triangles are submitted: caches and early tests depend on it; see `Options`."""

ORDERS: tuple[Order, ...] = get_args(Order)

MOST_SEED = 2**63 - 1

TIMEOUT_S = 600.0
QUICK_TIMEOUT_S = 60.0
"""Seconds after which a triangulator or a device is stopped, and with --quick."""

MOST_REPEATS = 1000
"""Processes that everything may be timed in; a thousand is hours of the smallest run."""

MOST_S = 1e6
"""Seconds that nothing of ours takes; more is a mistake."""


@dataclass(frozen=True)
class TimingSettings:
    """How carefully to time.

    precision : wanted half-width of a drawing's 95 % interval, relative to its middle: of the
        median, or of the time in ratio to the geometric mean of all that are compared
    budget_s : seconds of drawing a candidate may cost on average; what ends the rounds when
        `precision` is not reached
    min_batch_s : a batch of draws lasts at least this, or 100 resolutions of the timer
    warm_up_s : longest warm-up a candidate
    least_share : share of the budget that is always drawn: what is precise enough by itself gets
        pairs that tell smaller differences
    epochs : how often drawings are prepared, at least, where they can be prepared anew; 1: once
    paired : whether the candidates are compared with each other; then all are drawn equally often
        a batch, for a batch's own cost, shared among fewer draws, would look like a slower draw;
        up to `MAX_BATCHES` batches' length, beyond which that cost is too small to show
    processes : how many fresh processes do all of this, one after the other
    limit_s : seconds after which the rounds end, however few there are, shared by all processes;
        None: however many it takes
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
        """Return the settings of one of the processes; None where the limit leaves it no time.

        It gets an equal share of what is left after `spent_s`, and the first one always begins.
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

    polygons : how many are drawn from the scene
    random : random triangulations of each
    most_vertices : larger polygons are left out, because their optima take long
    all_below : a polygon with fewer triangulations than this has all of them measured instead of
        random ones, among them those with T-junctions that the paper's method makes
    """

    polygons: int = 24
    random: int = 30
    most_vertices: int = 400
    all_below: int = 100
