// Flips for three.js: shapes and extrusions with fewer helper invocations.

import flip from "./flip-triangles.js";

/**
 * Replace ShapeUtils.triangulateShape, which ShapeGeometry and ExtrudeGeometry call, by a version that
 * flips diagonals.
 *
 * @param {{triangulateShape: Function}} ShapeUtils of three.js, changed in place
 * @param {{by?: "l1" | "euclidean" | "delaunay"}} [options] the value that a flip must reduce;
 *     "euclidean" by default, because three.js scenes rotate
 * @returns {() => void} a function that restores the original
 */
export default function flipShapes(ShapeUtils, {by = "euclidean"} = {}) {
    const original = ShapeUtils.triangulateShape;
    ShapeUtils.triangulateShape = (contour, holes) => {
        // triangulateShape removes a last point that repeats the first, so read the points afterwards.
        const faces = original.call(ShapeUtils, contour, holes);
        const triangles = faces.flat(), vertices = [contour, ...holes].flat().flatMap(({x, y}) => [x, y]);
        flip(triangles, vertices, {by});
        return faces.map((_, i) => triangles.slice(3 * i, 3 * i + 3));
    };
    return () => {
        ShapeUtils.triangulateShape = original;
    };
}
