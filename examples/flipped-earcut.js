// earcut with flips; build.mjs replaces the package "earcut" by this module.

import earcut from "earcut";
import flip from "flip-triangles";

export default function flippedEarcut(data, holeIndices, dimensions = 2) {
    const triangles = earcut(data, holeIndices, dimensions);
    flip(triangles, data, {dimensions});
    return triangles;
}
