// Flips for three.js: its shapes and extrusions are then triangulated with fewer helper lanes.

import flip from "./flip-triangles.js";

/**
 * Let ShapeUtils.triangulateShape, which ShapeGeometry and ExtrudeGeometry call, flip what it returns.
 *
 * @param {{triangulateShape: Function}} ShapeUtils three.js's, changed in place
 * @param {{by?: "l1" | "euclidean" | "delaunay"}} [options] what a flip must lessen: "euclidean"
 *     where it is left out, since what three.js draws is turned
 * @returns {() => void} puts the function back that was there
 */
export default function flipShapes(ShapeUtils, {by = "euclidean"} = {}) {
    const original = ShapeUtils.triangulateShape;
    ShapeUtils.triangulateShape = (contour, holes) => {
        // It takes away a last point that repeats the first, so points are counted afterwards.
        const faces = original.call(ShapeUtils, contour, holes);
        const triangles = faces.flat(), vertices = [contour, ...holes].flat().flatMap(({x, y}) => [x, y]);
        flip(triangles, vertices, {by});
        return faces.map((_, i) => triangles.slice(3 * i, 3 * i + 3));
    };
    return () => {
        ShapeUtils.triangulateShape = original;
    };
}
