"""Asks another version of the code to triangulate; `harness.measuring.other_version` runs it.

It imports nothing of the harness, which may be of another version there, or none: only what that
version's packages promise. The question is from a process of the same user, by a file of its own.
"""

import importlib
import pickle
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def main(asked: str, answered: str) -> None:
    """Answer the question in the file `asked`, in the file `answered`."""
    question = pickle.loads(Path(asked).read_bytes())
    try:
        answer = _answer(question)
    except (Exception, SystemExit) as error:  # told to the one who asked
        answer = {"error": f"{type(error).__name__}: {error}"}
    Path(answered).write_bytes(pickle.dumps(answer))


def _answer(question: dict[str, Any]) -> dict[str, Any]:
    name = question["triangulator"]
    if name is None:
        return {"file": _file_of("triangulators")}
    function, file = _function(name, question["parameters"])
    import shapely

    for polygon in shapely.from_wkb(question["warm_up"]):
        try:
            function(polygon)
        except (Exception, SystemExit):  # the real polygons will tell
            continue
    results, seconds = [], 0.0
    for polygon in shapely.from_wkb(question["polygons"]):
        start = time.process_time()
        try:
            results.append(("triangles", function(polygon)))
        except (Exception, SystemExit) as error:
            skipped = type(error).__name__ in ("SkippedError", "Skipped")  # its former name
            said = str(error) if skipped else f"{type(error).__name__}: {error}"
            results.append(("skipped" if skipped else "failed", said))
        seconds += time.process_time() - start
    return {"file": file, "results": results, "seconds": seconds}


def _function(name: str, parameters: dict[str, Any]) -> tuple[Callable[[Any], Any], str | None]:
    """Return the triangulator as a function of a polygon, and the file that it is in."""
    module, colon, attribute = name.partition(":")
    try:
        import triangulators
    except ImportError:  # an environment with the user's code alone
        return getattr(importlib.import_module(module), attribute), _file_of(module)
    own = module in triangulators.names()
    file = _file_of("triangulators" if own or not colon else module)
    terms = parameters.pop("calibration", None)
    if terms is not None:
        name = module  # the criterion is given apart
        parameters["criterion"] = triangulators.criteria.calibrated(dict(terms))
    return lambda polygon: triangulators.triangulate(polygon, name, **parameters), file


def _file_of(module: str) -> str | None:
    try:
        return getattr(importlib.import_module(module), "__file__", None)
    except ImportError:
        return None


if __name__ == "__main__":
    main(*sys.argv[1:])
