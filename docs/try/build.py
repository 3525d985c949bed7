"""Build docs/try.html, a single file that needs no network: `python docs/try/build.py`.

The page contains npm's earcut, the flips of ports/javascript, style, elements.js and spans.js of
reports, the page that measures a device (compressed), and the scripts in this folder.
"""

import base64
import gzip
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import pandas as pd
import shapely

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from docs.figures import compute
from scenes import load

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
FILE = HERE.with_suffix(".html")
PORT = ROOT / "ports" / "javascript"
EARCUT = PORT / "node_modules" / "earcut"

STYLES = (ROOT / "harness/report/static/report.css", HERE / "page.css")
GEOMETRY = (
    EARCUT / "dist/earcut.min.js",
    PORT / "flip-triangles.cjs",
    ROOT / "harness/report/static/spans.js",
    *(HERE / f"{name}.js" for name in ("validity", "svg", "polygon", "triangles", "answer")),
)
"""Scripts that use no elements of the page, in the order of their dependencies."""

VIEW = (HERE / "view.js", HERE / "main.js")
ELEMENTS = ROOT / "harness/report/static/elements.js"

SAVINGS = ROOT / "results" / "reference" / "polygon-savings-city.csv"
BASE, OPTIMUM = "ear-clipping", "optimal:expected-quads"

EXAMPLES = (
    ("A footprint that gains much", "city", 438),
    ("A letter", "glyphs:text=S", 0),
    ("A county", "counties", 5),
    ("Nine vertices", "paper", 0),
)
"""Name, scene and index of each example except the first, the typical footprint."""

EXAMPLE_PX = 64
"""Side of the viewport of these examples."""

SCENES = {"city": "city", "helsinki": "Helsinki", "glyphs": "letters", "counties": "counties"}
"""Scenes whose total saving the page reports, with their labels."""


def render_page() -> str:
    """Return the text of docs/try.html."""
    number, size, sentence = choose_typical()
    examples = [
        (name, shapely.to_wkt(polygon, rounding_precision=3), px)
        for name, scene, index, px in (
            ("A typical footprint", "city", number, size),
            *((*example, EXAMPLE_PX) for example in EXAMPLES),
        )
        for polygon in [load(scene, attributes=False).polygons[index]]
    ]
    data = (
        f"const EXAMPLES = {json.dumps(examples, ensure_ascii=False)};\n"
        f"const PROFILE = {json.dumps(pack_profile_page())};"
    )
    parts = {
        "style": join_files(*STYLES),
        "scenes": describe_scenes(),
        "typical": sentence,
        "earcut": json.loads((EARCUT / "package.json").read_text())["version"],
        "script": f"{join_files(*GEOMETRY, ELEMENTS)}\n{data}\n{join_files(*VIEW)}",
    }
    text = (HERE / "page.html").read_text()
    for name, part in parts.items():
        text = text.replace(f"{{{{ {name} }}}}", part.replace("</script", "<\\/script"))
    return text


def join_files(*files: Path) -> str:
    """Return the concatenated texts of files."""
    return "\n".join(file.read_text().strip() for file in files)


def choose_typical() -> tuple[int, int, str]:
    """Return a polygon of the city with the median saving, and a sentence about its scene.

    Returns the polygon's number, and the side in px of a viewport that shows it as large as in the
    scene.
    """
    table = pd.read_csv(SAVINGS)
    saved = 1.0 - table[OPTIMUM] / table[BASE]
    distance = (saved - saved.median()).abs()
    row = table.assign(distance=distance).sort_values(["distance", BASE], ascending=[True, False])
    typical = row.index[0]
    number, saving = int(table["polygon"][typical]), saved[typical]
    polygon = load("city", attributes=False).polygons[number]
    west, south, east, north = polygon.bounds
    # page: the circle about the centre of the bounding box fills the viewport.
    size = round(float(table["scale"][typical]) * math.hypot(east - west, north - south)) + 2
    share, total = (saved >= saving).mean(), 1.0 - table[OPTIMUM].sum() / table[BASE].sum()
    sentence = (
        f"A typical footprint of the city at 1024 px: the optimum for Q saves {100 * saving:.1f} % "
        f"of ear clipping's lanes for this footprint, and {100 * total:.1f} % for the scene. "
        f"{100 * share:.0f} % of the {len(table)} footprints gain at least as much as this one."
    )
    return number, size, sentence


def describe_scenes() -> str:
    """Return the share of lanes saved in each scene, from the results: "5.1 % (city), ..."."""
    figure = "ratio csv llvmpipe/gains-{}/summary.csv quads resolution=1024 triangulator={} :-.1%"
    optimum = "H,ear-clipping"
    shares = [f"{compute(figure.format(key, optimum))} % ({name})" for key, name in SCENES.items()]
    return f"{', '.join(shares[:-1])} and {shares[-1]}"


def pack_profile_page() -> str:
    """Return the page that measures a device, compressed and in base64."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "profile.html"
        command = [sys.executable, "-m", "harness", "page", "--profile", "--out", str(file)]
        subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
        text = file.read_bytes()
    return base64.b64encode(gzip.compress(text, mtime=0)).decode()


if __name__ == "__main__":
    FILE.write_text(render_page())
    print(f"{FILE}: {FILE.stat().st_size:,} bytes")
