"""Write figures, charts and generated parts of the documents anew; tells which figures changed.

.venv/bin/python scripts/documents.py
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from docs.generate import filled
from docs.held import ROOT, differences, written
from docs.held.charts import CHARTS, svg
from docs.held.documents import DOCUMENTS

if __name__ == "__main__":
    for name, held in DOCUMENTS.items():
        file = ROOT / name
        before = file.read_text(encoding="utf-8")
        after = written(before, held)
        for line in differences(before, held):
            print(f"{name}: {line}")
        if after != before:
            file.write_text(after, encoding="utf-8")
    for page in (ROOT / "docs").rglob("*.md"):
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")
    for name, draw in CHARTS.items():
        (ROOT / "docs" / "images" / f"{name}.svg").write_text(svg(draw), encoding="utf-8")
