"""The examples that `--help` shows; a test runs each of them."""

from __future__ import annotations

PROGRAM = "python -m harness"
RUN = "results/city-20260101-120000"
LATER = "results/city-20260102-120000"

EXAMPLES: dict[str, tuple[str, ...]] = {
    "run": (
        "run --scene city",
        "run --scene buildings.geojson --triangulators delaunay,optimal:half-perimeter",
        "run --scene city:buildings=50 --resolution 256,512 --rotation 0,30 --quick",
    ),
    "validate": ("validate --scene city --quick",),
    "calibrate": ("calibrate --scene city:buildings=50 --budget 0.05",),
    "compare": (
        f"compare {RUN} {LATER}",
        f"compare {RUN} {LATER} --gate counters --html comparison.html",
    ),
    "history": ("history results",),
    "report": (
        f"report {RUN}",
        f"report {RUN} --out city.html",
    ),
    "enumerate": ("enumerate --scene paper --mode paper",),
    "inspect": ("inspect --scene city --polygon 3 --out polygon-3.png",),
    "triangulate": ("triangulate buildings.geojson --criterion overdraw -o buildings.glb",),
    "pareto": (
        "pareto --scene paper",
        "pareto --scene city --polygons 4 --budget 0.2",
    ),
    "gains": (f"gains {RUN} --out results/gains",),
    "repeat": (f"repeat {RUN} {RUN}",),
    "study": ("study buildings.geojson --out results/study --quick",),
    "page": (f"page {RUN} --out city.html",),
    "import": ("import saved-by-the-page.json --out results/phone",),
    "census": ("census buildings.geojson --out results/census",),
    "merge": (f"merge {RUN} {LATER} --hosts first,second --out results/merged",),
    "doctor": ("doctor",),
    "list": ("list triangulators", "list scenes"),
    "cache": ("cache info",),
}
