// earcut, then flips: built into a program in place of the package "earcut", see build.mjs.

import earcut from "earcut";
import flip from "flip-triangles";

export default function flippedEarcut(data, holeIndices, dimensions = 2) {
    const triangles = earcut(data, holeIndices, dimensions);
    flip(triangles, data, {dimensions});
    return triangles;
}
