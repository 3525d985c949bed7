"""Render the figures, tables, charts and generated parts of the documents; print changed files.

.venv/bin/python scripts/documents.py
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from docs.figures import ROOT
from docs.generate import filled, pages
from scripts.charts import CHARTS, render_svg
from scripts.pictures import PICTURES, draw_picture

if __name__ == "__main__":
    files = {page: lambda page=page: filled(page.read_text(encoding="utf-8")) for page in pages()}
    images = ROOT / "docs" / "images"
    files |= {
        images / f"{name}.svg": lambda draw=draw: render_svg(draw) for name, draw in CHARTS.items()
    }
    files |= {
        images / f"{name}.svg": lambda polygon=polygon: draw_picture(*polygon)
        for name, polygon in PICTURES.items()
    }
    for file, text in files.items():
        try:
            rendered = text()
        except ValueError as error:
            raise SystemExit(f"{file.relative_to(ROOT)}: {error}") from error
        if not file.exists() or rendered != file.read_text(encoding="utf-8"):
            print(f"{file.relative_to(ROOT)}: updated")
            file.write_text(rendered, encoding="utf-8")
