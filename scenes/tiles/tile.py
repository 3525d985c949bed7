"""One map tile: its layers, and what of each can be drawn."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from scenes.readers import damage
from scenes.scene import Note
from scenes.tiles.archive import Archive
from scenes.tiles.usable import Usable, usable
from scenes.tiles.vector_tile import layer_of, layers_of


class Read(NamedTuple):
    """A layer that was asked for: its name, its extent, and its polygons."""

    name: str
    extent: int
    usable: Usable


@dataclass
class Parts:
    """What was read of a tile.

    layers : of those that were asked for
    known : names of all layers
    damage : why the tile cannot be read, or ""
    damaged : (layer, why) of layers that cannot be read
    absent : whether the archive has no such tile
    """

    layers: list[Read] = field(default_factory=list)
    known: list[str] = field(default_factory=list)
    damage: str = ""
    damaged: list[Note] = field(default_factory=list)
    absent: bool = False


def parts_of(archive: Archive, name: Any, wanted: Collection[str] | None, pixels: int) -> Parts:
    """Read a tile of an archive; of a layer that is damaged, nothing is kept.

    wanted : names of layers, beside those without one; None for all
    pixels : a tile's side on the screen
    """
    parts, notes = Parts(), list[Note]()
    with damage.noted(notes, "", "cannot be read"):
        there = archive.read(name)
        parts.absent = there is None
        found = layers_of(there or b"")
        parts.known = [each for each in found if each]
        for each, pieces in found.items():
            if wanted is None or each in ("", *wanted):
                with damage.noted(parts.damaged, each, "cannot be read"):
                    layer = layer_of(each, pieces)
                    parts.layers.append(Read(each, layer.extent, usable(layer, pixels)))
    parts.damage = notes[0][1] if notes else ""
    return parts
