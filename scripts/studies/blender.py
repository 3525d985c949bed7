"""Compare flips by beauty with Blender's own: the same polygons, by both.

    pip install --target FOLDER --no-deps bpy==5.0.1
    PYTHONPATH=.:FOLDER python scripts/studies/blender.py > results/reference/blender-beauty.csv

Blender is run, not read. It has the rule in two places: Beautify Faces rotates edges of triangles
that are there, and is given ear clipping's; Triangulate Faces cuts a polygon by itself. Prints a
line of CSV for each scene and operator: how many polygons, of how many all triangles are those of
`flips:beauty`, and by which part Blender's sum of area over perimeter is larger: the mean, least
and most of a polygon. Its order of flips is its own, so equal triangles are not asked for.
"""

from collections.abc import Iterator

import bpy
import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from harness.frame import View, make_frame
from harness.study.subjects import evenly
from scenes import load
from triangulators import criteria, triangulate, vertices

SCENES = {"city": 250, "glyphs": 125, "counties": 125}
FEWEST_VERTICES = 5  # of fewer, one flip at most decides


def by_blender(operator: str, polygon: Polygon) -> NDArray[np.int32]:
    """Return the (m, 3) triangles that an operator of Blender's makes; no holes."""
    import bmesh  # is there once bpy is loaded

    points = vertices(polygon)
    faces = triangulate(polygon, "ear-clipping").tolist()
    mesh = bmesh.new()
    try:
        corners = [mesh.verts.new((x, y, 0.0)) for x, y in points.tolist()]
        mesh.verts.index_update()
        for face in faces if operator == "beautify" else [range(len(points))]:
            # A face is cut in the plane of its normal.
            mesh.faces.new([corners[k] for k in face]).normal_update()
        if operator == "beautify":
            inner = [edge for edge in mesh.edges if len(edge.link_faces) == 2]
            bmesh.ops.beautify_fill(mesh, faces=mesh.faces[:], edges=inner, method="AREA")
        else:
            bmesh.ops.triangulate(mesh, faces=mesh.faces[:], ngon_method="BEAUTY")
        found = [[corner.index for corner in face.verts] for face in mesh.faces]
        return np.array(found, dtype=np.int32)
    finally:
        mesh.free()


def chosen(scene: str, most: int) -> Iterator[Polygon]:
    """Yield polygons without holes, at steps through sizes, each as large as 1024 px.

    They are snapped to 1/256 px, which Blender's single precision holds exactly.
    """
    simple = [each for each in load(scene).polygons if not each.interiors]
    sizes = np.array([len(each.exterior.coords) - 1 for each in simple])
    fit = np.flatnonzero(sizes >= FEWEST_VERTICES)
    for number in evenly(fit[np.argsort(sizes[fit], kind="stable")].tolist(), most):
        yield from make_frame([simple[number]], View(1024)).polygons


def main() -> None:
    """Compare and print."""
    total = criteria.find("beauty").total
    print("scene,operator,blender,polygons,same,mean,least,most")
    for scene, most in SCENES.items():
        polygons = list(chosen(scene, most))
        for operator in ("beautify", "triangulate"):
            same, parts = 0, []
            for polygon in polygons:
                ways = [triangulate(polygon, "flips:beauty"), by_blender(operator, polygon)]
                sets = [{frozenset(each) for each in way.tolist()} for way in ways]
                same += sets[0] == sets[1]
                ours, theirs = (total(vertices(polygon), way) for way in ways)
                parts.append(theirs / ours - 1.0)
            figures = f"{len(parts)},{same},{np.mean(parts):.3g},{min(parts):.3g},{max(parts):.3g}"
            print(f"{scene},{operator},{bpy.app.version_string},{figures}", flush=True)


if __name__ == "__main__":
    main()
