"""SVG drawings: polygons cover the area that resvg draws, and unsupported elements are named."""

# ruff: noqa: E501 - drawings are easier to read in one line

import io
from pathlib import Path

import numpy as np
import pytest
import resvg_py
import shapely
from matplotlib import image

from scenes import load
from tests.scenes.conftest import assert_valid_polygons, require_error, write_file

NAMESPACE = 'xmlns="http://www.w3.org/2000/svg"'
SQUARE = '<rect id="square" width="20" height="20"/>'
CLIP = '<clipPath id="k"%s><rect width="30" height="30"/>%s</clipPath>'
BOX_CLIP = (CLIP % (' clipPathUnits="objectBoundingBox"', "")).replace("30", ".5")
CLIPPED = '<rect width="50" height="40" clip-path="url(#k)"/>'
NESTED = '<svg x="10" y="20" width="50" height="30" viewBox="0 0 10 10"%s>%s</svg>'
RADII = ('rx="15"', 'ry="15"', 'rx="15" ry="0"', 'rx="50" ry="10"', 'rx="-5" ry="9"')
TRANSPARENT = ("none", "transparent", "rgba(1,2,3,0)", "#1230", "#12345600")
TRANSPARENT += ("url(#no) none", "url(#no)")


def read(folder: Path, body: str, size: str = 'width="100" height="100"'):
    return load(write_file(folder / "a.svg", f"<svg {NAMESPACE} {size}>{body}</svg>"))


@pytest.mark.parametrize(
    "body",
    [
        '<rect x="1" y="2" width="4" height="3"/>',
        *(f'<rect width="60" height="40" {radii}/>' for radii in RADII),
        '<rect x="10%" width="50%" height="25%"/><circle cx="80" cy="80" r="10%"/>',
        '<ellipse cx="50" cy="50" rx="20"/><ellipse cx="20" cy="20" rx="9" ry="15"/>',
        '<polygon points="50,5 20,90 95,35 5,35 80,90"/>',
        '<polygon points="50,5 70,91 15,22 94,60 6,60 85,22 30,91"/>',
        '<polygon points="10-9.5.5,80 70 80 70,.5 7"/>',
        '<polygon fill-rule="evenodd" points="50,5 20,90 95,35 5,35 80,90"/>',
        '<path d="M0 0H90V90H0Z M10 10H80V80H10Z M30 30V70H70V30Z"/>',
        '<path style="fill-rule: evenodd" d="M0 0h80v80h-80z m40 40h80v80h-80z"/>',
        '<path d="M0 0 C 0 40 40 40 40 0 Z"/><path d="M50 50 Q 70 90 90 50 Z"/>',
        '<path d="m25 5a30 30 0 1160 0z"/>',
        '<rect width="3" height="3" transform="matrix(10 0 0 10 20-10)"/>',
        '<rect width="9" height="9" transform="translate(10,20)scale(5)rotate(-30.5.5,.5)skewX(9)"/>',
        '<g transform="translate(5 0) scale(2)"><rect width="9" height="9" transform="rotate(30)"/></g>',
        *(
            f'<rect x="40" y="40" width="20" height="9" transform="rotate(30)" transform-origin="{o}"/>'
            for o in ("50 50", "center", "20px", "center left", "left bottom", "top", "top 20%")
        ),
        NESTED % ("", '<rect width="90%" height="100%"/>'),
        NESTED % (' preserveAspectRatio="xMinYMax slice"', '<rect width="8" height="10"/>'),
        NESTED % (' preserveAspectRatio="none"', '<rect width="8" height="9"/>'),
        NESTED % (' overflow="visible"', '<rect width="12" height="12"/>'),
        CLIP % ("", "") + CLIPPED,
        CLIP % ("", '<circle cx="40" cy="30" r="9"/>')
        + '<g clip-path="url(#k)" transform="translate(5 5)"><rect width="50" height="50"/></g>',
        CLIP % (' transform="scale(.5) translate(9)"', "") + CLIPPED,
        CLIP % (' display="none"', "") + CLIPPED,
        '<clipPath id="j"><path clip-rule="evenodd" d="M0 0h20v20h-20z m5 5h9v9h-9z"/></clipPath>'
        + CLIP % (' clip-path="url(#j)"', "")
        + CLIPPED,
        BOX_CLIP + CLIPPED,
        BOX_CLIP + '<rect width="0" height="9" clip-path="url(#k)"/>' + SQUARE,
        '<clipPath id="k"/>' + CLIPPED + SQUARE,
        CLIPPED,  # by a missing path, which has no effect
        '<x:g xmlns:x="x"><rect width="90" height="9"/></x:g><x:rect xmlns:x="x" width="90"/>'
        + SQUARE,
        '<blob><rect width="90" height="90"/></blob><symbol><rect width="90"/></symbol>' + SQUARE,
        '<g opacity="0"><rect width="50" height="50"/></g>' + SQUARE,
        '<g fill-opacity="0"><rect width="50" height="50"/><rect fill-opacity="1" width="9" height="9"/></g>',
        *(f'<rect width="50" height="50" fill="{colour}"/>{SQUARE}' for colour in TRANSPARENT),
        '<g visibility="hidden"><rect width="50" height="50"/><rect visibility="visible" width="9" height="9"/></g>',
        '<a href="#"><rect width="9" height="9"/></a>',
        '<switch><title>x</title><rect requiredExtensions="x" width="9" height="9"/>'
        '<rect systemLanguage="fr" width="50" height="50"/><g><rect systemLanguage="en-US" width="20"'
        ' height="9"/></g><rect width="50" height="50"/></switch>',
    ],
)
def test_polygons_cover_the_area_that_resvg_draws(tmp_path, body):
    scene = read(tmp_path, body)
    assert_valid_polygons(scene.polygons)
    drawing = (tmp_path / "a.svg").read_text()
    png = bytes(resvg_py.svg_to_bytes(svg_string=drawing, zoom=4, languages=["en"]))
    alpha = image.imread(io.BytesIO(png))[..., 3]
    drawn = alpha.sum() / 16
    visible = shapely.union_all(scene.polygons).intersection(shapely.box(0, -100, 100, 0))
    # Eight chords replace a curve.
    relative = 0.025 if " C " in body else 0.005 if "polygon" in body else 0.01
    absolute = 0.0 if "polygon" in body else 0.7
    assert visible.area == pytest.approx(drawn, rel=relative, abs=absolute)
    y, x = (np.average(np.indices(alpha.shape), axis=(1, 2), weights=alpha) + 0.5) / 4
    assert (visible.centroid.x, -visible.centroid.y) == pytest.approx((x, y), abs=0.3)


@pytest.mark.parametrize(
    "style",
    [
        "transform: translate(20px, 10px) scale(5)",
        "transform: translateX(20px) translateY(10px) scaleX(5) scaleY(5)",
        "width: 15px; height: 15px",
        "width: 30px; height: 30px; clip-path: url(#k)",
    ],
)
def test_properties_of_css(tmp_path, style):
    (polygon,) = read(tmp_path, BOX_CLIP + f'<rect width="3" height="3" style="{style}"/>').polygons
    assert polygon.area == pytest.approx(225)
    assert polygon.bounds[0] == (20 if "translate" in style else 0)


def test_units_are_absolute(tmp_path):
    (polygon,) = read(tmp_path, '<rect width="25.4mm" height="0.5in"/>', "").polygons
    assert polygon.bounds == pytest.approx((0, -48, 96, 0))


def test_attributes_and_the_direction_of_y(tmp_path):
    inner = '<rect id="r" x="1" width="4" height="3"/>'
    body = f'<g transform="translate(5 0) scale(2)"><g transform="rotate(90)">{inner}</g></g>'
    scene = read(tmp_path, body)
    # (1..5, 0..3) is rotated to (-3..0, 1..5), doubled, moved to (-1..5, 2..10), and flipped.
    assert scene.polygons[0].bounds == pytest.approx((-1, -10, 5, -2))
    assert list(scene.attributes["id"]) == ["r"]
    assert scene.notes == ("y points up: the drawing's y is negated",)


def test_unfilled_and_unsupported_elements_are_named(tmp_path):
    shape = '<rect id="%s" width="2" height="2" %s/>'
    body = "".join(
        [
            shape % ("plain", ""),
            *(
                shape % item
                for item in {
                    "has no fill": 'fill="none"',
                    "has no fill!": 'style="fill: none !important"',
                    "is transparent": 'opacity="0%"',
                    "has a transparent fill": 'fill="rgb(1 2 3 / 0%)"',
                    "lies outside the clip path": 'clip-path="url(#k)"',
                    "cannot be read as SVG: transform translateX(2) is unknown": 'transform="translateX(2)"',
                    "cannot be read as SVG: transform spin(3": 'transform="spin(3)"',
                    "cannot be read as SVG: the clip path has a use": 'clip-path="url(#u)"',
                    "cannot be read as SVG: length": 'x="2em"',
                    "cannot be read as SVG: clip-path 'inset(1px)' is": 'style="clip-path: inset(1px)"',
                }.items()
            ),
            '<g display="none">' + shape % ("is not displayed", 'display="inline"') + "</g>",
            '<g visibility="hidden">' + shape % ("is not visible", "") + "</g>",
            '<g id="cannot be read as SVG: transform" transform="x">' + SQUARE + "</g>",
            '<path id="cannot be read as SVG: Not enough" d="M0 0 L 1"/>',
            '<clipPath id="k"><rect x="50" width="9" height="9"/></clipPath>',
            '<clipPath id="u"><use href="#plain"/></clipPath>',
            '<use id="is a reference to another element"/><text id="is text">A<tspan>b</tspan></text>',
            '<flowRoot id="is text!"><flowRegion><rect width="9" height="9"/></flowRegion></flowRoot>',
            '<image id="is an image" href="a.png"/><line id="is a line" x2="9"/>',
            '<foreignObject id="is not SVG"/>',
        ]
    )
    scene = read(tmp_path, body)
    assert list(scene.attributes["id"]) == ["plain"]
    assert len(scene.dropped) == body.count(" id=") - 4
    for label, reason in scene.dropped:
        expected = label.partition(" ")[2].rstrip("!")
        assert reason.startswith(expected), label
    notes = read(tmp_path, f'<style>.a {{fill: none}}</style><g mask="url(#m)">{body}</g>').notes
    assert "<style> is ignored" in notes[1]
    assert "masks are ignored" in notes[2]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<svg", "cannot be read as SVG"),
        ("<html/>", "its root is html"),
        ("<svg/>", "holds no polygon"),
        ('<svg><g transform="spin(3)"><rect/></g></svg>', r"spin\(3\) is unknown"),
    ],
)
def test_errors(tmp_path, text, message):
    require_error(message, write_file(tmp_path / "a.svg", text))
