"""One map tile: its layers, and what of each can be drawn."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import NamedTuple

from scenes.readers import damage
from scenes.scene import Note
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


def parts_of(
    data: Callable[[], bytes | None], wanted: Collection[str] | None, pixels: int
) -> Parts:
    """Read a tile; of a layer that is damaged, nothing is kept.

    data : gives its bytes, None where there is no such tile; may raise whatever it meets
    wanted : names of layers, beside those without one; None for all
    pixels : a tile's side on the screen
    """
    parts, notes = Parts(), list[Note]()
    with damage.noted(notes, "", "cannot be read"):
        there = data()
        parts.absent = there is None
        found = layers_of(there or b"")
        parts.known = [name for name in found if name]
        for name, pieces in found.items():
            if wanted is None or name in ("", *wanted):
                with damage.noted(parts.damaged, name, "cannot be read"):
                    layer = layer_of(name, pieces)
                    parts.layers.append(Read(name, layer.extent, usable(layer, pixels)))
    parts.damage = notes[0][1] if notes else ""
    return parts
