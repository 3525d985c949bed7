"""Program that triangulates with another version of the code; `other_version.py` runs it.

The program imports only public interfaces, not the harness, which may be missing or different in
that version. The question file comes from a process of the same user.
"""

import importlib
import pickle
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def main(question_file: str, answer_file: str) -> None:
    """Read a pickled question; write the pickled answer of `_make_answer`, or {"error": ...}."""
    question = pickle.loads(Path(question_file).read_bytes())
    try:
        answer = _make_answer(question)
    except (Exception, SystemExit) as error:  # reported by the process that reads the answer
        answer = {"error": f"{type(error).__name__}: {error}"}
    Path(answer_file).write_bytes(pickle.dumps(answer))


def _make_answer(question: dict[str, Any]) -> dict[str, Any]:
    """Run a triangulator over polygons; return "results", CPU "seconds" and the module's "file".

    question : "triangulator", its "parameters", and "polygons" and "warm_up", lists of WKB; if the
        triangulator is None, the answer is only the "file" of the package `triangulators`

    A result is ("triangles", array), ("skipped", reason) or ("failed", reason).
    """
    name = question["triangulator"]
    if name is None:
        return {"file": _find_module_file("triangulators")}
    function, file = _load_function(name, question["parameters"])
    import shapely

    for polygon in shapely.from_wkb(question["warm_up"]):
        try:
            function(polygon)
        except (Exception, SystemExit):  # an error that recurs is reported below
            continue
    results, seconds = [], 0.0
    for polygon in shapely.from_wkb(question["polygons"]):
        start = time.process_time()
        try:
            results.append(("triangles", function(polygon)))
        except (Exception, SystemExit) as error:
            skipped = type(error).__name__ in ("SkippedError", "Skipped")  # name in older versions
            message = str(error) if skipped else f"{type(error).__name__}: {error}"
            results.append(("skipped" if skipped else "failed", message))
        seconds += time.process_time() - start
    return {"file": file, "results": results, "seconds": seconds}


def _load_function(
    name: str, parameters: dict[str, Any]
) -> tuple[Callable[[Any], Any], str | None]:
    module, colon, attribute = name.partition(":")
    try:
        import triangulators
    except ImportError:  # the environment has only the user's code
        return getattr(importlib.import_module(module), attribute), _find_module_file(module)
    builtin = module in triangulators.names()
    file = _find_module_file("triangulators" if builtin or not colon else module)
    terms = parameters.pop("calibration", None)
    if terms is not None:
        name = module  # the criterion is passed separately
        parameters["criterion"] = triangulators.criteria.calibrated(dict(terms))
    return lambda polygon: triangulators.triangulate(polygon, name, **parameters), file


def _find_module_file(module: str) -> str | None:
    """Import a module; return its file, or None if it is missing or has no file."""
    try:
        return getattr(importlib.import_module(module), "__file__", None)
    except ImportError:
        return None


if __name__ == "__main__":
    main(*sys.argv[1:])
