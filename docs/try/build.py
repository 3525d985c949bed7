"""Puts docs/try.html together, one file that needs no network: `python docs/try/build.py`.

Its parts: earcut as npm has it, the flips of ports/javascript, the report's style, elements and
exact rasteriser, the page that measures a device, packed, and the page's own scripts, which lie
beside this file.
"""

import base64
import gzip
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import shapely

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

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
    HERE / "polygon.js",
    HERE / "triangles.js",
)
"""What needs no page, in this order."""

ELEMENTS = ROOT / "harness/report/static/elements.js"

EXAMPLES = (
    ("A footprint", "city", 438),
    ("A letter", "glyphs:text=S", 0),
    ("A county", "counties", 5),
    ("Nine corners", "paper", 0),
)
"""Each with its scene, and its number there."""


def page() -> str:
    """Return the text of docs/try.html."""
    examples = [
        (name, shapely.to_wkt(load(scene, attributes=False).polygons[number], rounding_precision=3))
        for name, scene, number in EXAMPLES
    ]
    data = (
        f"const EXAMPLES = {json.dumps(examples, ensure_ascii=False)};\n"
        f"const PROFILE = {json.dumps(profile())};"
    )
    parts = {
        "style": joined(*STYLES),
        "earcut": json.loads((EARCUT / "package.json").read_text())["version"],
        "script": f"{joined(*GEOMETRY, ELEMENTS)}\n{data}\n{joined(HERE / 'main.js')}",
    }
    text = (HERE / "page.html").read_text()
    for name, part in parts.items():
        text = text.replace(f"{{{{ {name} }}}}", part.replace("</script", "<\\/script"))
    return text


def joined(*files: Path) -> str:
    """Return the texts of files, one after the other."""
    return "\n".join(file.read_text().strip() for file in files)


def profile() -> str:
    """Return the page that measures a device, compressed, in base64."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "profile.html"
        command = [sys.executable, "-m", "harness", "page", "--profile", "--out", str(file)]
        subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
        text = file.read_bytes()
    return base64.b64encode(gzip.compress(text, mtime=0)).decode()


if __name__ == "__main__":
    FILE.write_text(page())
    print(f"{FILE}: {FILE.stat().st_size:,} bytes")
