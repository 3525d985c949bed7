"""Outlines of a font: many small polygons with curves and holes, as text renderers fill them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib import font_manager, ft2font
from numpy.typing import NDArray

from scenes.cleaning.clean import Cleaned, clean, filled, moved
from scenes.readers.guard import existing, noted, reason
from scenes.scene import Note, Scene, SceneError

_LETTERS = [
    *range(0x21, 0x7F),
    *range(0xA1, 0x100),
    *range(0x391, 0x3A2),
    *range(0x3A3, 0x3CA),
    *range(0x410, 0x450),
]
"""Printable characters of the Latin, Greek and Cyrillic alphabets."""

_COLUMNS = 24
_MOVE, _LINE, _QUADRATIC, _CUBIC = 1, 2, 3, 4  # matplotlib's path codes


def build(*, seed: int = 0, font: str = "", text: str = "", steps: int = 4) -> Scene:  # noqa: ARG001
    """The glyphs of `text`, set in one line, or of 340 letters and signs, set in a table.

    `font` is a path to a TrueType or OpenType file (default: DejaVu Sans, which comes with
    matplotlib); `steps` is the number of straight pieces a curve is drawn with. Coordinates are
    font units. A glyph of several separate pieces gives several polygons. Raises SceneError for a
    font that cannot be read and a text without any outline.
    """
    if not 1 <= steps <= 100:
        raise SceneError(f"glyphs: steps={steps} is out of range: give 1 to 100")
    path = font or font_manager.findfont("DejaVu Sans")
    face = _face(path)
    characters = text or "".join(map(chr, _LETTERS))
    polygons: list[shapely.Polygon] = []
    repaired: list[Note] = []
    dropped: list[Note] = []
    x, line = 0.0, 1.25 * face.units_per_EM
    for number, character in enumerate(characters):
        if face.get_char_index(ord(character)) == 0:
            dropped.append((f"character {character!r}", f"has no glyph in {Path(path).name}"))
            continue
        with noted(dropped, f"character {character!r}", f"cannot be read from {Path(path).name}"):
            cleaned, advance = outline(face, character, steps)
            repaired += cleaned.repaired
            dropped += cleaned.dropped
            row, column = divmod(number, _COLUMNS)
            at = (x, 0.0) if text else (column * line, -row * line)
            polygons += [moved(p, *at) for p in cleaned.polygons]
            x += advance
    if not polygons:
        raise SceneError(f"glyphs: text {text!r} has no outline in {path}: give other characters")
    return Scene(
        name="glyphs",
        polygons=polygons,
        units="font units",
        description=f"glyph outlines of {face.family_name}",
        licence="the font's; DejaVu fonts are free to use (Bitstream Vera licence)",
        credit="DejaVu fonts" if not font else face.family_name,
        parameters={"font": font, "text": text, "steps": steps},
        dropped=dropped,
        repaired=repaired,
    )


def _face(path: str) -> ft2font.FT2Font:
    try:
        return ft2font.FT2Font(str(existing(path)))
    except (OSError, RuntimeError) as error:
        raise SceneError(f"{path} is not a font that FreeType reads: {reason(error)}") from error


def outline(face: ft2font.FT2Font, character: str, steps: int) -> tuple[Cleaned, float]:
    """Polygons of one glyph in font units, and its advance width."""
    glyph = face.load_char(ord(character), flags=ft2font.LoadFlags.NO_SCALE)
    vertices, codes = face.get_path()
    # FreeType's unit is 1/64 pixel, and unscaled outlines are in font units
    contours = _contours(np.asarray(vertices) * 64.0, np.asarray(codes), steps)
    return clean(filled(contours), [f"glyph {character!r}"]), float(glyph.horiAdvance)


def _contours(vertices: NDArray[Any], codes: NDArray[Any], steps: int) -> list[NDArray[Any]]:
    """Closed rings with curves cut into `steps` chords."""
    contours: list[list[Any]] = []
    t = np.linspace(0, 1, steps + 1)[1:, None]
    i = 0
    while i < len(codes):
        if codes[i] == _MOVE:
            contours.append([vertices[i]])
        elif codes[i] == _LINE:
            contours[-1].append(vertices[i])
        elif codes[i] == _QUADRATIC:
            a, (b, c) = contours[-1][-1], vertices[i : i + 2]
            contours[-1].extend((1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c)
            i += 1
        elif codes[i] == _CUBIC:
            a, (b, c, d) = contours[-1][-1], vertices[i : i + 3]
            first, second = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b, 3 * t**2 * (1 - t) * c
            contours[-1].extend(first + second + t**3 * d)
            i += 2
        i += 1
    return [np.array(c) for c in contours if len(c) >= 3]
