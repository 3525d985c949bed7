"""A profile: measurements of a device and the law derived from them, as one JSON file.

Its `coefficients` are the costs in seconds that `optimal:calibrated` minimises. All values follow
from the stored times of each epoch, so a reader can recompute them.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from harness import __version__, atomic, rasterisers
from harness.errors import InputError
from harness.machine.environment import describe_processor
from harness.profile import law as laws
from harness.profile import stage_draws
from harness.profile.advice import compare_aspects
from harness.profile.cost_terms import PX_TERMS, TERMS, fit_coefficients, make_design_rows
from harness.profile.design import DESIGN_VERSION
from harness.profile.law import COSTS, FORMS, Law, make_cost_rows
from harness.profile.measured import DrawTimes
from harness.profile.placing import Draw

FORMAT, VERSION = "raster-harness profile", 2

Content = TypeVar("Content")

MAX_COST_S = 1.0  # of a draw, a triangle or a pixel

MAX_NAME_LENGTH = 200

MAX_DRAWS = 1000  # the memory to refit a law grows as their square

# Lower bound of the explained variance of held-out draws, over all draws and within groups: optima
# for worse profiles would follow the noise. Quiet machines reach 0.91 to 0.98; softpipe has 0.86
# within groups.
MIN_R2 = 0.88


def make_profile(
    draws: Sequence[Draw],
    counted: Sequence[Mapping[str, int]],
    measured: DrawTimes,
    device: Mapping[str, Any],
    seed: int,
) -> dict[str, Any]:
    """Return a profile's content, JSON-ready; counted : `count_draw` of each draw."""
    design = make_design_rows(counted)
    fitted, without_work = select_draws_to_fit(draws)
    groups = [draw.group for draw in draws]
    of_fitted = [groups[n] for n in fitted]
    law = laws.fit_law(design[fitted], measured.epochs[:, fitted], of_fitted)
    # Draws bound by vertices are omitted: their times depend on the triangles' order, not shape.
    of_shape = [n for n in without_work if not law.is_bound_by_vertices[fitted.index(n)]]
    predicted = make_cost_rows([(draws[n].frame, draws[n].triangles) for n in of_shape])
    coefficients = fit_coefficients(
        predicted, measured.times[of_shape], [groups[n] for n in of_shape]
    )
    return {
        "format": FORMAT,
        "version": VERSION,
        "schema_version": 1,
        "harness": __version__,
        "design": DESIGN_VERSION,
        "seed": seed,
        "device": dict(device),
        "unit": "s",
        "terms": [
            {
                "name": name,
                "unit": f"s{'/px' * (name in PX_TERMS)}",
                "cost": cost,
                "low": low,
                "high": high,
                "shown": shown,
                "known": known,
            }
            for name, cost, (low, high), shown, known in zip(
                TERMS,
                *(values.tolist() for values in (law.costs, law.intervals)),
                *(values.tolist() for values in (law.significant, law.known)),
                strict=True,
            )
        ],
        "form": law.form,
        "stages": [
            {"name": name, "terms": list(terms), "draws": int((law.binding == stage).sum())}
            for stage, (name, terms) in enumerate(FORMS[law.form].items())
        ],
        "errors": dict(law.errors),
        "r2_over": law.r2_over,
        "r2_within": law.r2_within,
        "refused": not min(law.r2_over, law.r2_within) >= MIN_R2,
        "aspects": compare_aspects(draws, design, measured),
        "second_filling": _compute_second_filling(draws, measured),
        "coefficients": dict(zip(COSTS, coefficients.tolist(), strict=True)),
        "control": [measured.control.value, measured.control.low, measured.control.high],
        "drift": measured.drift,
        "rounds": measured.rounds,
        "empty": measured.empty,
        "times": [
            {
                **{name: getattr(draw, name) for name in ("kind", "name", "group")},
                "rounds_of_work": draw.work,
                "checksum": draw.checksum,
                "counters": dict(counts),
                "epochs": [float(f"{time:.5g}") for time in epochs],
            }
            for draw, counts, epochs in zip(draws, counted, measured.epochs.T, strict=True)
        ],
    }


def write_profile(content: Mapping[str, Any], file: Path) -> Path:
    """Write a profile to `file`, or to `<name>.refused.json` if it is refused; return the file."""
    if content["refused"]:
        file = file.with_name(f"{file.stem}.refused.json")
    file.parent.mkdir(parents=True, exist_ok=True)
    atomic.write(file, (json.dumps(content, indent=2) + "\n").encode())
    return file


def read_profile(file: Path, parse: Callable[[Any], Content]) -> Content:
    """Return `parse` of a profile's content; raise InputError if it is invalid or refused."""
    try:
        content = json.loads(atomic.read(file))
        if isinstance(content, dict) and content.get("refused"):
            raise InputError(
                f"{file}: refused, as its fit is too poor; repeat raster-harness profile"
            )
        check_profile(content)
        return parse(content)
    except FileNotFoundError:
        raise InputError(
            f"{file}: profile not found; create it with raster-harness profile"
        ) from None
    except ValueError as error:
        raise InputError(f"{file} is not a profile: {error}") from error
    except (OSError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(f"{file} is not a profile: {error!r}") from error


def check_profile(content: Any) -> None:
    """Raise ValueError, KeyError, TypeError or AttributeError for invalid content of a profile."""
    if not isinstance(content, dict):
        raise ValueError("the content is not a JSON object")
    for name, supported in (("unit", "s"), ("format", FORMAT), ("version", VERSION)):
        value = content.get(name)
        if value != supported or isinstance(value, bool):
            remedy = "; create the profile again: raster-harness profile" if value == 1 else ""
            raise ValueError(f"unsupported {name} {value!r} (supported: {supported!r}){remedy}")
    if content["form"] not in FORMS:
        raise ValueError(f"unknown form {content['form']!r:.40} (choose from {', '.join(FORMS)})")
    for name in ("name", "rasteriser", "cpu"):
        text = content["device"].get(name, "")
        if not isinstance(text, str) or not text.isprintable() or len(text) > MAX_NAME_LENGTH:
            raise ValueError(f"device.{name} is not a line of text")
    terms = {term["name"]: term["cost"] for term in content["terms"]}
    for kind, names, costs in (
        ("terms", TERMS, terms),
        ("coefficients", COSTS, content["coefficients"]),
    ):
        if {*costs} != {*names}:
            raise ValueError(f"the names of the {kind} differ from those of version {VERSION}")
        for name, cost in costs.items():
            is_number = isinstance(cost, int | float) and not isinstance(cost, bool)
            if not (is_number and 0 <= cost <= MAX_COST_S):
                raise ValueError(f"the cost of {name} is {cost!r:.40}, not 0 to {MAX_COST_S:g} s")
        if not any(cost for name, cost in costs.items() if name != "draw"):
            raise ValueError(f"all {kind} are 0")


def read_coefficients(file: Path) -> dict[str, float]:
    """Return a profile's coefficients of `optimal:calibrated`; raise as `read_profile` does."""
    return read_profile(file, lambda content: {n: float(content["coefficients"][n]) for n in COSTS})


def read_law(content: Mapping[str, Any]) -> Law | None:
    """Fit costs, in the profile's form, to the profile's stored times; None without times."""
    rows = [row for row in content.get("times") or () if row["kind"] != "twice"]
    if not rows:
        return None
    epochs = np.array([row["epochs"] for row in rows], np.float64).T
    if len(rows) > MAX_DRAWS or epochs.ndim != 2 or not ((epochs > 0) & (epochs < np.inf)).all():
        raise ValueError(f"times: must be positive numbers, of at most {MAX_DRAWS} draws")
    design = make_design_rows([row["counters"] for row in rows])
    return laws.fit_law(design, epochs, [str(row["group"]) for row in rows], content["form"])


def name_device_model(device: str, details: Mapping[str, Any]) -> str:
    """Return a GPU's model name, if known, in place of its number, such as gpu0."""
    model = str(details.get("renderer", "")).partition("/")[0]
    return (model if device.startswith("gpu") else "") or device


def describe_origin(device: Mapping[str, Any]) -> str:
    """Return the device on which a profile was measured; a software device with its processor."""
    on = f", on {device.get('cpu') or 'an unknown processor'}" if device.get("software") else ""
    return f"{name_device_model(device['name'], device.get('details', {}))}{on}"


def is_of_this_machine(device: Mapping[str, Any]) -> bool:
    """Return whether this machine has the GPU, or the processor of the software renderer."""
    if device.get("software"):
        return bool(device.get("cpu") == describe_processor()["label"])
    name, details = device.get("rasteriser"), device.get("details", {})
    present = rasterisers.get(name).devices() if name in rasterisers.BUILT_IN else ()
    models = {one.details.get(key) for one in present for key in ("renderer", "device")} - {None}
    return details.get("renderer", details.get("device")) in models


def select_draws_to_fit(draws: Sequence[Draw]) -> tuple[list[int], list[int]]:
    """Return indices of the draws to which `TERMS` are fitted, and of those for `coefficients`.

    The costs omit draws that a device may skip because later draws cover them. `coefficients` also
    omit draws with arithmetic per fragment, and draws that differ in what no criterion predicts:
    the order of triangles, and the triangles' positions relative to samples and tiles.
    """
    fitted = [n for n, draw in enumerate(draws) if draw.kind != "twice"]
    plain = [
        n for n in fitted if draws[n].work == 0 and draws[n].kind not in stage_draws.STAGE_KINDS
    ]
    return fitted, plain


def _compute_second_filling(draws: Sequence[Draw], measured: DrawTimes) -> dict[str, float]:
    """Return, by triangle size, the time of drawing triangles again, relative to the first time."""
    net = dict(zip((d.name for d in draws), measured.times - measured.empty, strict=True))
    pairs = [d.name for d in draws if d.kind == "twice"]
    return {
        single.partition(",")[0]: float(net[double] / net[single] - 1.0)
        for single, double in zip(pairs[::2], pairs[1::2], strict=True)
    }
