"""Wavefront OBJ: text, a group for each polygon."""

from __future__ import annotations

from itertools import pairwise

from harness.export.indexed_mesh import Mesh, with_z
from harness.export.single import fits, in_single
from harness.export.writer import About, AttributeTable
from harness.stored.output import Output


class ObjWriter:
    """Groups are called feature_0, feature_1, ...; attributes go to a CSV file beside.

    Single precision, which most viewers use, holds the coordinates exactly. If it is too coarse,
    because the polygons lie far from their origin, the coordinates are the source's own.
    """

    def __init__(self, output: Output, about: About) -> None:
        self._stream = output.file(mode="w")
        self._stream.write(f"# raster-harness, {about.triangulator}, units: {about.units}\n")
        if about.credit:
            self._stream.write(f"# {about.credit}\n")
        self._table = AttributeTable(output)
        self._vertices = 0
        self._features = 0

    def add(self, mesh: Mesh) -> None:
        """Write one more batch."""
        if fits(mesh.vertices):
            mesh = in_single(mesh)
        points = with_z(mesh.vertices).tolist()
        self._stream.write("".join([f"v {x!r} {y!r} {z!r}\n" for x, y, z in points]))
        faces = (mesh.triangles + 1 + self._vertices).tolist()
        starts = mesh.triangle_starts.tolist()
        lines = []
        for number, (start, end) in enumerate(pairwise(starts)):
            lines.append(f"g feature_{self._features + number}\n")
            lines += [f"f {a} {b} {c}\n" for a, b, c in faces[start:end]]
        self._stream.write("".join(lines))
        self._table.add(mesh.attributes)
        self._vertices += len(points)
        self._features += mesh.polygons

    def finish(self) -> None:
        """Nothing is left to write."""
