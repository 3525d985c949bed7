"""Draw a comparison's Markdown as a comment on a pull request, in headless Chromium.

    PYTHONPATH=. python scripts/comment_picture.py compare.md docs/images/ci-comment.png

`raster-harness compare BASE HEAD --markdown compare.md` writes the file.
"""

import argparse
import tempfile
from pathlib import Path

from markdown_it import MarkdownIt

from tests.chromium import LOADED, Chromium

WIDTH_PX = 860

PAGE = """<!doctype html><meta charset="utf-8"><style>
body {{ margin: 12px; font: 14px/1.5 system-ui, sans-serif; color: #1f2328; background: #fff; }}
article {{ border: 1px solid #d1d9e0; border-radius: 6px; overflow: hidden; }}
header {{ padding: 8px 16px; background: #f6f8fa; border-bottom: 1px solid #d1d9e0; }}
main {{ padding: 0 16px; }}
table {{ border-collapse: collapse; margin: 12px 0; font-size: 13px; }}
th, td {{ border: 1px solid #d1d9e0; padding: 4px 10px; }}
tr:nth-child(even) td {{ background: #f6f8fa; }}
details {{ margin: 12px 0; }}
</style><article><header><b>github-actions</b> commented</header><main>{comment}</main></article>"""


def main() -> None:
    """Render the Markdown file of the first argument to the PNG file of the second."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("markdown", type=Path)
    parser.add_argument("picture", type=Path)
    options = parser.parse_args()
    parser_of_comments = MarkdownIt("commonmark", {"html": True}).enable("table")
    comment = parser_of_comments.render(options.markdown.read_text(encoding="utf-8"))
    browser = Chromium()
    try:
        with tempfile.TemporaryDirectory() as folder:
            page = Path(folder) / "comment.html"
            page.write_text(PAGE.format(comment=comment), encoding="utf-8")
            browser.resize(WIDTH_PX, 100)
            browser.open(page, LOADED)
            browser.resize(WIDTH_PX, browser.evaluate("document.documentElement.scrollHeight"))
            browser.screenshot(options.picture, full_page=False)
    finally:
        browser.close()


if __name__ == "__main__":
    main()
