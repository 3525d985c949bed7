"""Triangulates the polygons of a frame, checks every result and says what went wrong where.

Triangulations of a model's flat faces are carried to the pieces of its views.
"""

import math
import traceback
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, box

from harness.errors import UsageError
from harness.frame import Frame
from harness.machine.system import cpu_clock
from harness.triangulating.database import Lookup
from harness.triangulating.recipes import ORIGINAL, Recipe
from scenes.scene import Viewing
from triangulators.criteria import predict
from triangulators.errors import MOST_TRACED, Skipped, shortened, told_of
from triangulators.polygon import vertices
from triangulators.ragged import doubtful, ragged
from triangulators.verify import verify

Rows = NDArray[np.int32]
Columns = dict[str, NDArray[np.float64]]


@dataclass
class FrameTriangulation:
    """What one triangulator made of the polygons of a frame.

    parts : for each polygon its (m, 3) int32 triangles, or None where it gave none
    seconds : CPU time of the triangulator alone, without checks and without compiling
    samples_s : the same in each of several rounds, in which others were timed, too; [] if it was
        timed once
    skipped, failed : (polygon number in the frame, reason)
    t_junctions : for each polygon, how many vertices lie inside an edge of a triangle
    cached : polygons whose triangles were read from the model database; `seconds` has for them
        what computing them took when they were
    gaps : of an optimum, for each polygon that it gave triangles, how far these may be from the
        least cost, relative to it: 0 where they are proven optimal, infinite where nothing is known
    predicted : (p,) every criterion's sum over each polygon's triangles; lengths in px, areas px^2
    notes : what the user should know of the model database
    trace : the traceback of the first error of a triangulator's code, "" where there was none
    """

    parts: list[Rows | None] = field(default_factory=list)
    seconds: float = 0.0
    samples_s: list[float] = field(default_factory=list)
    skipped: list[tuple[int, str]] = field(default_factory=list)
    failed: list[tuple[int, str]] = field(default_factory=list)
    t_junctions: list[int] = field(default_factory=list)
    cached: int = 0
    gaps: list[float] = field(default_factory=list)
    predicted: Columns = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    trace: str = ""

    @property
    def conforming(self) -> bool:
        """True where no polygon's triangulation has a T-junction."""
        return not any(self.t_junctions)

    @property
    def drawn(self) -> NDArray[np.bool_]:
        """(p,) which polygons have triangles."""
        return np.array([part is not None for part in self.parts], np.bool_)

    def add(self, part: Rows | None, junctions: int = 0, problem: str = "") -> None:
        """Add the triangles of the next polygon with their T-junctions, or what is wrong."""
        if problem:
            self.failed.append((len(self.parts), problem))
        self.parts.append(None if problem else part)
        self.t_junctions.append(junctions)


def carry_over(before: FrameTriangulation, upright: Frame, turned: Frame) -> FrameTriangulation:
    """Return the triangulation of `upright`'s polygons for the same polygons in `turned`.

    Polygons whose vertices snapping merged in one frame only are failed, with the reason. A thin
    triangle that snapping turned over is drawn as it is, and counts as not conforming.
    """
    numbers = {number: k for k, number in enumerate(upright.source.tolist())}
    result = FrameTriangulation(seconds=before.seconds, cached=before.cached, notes=before.notes)
    for polygon, source in zip(turned.polygons, turned.source.tolist(), strict=True):
        origin = numbers.get(source, -1)
        part = before.parts[origin] if origin >= 0 else None
        junctions, problem = 0, ""
        if part is None:
            problem = "not triangulated before turning"
        elif len(vertices(polygon)) != len(vertices(upright.polygons[origin])):
            problem = "snapping changed its vertices as it was turned"
        elif not (checked := verify(polygon, part)).conforming:
            # A program would draw it all the same; the coverage error says what that costs.
            junctions = max(1, len(checked.t_junctions))
        result.add(part, junctions, problem)
    result.predicted = predict_polygons(turned.polygons, result.parts)
    return result


def predict_polygons(polygons: Sequence[Polygon], parts: Sequence[Rows | None]) -> Columns:
    """Sum every criterion over each polygon's (m, 3) triangles; 0 where there are none."""
    if not polygons:
        return {}
    empty = np.empty((0, 3), np.int32)
    arrays = ragged(polygons)
    ends = arrays.ring_ends[arrays.polygon_ends - 1]
    rows = [
        predict(points, empty if part is None else part)
        for points, part in zip(np.split(arrays.coordinates, ends[:-1]), parts, strict=True)
    ]
    return {name: np.array([row[name] for row in rows], np.float64) for name in rows[0]}


def triangulate_polygons(
    recipe: Recipe, polygons: Sequence[Polygon], database: Path | None = None
) -> FrameTriangulation:
    """Run a triangulator over polygons in px; never raises for a polygon's sake.

    database : model database to read from and write to; only for triangulators of our own, whose
        version it knows
    """
    result = FrameTriangulation()
    if not recipe.builtin:
        database = None
    parameters = {} if database is None else recipe.parameters
    with Lookup(database, recipe.base, parameters) as kept:
        known = kept.find(polygons)
        if None in known:
            warm_up(recipe)
        unknown = [number for number, timed in enumerate(known) if timed is None]
        batch = _batch(recipe, [polygons[number] for number in unknown], result)
        given = {number: timed.triangles for number, timed in enumerate(known) if timed is not None}
        given |= {unknown[place]: part for place, part in batch.items()}
        doubted = doubtful(ragged(polygons), given)
        checked = {number: check(polygons[number], given[number]) for number in doubted}
        for number, (polygon, timed) in enumerate(zip(polygons, known, strict=True)):
            gap = recipe.gap_of_kept(polygon)
            junctions, problem = checked.get(number, (0, ""))
            if number in given and not problem:
                result.seconds += 0.0 if timed is None else timed.seconds
                result.cached += timed is not None
                result.add(given[number], junctions)
            else:
                seconds, found = _compute(recipe, polygon, result)
                part = result.parts[-1]
                # Kept means proven, where that can be: what a search found is computed again.
                if part is not None and found == gap:
                    kept.keep(number, part, seconds)
                gap = found
            if result.parts[-1] is not None and gap is not None:
                result.gaps.append(gap)
    result.notes = kept.notes
    result.predicted = predict_polygons(polygons, result.parts)
    return result


def time_in_rounds(
    recipes: Sequence[Recipe], polygons: Sequence[Polygon], rounds: int, seed: int
) -> list[list[float]]:
    """Return for each triangulator the seconds that all polygons take it, once a round.

    Each round takes the triangulators in another order, as drawings are timed: what the machine
    does meanwhile, it does to all of them.
    """
    order = np.random.default_rng(seed)
    found: list[list[float]] = [[] for _ in recipes]
    warm_up(*recipes)
    for _ in range(rounds):
        for place in order.permutation(len(recipes)).tolist():
            result = FrameTriangulation()
            at_once = _batch(recipes[place], polygons, result)
            for number, polygon in enumerate(polygons):
                if number not in at_once:
                    start = cpu_clock()
                    with suppress(Exception, SystemExit, GeneratorExit):  # it was told before
                        recipes[place].triangulate_with_gap(polygon)
                    result.seconds += cpu_clock() - start
            found[place].append(result.seconds)
    return found


def _batch(
    recipe: Recipe, polygons: Sequence[Polygon], result: FrameTriangulation
) -> dict[int, Rows]:
    """Return the triangles of the polygons that compiled code does all at once, and tell its time.

    So `seconds` is the algorithm's own, where it is quicker than what is around a single call.
    """
    if not polygons:
        return {}
    arrays = ragged(polygons)
    start = cpu_clock()
    try:
        found, done = recipe.attempt(arrays)
    except Exception:  # one by one, each can say what is wrong
        return {}
    if done.any():
        result.seconds += cpu_clock() - start
    return {place: found[place] for place in np.flatnonzero(done).tolist()}


def _compute(
    recipe: Recipe, polygon: Polygon, result: FrameTriangulation
) -> tuple[float, float | None]:
    """Run the triangulator over the next polygon of `result`; returns seconds and gap."""
    part, gap, junctions, problem = None, None, 0, ""
    start = cpu_clock()
    try:
        part, gap = recipe.triangulate_with_gap(polygon)
    except Skipped as reason:
        result.skipped.append((len(result.parts), shortened(str(reason))))
    except (Exception, SystemExit, GeneratorExit) as error:  # all but Ctrl-C
        problem = told_of(error)
        result.trace = result.trace or "".join(traceback.format_exception(error))[:MOST_TRACED]
    seconds = cpu_clock() - start
    if part is not None:
        junctions, problem = check(polygon, part)
    result.add(part, junctions, problem)
    result.seconds += seconds
    return seconds, gap


def warm_up(*recipes: Recipe) -> None:
    """Load compiled code, which would otherwise count as the first polygon's time; done once.

    The first time on a machine that is the time to compile it, which can take minutes.
    """
    for recipe in recipes:
        if recipe.base in _warm:
            continue
        _batch(recipe, list(small_polygons()), FrameTriangulation())
        for polygon in small_polygons():
            # the real polygons will tell
            with suppress(Exception, SystemExit, GeneratorExit):
                check(polygon, recipe.triangulate(polygon))
        _warm.add(recipe.base)


_warm: set[str] = set()
"""What this process has loaded."""


def small_polygons() -> Iterator[Polygon]:
    """Yield polygons of every kind that a triangulator may treat in a way of its own."""
    square = box(0, 0, 8, 8).exterior
    holes = [box(x, 3, x + 2, 5).exterior for x in (1, 5)]
    yield Polygon(square)
    yield Polygon(square, holes[:1])
    yield Polygon(square, holes)
    # Many vertices, few of which see each other: large polygons take other paths than small ones.
    turn = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    reach = np.where(np.arange(200) % 2, 50.0, 400.0)
    yield Polygon(np.column_stack([reach * np.cos(turn), reach * np.sin(turn)]))


def check(polygon: Polygon, part: Rows) -> tuple[int, str]:
    """Return T-junctions, and what is wrong with triangles that are no triangulation."""
    result = verify(polygon, part)
    return (len(result.t_junctions), "") if result.ok else (0, "; ".join(result.problems[:3]))


TURNING = ("optimal", "flips")
"""Triangulators that turn diagonals where a face is no polygon, too, as `triangulate` does."""


def in_views(frame: Frame, flat: FrameTriangulation, recipe: Recipe) -> FrameTriangulation:
    """Return the triangulation of a frame's pieces that follows from that of its flat faces.

    A face is triangulated once, in its plane, and drawn so in each view. What no face has, the rest
    of a view, keeps its triangles. By a recipe of `TURNING` a face gets what `triangulate` gives
    it, also one that is no polygon. Seconds are those of the polygons, once.
    """
    viewing = frame.viewing
    assert viewing is not None
    sources = viewing.source.tolist()
    turned = _turned(frame, viewing, flat.parts, recipe)

    def triangles(piece: int, source: int) -> Rows | None:
        if source in turned:
            return turned[source]
        return viewing.rest[piece] if piece in viewing.rest else flat.parts[source]

    parts = [triangles(piece, source) for piece, source in enumerate(sources)]
    skipped, failed = dict(flat.skipped), dict(flat.failed)
    gaps: dict[int, float] = {}
    if flat.gaps:
        done = (face for face, part in enumerate(flat.parts) if part is not None)
        gaps = dict(zip(done, flat.gaps, strict=True))
        gaps |= {source: math.inf for source in turned if source > len(viewing.given)}
    return replace(
        flat,
        parts=parts,
        skipped=[(k, skipped[source]) for k, source in enumerate(sources) if source in skipped],
        failed=[(k, failed[source]) for k, source in enumerate(sources) if source in failed],
        t_junctions=[
            0 if piece in viewing.rest else flat.t_junctions[source]
            for piece, source in enumerate(sources)
        ],
        gaps=[
            gaps.get(source, 0.0)
            for source, part in zip(sources, parts, strict=True)
            if gaps and part is not None
        ],
        predicted=predict_polygons(frame.polygons, parts),
    )


def _turned(
    frame: Frame, viewing: Viewing, parts: Sequence[Rows | None], recipe: Recipe
) -> dict[int, Rows]:
    """Return by source what `triangulate` leaves or gives otherwise than a polygon's triangulator.

    It leaves a face as it is where that costs no more, and turns diagonals where it is no polygon.
    parts : triangles (m, 3) of each polygon
    """
    method, _, criterion = recipe.base.partition(":")
    if method not in TURNING or recipe.calibration is not None or frame.flat is None:
        return {}
    from harness.models.diagonals import choose, cost_named, gains  # compiled code
    from harness.models.flat_faces import Faces

    try:
        cost = cost_named(criterion)
    except UsageError:  # its weights depend on the polygon
        return {}
    given, starts = viewing.given, frame.flat.offsets
    own = [k for k, part in enumerate(parts) if part is not None and len(part) == len(given[k])]
    before, begins = _moved([given[k] for k in own], starts[own])
    after, _ = _moved([parts[k] for k in own], starts[own])
    cheaper = gains(frame.flat.points.astype(np.float64), before, after, begins, cost)
    turned = {k: given[k] for k, less in zip(own, cheaper.tolist(), strict=True) if not less}
    if viewing.bound:
        points = [each for each, _ in viewing.bound]
        firsts = np.cumsum([0, *map(len, points)], dtype=np.int64)
        triangles, begins = _moved([rows for _, rows in viewing.bound], firsts)
        count = np.arange(firsts[-1])
        faces = Faces(np.concatenate(points), count, triangles, np.arange(begins[-1]), begins)
        chosen = np.split(choose(faces, criterion).triangles, begins[1:-1])
        for face, (rows, first) in enumerate(zip(chosen, firsts, strict=False), len(given) + 1):
            turned[face] = (rows - first).astype(np.int32)
    return turned


def _moved(
    parts: Sequence[Rows | None], firsts: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return triangles of faces whose vertices begin at `firsts`, and where each one's begin."""
    begins = np.cumsum([0, *(len(rows) for rows in parts if rows is not None)], dtype=np.int64)
    moved = [rows + first for rows, first in zip(parts, firsts, strict=False)]
    none = np.empty((0, 3), np.int64)
    return np.concatenate([none, *moved]).astype(np.int64), begins


def original(frame: Frame) -> FrameTriangulation:
    """Return the triangulation that a model came with, in all its views."""
    assert frame.viewing is not None
    given: list[Rows | None] = list(frame.viewing.given)
    flat = FrameTriangulation(parts=given, t_junctions=[0] * len(given))
    return in_views(frame, flat, Recipe(ORIGINAL))
