"""A device's law: the cost in seconds of each of `cost_terms.TERMS`, with intervals.

A draw takes the sum of its costs, as on one processor, or the time of its slowest stage (`FORMS`),
as on a GPU, whose stages work at the same time on different triangles. The form is chosen by the
errors of predicted groups of draws that the fit did not see: a form with more stages replaces a
simpler one if its mean error is smaller by more than `STANDARD_ERRORS` of the difference (L.
Breiman, J. Friedman, R. Olshen and C. Stone, "Classification and Regression Trees", 1984, section
3.4).

In a maximum, a draw depends only on the costs of the stage that takes longest, its binding stage.
Given the binding stages, the law is linear: the counters of all other stages are set to 0. Costs
and binding stages are computed alternately, from several starts (A. Magnani and S. Boyd, "Convex
piecewise-linear fitting", Optimization and Engineering 10, 2009). The costs of a stage that binds
in no draw are unknown, as are those of terms whose counters are linearly dependent in the draws
that their stage binds: their intervals end at the bounds that the times of all draws imply.

Measured times deviate from the law by 9 to 27 %, with noise of 1 %, and an eighth to a half of that
deviation is common to the draws of a group. So a draw's error is the sum of an individual error and
an error that its group shares. Both variances are estimated from the residuals within groups and
from the groups' mean residuals, corrected for the part of each that the fit absorbs (the moment
estimator of a model with a random effect for each group), and give the coefficients' covariance,
for given binding stages. As groups are few, intervals are Student's, with half as many degrees of
freedom as there are groups, and wider by `DEVIATION_FACTOR`. For the intervals, coefficients may be
negative: a constraint at 0 would bias the other terms downwards.

A cost is significant if it is so among all terms, by Bonferroni's correction: at most one device in
twenty may get a false cost. Insignificant terms stay in the law: without them, the errors of
predicted draw times of scenes, relative to ear clipping's times, rose from 0.6-1.4 % to 2-7 %.

Sources: S. Searle, G. Casella and C. McCulloch, "Variance Components", 1992, chapter 5; J. Imbens
and M. Kolesar, "Robust standard errors in small samples", Review of Economics and Statistics 98(4),
2016. Coverage of the intervals: `scripts/studies/laws.py`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.grid import SUBPIXEL
from harness.profile.cost_terms import (
    TERMS,
    Design,
    Seconds,
    compute_group_means,
    compute_loss,
    compute_r_squared,
    compute_r_squared_within,
    fit_coefficients,
    fit_iteratively,
    stack_deviations,
)
from triangulators.criteria import predict
from triangulators.criteria.criterion import CALIBRATED_FEATURES

CONFIDENCE = 0.95
# Confidence of a single cost's interval, at which 5 % of devices have a false cost.
FAMILY_CONFIDENCE = 1.0 - (1.0 - CONFIDENCE) / len(TERMS)

# Factor of all intervals, as deviations of real devices follow the counters within a group. If the
# residuals of each group of a published profile get a random sign, at least 93 % of costs are
# covered on all seven profiles, and no device in thirty has a false cost; with a factor of 1 the
# H200's coverage is 0.77, with 1.5 it is 0.92. Rejected: jackknives by groups or by kinds, and the
# median ratio to a jackknife (coverage 0.81 to 1.00 at 1.2 to 2.3 times the width), the larger of
# the two variances (0.90 to 1.00 at the same width), and their sum (0.95 to 1.00 at 2.1 to 2.4).
DEVIATION_FACTOR = 1.7

VERTICES = ("transformed_vertices", "vertex_batches")
TRIANGLES = ("triangles", "covering", "tile_pairs")
PIXELS = ("fragments", "helper_lanes", "blocks")
ARITHMETIC = ("work",)

# The stages of each form with their terms, the simplest form first. The draw itself is added to
# each; other terms cost nothing in a maximum.
FORMS: dict[str, dict[str, tuple[str, ...]]] = {
    "sum": {"all": tuple(TERMS)[1:]},
    "maximum of two stages": {
        "vertices": VERTICES,
        "triangles and pixels": TRIANGLES + PIXELS + ARITHMETIC,
    },
    "maximum of three stages": {
        "vertices": VERTICES,
        "triangles": TRIANGLES,
        "pixels": PIXELS + ARITHMETIC,
    },
    "maximum of four stages": {
        "vertices": VERTICES,
        "triangles": TRIANGLES,
        "pixels": PIXELS,
        "arithmetic": ARITHMETIC,
    },
}

# Group of draws that every fit uses: only these show the cost of the draw itself.
ALWAYS_FITTED = "few"

START_FACTORS = (1.0, 0.5, 2.0)  # factors of each stage's time, for the initial binding stages

# Standard errors by which a form must predict better than a simpler one; 1 for other forms. Only
# four groups of draws have arithmetic, so that chance has more influence: with 1, 15 % of simulated
# devices with three stages got a fourth, with 1.5 it is 3 %.
STANDARD_ERRORS = {"maximum of four stages": 1.5}

MAX_REASSIGNMENTS = 40

MIN_SINGULAR_VALUE = 1e-6  # relative; below it, columns count as linearly dependent
MIN_TIME_SHARE = 0.002  # terms that take a smaller share of every draw's time count as free

Groups = NDArray[np.int64]
Stages = NDArray[np.int64]  # index of a stage for each draw, (k,)


@dataclass(frozen=True)
class Law:
    """The fitted costs of a device.

    form : one of `FORMS`
    costs : (t,) of each of `TERMS`, in the times' unit; 0 for terms that the device does not have
    signed_costs : (t,) fitted with negative costs permitted; covariance : (t, t) of these
    known : (t,) whether the draws determine each cost
    bounds : (t,) upper bounds of the costs: no cost takes longer than a draw
    groups : number of groups of draws
    binding : the binding stage of each draw
    shares : (k, t) share of each draw's time that a cost of 1 would take, if its stage binds
    errors : mean absolute error of the log times of held-out draws, by form
    r2_over, r2_within : R2 of the log times of held-out draws, over all draws and within groups
    """

    form: str
    costs: Seconds
    signed_costs: Seconds
    covariance: Seconds
    known: NDArray[np.bool_]
    bounds: Seconds
    groups: int
    binding: Stages
    shares: Seconds
    errors: Mapping[str, float]
    r2_over: float
    r2_within: float

    @property
    def is_bound_by_vertices(self) -> NDArray[np.bool_]:
        """Flags (k,) of the draws whose binding stage is vertices; all False if `form` is a sum."""
        return np.array([terms == VERTICES for terms in FORMS[self.form].values()])[self.binding]

    @property
    def intervals(self) -> Seconds:
        """Ends of the 95 % interval of each cost, (t, 2): not negative, and around the cost."""
        return self._compute_intervals(CONFIDENCE)

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Flags (t,) of costs that significantly exceed `MIN_TIME_SHARE` of some draw's time."""
        low = self._compute_intervals(FAMILY_CONFIDENCE)[:, 0]
        return np.asarray(low * self.shares.max(axis=0) > MIN_TIME_SHARE)

    def _compute_intervals(self, confidence: float) -> Seconds:
        width = compute_interval_reach(self.groups, confidence) * np.sqrt(np.diag(self.covariance))
        low = np.clip(self.signed_costs - width, 0.0, self.costs) * self.known
        high = np.maximum(self.costs, self.signed_costs + width)
        return np.stack([low, np.where(self.known, high, self.bounds)], axis=1)

    def compute_saved_interval(
        self, spent: Seconds, base: Seconds, costs: Seconds
    ) -> tuple[float, float]:
        """Return the 95 % interval of the share of a draw's time that another draw saves.

        spent, base : (t,) counts of the draw that saves and of the other; costs : (t,) of the share

        Delta method with the covariance of the signed costs, each draw in its binding stage.
        """
        rows = np.stack([spent, base])
        binding = compute_stage_times(rows, costs, self.form).argmax(axis=1)
        spent, base = rows * make_stage_masks(self.form)[binding]
        base_s = float(base @ costs)
        ratio = float(spent @ costs) / base_s
        weights = (ratio * base - spent) / base_s  # the derivative of the share by each cost
        deviation = float(np.sqrt(weights @ self.covariance @ weights))
        error = compute_interval_reach(self.groups, CONFIDENCE) * deviation
        moved = float(weights @ self.signed_costs)
        return 1 - ratio + min(0.0, moved - error), 1 - ratio + max(0.0, moved + error)


def compute_interval_reach(groups: int, confidence: float) -> float:
    """Return the half-width of a cost's interval in standard errors, for a number of groups."""
    from scipy.special import stdtrit  # slow to import, not needed to read a profile

    return DEVIATION_FACTOR * float(stdtrit(groups / 2, 0.5 + confidence / 2))


def make_stage_masks(form: str) -> Design:
    """Return masks (s, t) of a form's stages: 1 for each of `TERMS` that the stage has, else 0."""
    stages = FORMS[form].values()
    counts = [[name == "draw" or name in terms for name in TERMS] for terms in stages]
    return np.array(counts, np.float64)


def compute_stage_times(rows: Design, costs: Seconds, form: str) -> Design:
    """Return the time of each stage for each draw, (k, s); rows : (k, t) counts of the draws."""
    return np.asarray(rows @ (make_stage_masks(form) * costs).T)


def predict_times(rows: Design, costs: Seconds, form: str) -> Seconds:
    """Return the time of each draw's slowest stage, (k,); rows : (k, t) counts of the draws."""
    return np.asarray(np.maximum(compute_stage_times(rows, costs, form).max(axis=1), 1e-12))


def fit_law(design: Design, epochs: Seconds, groups: Sequence[str], form: str | None = None) -> Law:
    """Fit the costs of `TERMS`: design, (k, t) their counters in k draws; epochs, (e, k) seconds.

    groups : (k,) name of the group of draws that differ only in what their kind isolates
    form : one of `FORMS`; if None, the one that predicts held-out groups best
    """
    seconds = np.exp(np.log(epochs).mean(axis=0))
    labels = np.unique(np.asarray(groups), return_inverse=True)[1]
    folds = assign_folds(groups)
    candidates = FORMS if form is None else (form,)
    fits = {name: fit_form(design, seconds, labels, name) for name in candidates}
    predicted = {
        name: predict_held_out(design, seconds, labels, folds, name, binding)
        for name, (_, binding) in fits.items()
    }
    held = folds >= 0
    errors = {
        name: compute_group_means(np.abs(np.log(times / seconds))[held], folds[held])
        for name, times in predicted.items()
    }
    form = choose_form(errors)
    costs, binding = fits[form]
    members = make_stage_masks(form)
    masked = design * members[binding]
    signed_costs, covariance, known = _estimate_covariance(masked, seconds, labels)
    bounds = 1.0 / np.maximum((design / seconds[:, None]).max(axis=0), 1e-12)
    return Law(
        form=form,
        costs=costs,
        signed_costs=signed_costs,
        covariance=covariance,
        known=known | ~members.any(axis=0),
        bounds=bounds,
        groups=int(labels.max()) + 1,
        binding=binding,
        shares=masked / seconds[:, None],
        errors={name: float(values.mean()) for name, values in errors.items()},
        r2_over=compute_r_squared(np.log(seconds), np.log(predicted[form])),
        r2_within=compute_r_squared_within(seconds, predicted[form], labels.tolist()),
    )


def fit_form(
    design: Design, seconds: Seconds, labels: Groups, form: str, start: Stages | None = None
) -> tuple[Seconds, Stages]:
    """Fit costs with a given form: return the costs, (t,), and each draw's binding stage, (k,).

    start : binding stages to begin with; those of `yield_initial_stages` in turn if None
    """
    members = make_stage_masks(form)
    best: tuple[float, Seconds, Stages] | None = None
    tried = set()
    for begin in yield_initial_stages(design, seconds, members) if start is None else (start,):
        binding = begin
        for _ in range(MAX_REASSIGNMENTS):
            if binding.tobytes() in tried:
                break
            tried.add(binding.tobytes())
            costs = fit_coefficients(design * members[binding], seconds, labels)
            loss = compute_loss(seconds, predict_times(design, costs, form), labels)
            reassigned = compute_stage_times(design, costs, form).argmax(axis=1)
            if best is None or loss < best[0]:
                best = loss, costs, reassigned
            binding = reassigned
    assert best is not None
    return best[1:]


def yield_initial_stages(design: Design, seconds: Seconds, members: Design) -> Iterator[Stages]:
    """Yield binding stages to begin a fit with.

    The draw with the least time per count of a term bounds the cost of that term. Each draw is
    assigned to the stage whose time by these bounds is longest; for further starts, one stage's
    time is multiplied by each of `START_FACTORS`.
    """
    shares = design / seconds[:, None]
    bounded = shares / np.maximum(shares.max(axis=0), 1e-300)
    nearness = bounded[:, 1:] @ members[:, 1:].T
    for stage in range(len(members)):
        for factor in START_FACTORS:
            scaled = nearness.copy()
            scaled[:, stage] *= factor
            yield scaled.argmax(axis=1)


def assign_folds(groups: Sequence[str]) -> Groups:
    """Return which fit leaves out each draw's group, (k,); -1 for `ALWAYS_FITTED`."""
    names = [name for name in sorted(set(groups)) if name != ALWAYS_FITTED]
    return np.array([names.index(name) if name in names else -1 for name in groups])


def predict_held_out(
    design: Design, seconds: Seconds, labels: Groups, folds: Groups, form: str, binding: Stages
) -> Seconds:
    """Return (k,) seconds, each predicted by a fit that leaves out the draw's group.

    folds : from `assign_folds`; binding : stages of a fit to all draws, with which the fits begin
    """
    predicted = np.empty(len(seconds))
    for fold in range(-1, folds.max() + 1):
        out = folds == fold
        fitted = ~out if fold >= 0 else np.ones(len(folds), np.bool_)
        renumbered = np.unique(labels[fitted], return_inverse=True)[1]
        costs, _ = fit_form(design[fitted], seconds[fitted], renumbered, form, binding[fitted])
        predicted[out] = predict_times(design[out], costs, form)
    return predicted


def choose_form(errors: Mapping[str, Seconds]) -> str:
    """Return the simplest form, or one with more stages that predicts significantly better.

    errors : form -> mean error of each left-out group of draws, (f,), the simplest form first
    """
    form, *further_forms = errors
    for name in further_forms:
        smaller = errors[form] - errors[name]
        error = float(smaller.std(ddof=1)) / np.sqrt(len(smaller))
        if smaller.mean() > STANDARD_ERRORS.get(name, 1.0) * error:
            form = name
    return form


def _estimate_covariance(
    design: Design, seconds: Seconds, labels: Groups
) -> tuple[Seconds, Seconds, NDArray[np.bool_]]:
    """Return signed coefficients (t,), their covariance, and whether each is determined (t,).

    Columns of determined coefficients are not linear combinations of others. The last iteration of
    the fit is linear in the errors: they move coefficients by `response` @ errors.
    """
    solve = partial(np.linalg.lstsq, rcond=MIN_SINGULAR_VALUE)
    signed, fitted, columns, scale, trust = fit_iteratively(design, seconds, labels, solve)
    shares = design / fitted[:, None]
    unit = trust[:, None] * stack_deviations(np.eye(len(seconds)), labels)
    inverse = np.linalg.pinv(columns, rcond=MIN_SINGULAR_VALUE)
    response = inverse @ unit / scale[:, None]
    errors = seconds / fitted - shares @ signed
    residual = np.eye(len(seconds)) - shares @ response  # the part of an error in the residuals
    same_group = (labels[:, None] == labels).astype(np.float64)
    mean = same_group / same_group.sum(axis=1)
    within = np.eye(len(seconds)) - mean
    # Squares within groups and of group means: observed, and expected for a variance of 1.
    observed = np.array([errors @ within @ errors, errors @ mean @ errors])
    sources = [residual @ residual.T, residual @ same_group @ residual.T]
    expected = np.array([[(part * source).sum() for source in sources] for part in (within, mean)])
    single, shared = np.linalg.solve(expected, observed)
    if min(single, shared) < 0:
        single, shared = observed.sum() / expected[:, 0].sum(), 0.0
    covariance = single * response @ response.T + shared * response @ same_group @ response.T
    return signed, covariance, (inverse * columns.T).sum(axis=1) > 1.0 - 1e-6


# Terms that `optimal:calibrated` weights, sums from coordinates alone: the draw itself, which no
# choice changes, then the number of triangles T, their area S, their half-perimeters H, the areas
# of their bounding boxes, the deviation D of their angles from 60 degrees, the expected quads Q and
# 4x4 blocks P, and R, the expected number of triangles whose bounding box holds a pixel centre.
COSTS = ("draw", *CALIBRATED_FEATURES)


def make_cost_rows(draws: Sequence[tuple[Frame, NDArray[np.int32]]]) -> Design:
    """Return the `COSTS` of each draw, (k, 9): a 1 for the draw, and 8 sums over its triangles."""
    predicted = (predict(frame.points / SUBPIXEL, triangles) for frame, triangles in draws)
    return np.array([[1.0, *(sums[name] for name in COSTS[1:])] for sums in predicted])
