// Flip the triangles of polygons in a folder (see languages.py) and write the results.

import {readFileSync, writeFileSync} from "node:fs";
import {pathToFileURL} from "node:url";
import {join} from "node:path";
import flip from "../../ports/javascript/flip-triangles.js";

const [folder, earcut] = process.argv.slice(2);
const read = (name, Kind) => {
    const bytes = readFileSync(join(folder, name));
    return new Kind(bytes.buffer, bytes.byteOffset, bytes.byteLength / Kind.BYTES_PER_ELEMENT);
};
const points = read("points.f64", Float64Array), triangles = read("triangles.i32", Int32Array);
const bounds = read("bounds.i32", Int32Array);

/** Apply `change(indices, coordinates)` to the triangles of each polygon; write them and the counts. */
function writeAll(name, change) {
    const result = triangles.slice(), counts = [];
    for (let i = 2; i < bounds.length; i += 2) {
        const [first, begin, last, end] = bounds.subarray(i - 2, i + 2);
        const indices = Array.from(triangles.subarray(begin, end));
        counts.push(change(indices, points.subarray(2 * first, 2 * last)) ?? 0);
        result.set(indices, begin);
    }
    writeFileSync(join(folder, `javascript-${name}.i32`), result);
    writeFileSync(join(folder, `javascript-${name}-counts.i32`), Int32Array.from(counts));
}

for (const by of ["l1", "euclidean", "delaunay"]) {
    writeAll(by, (indices, coordinates) => flip(indices, coordinates, {by}));
}
for (const scale of [0.125, 1, 3.7]) {
    writeAll(`quads@${scale}`, (indices, coordinates) => flip(indices, coordinates, {by: "quads", scale}));
}
writeAll("l1-native", (indices, coordinates) => flip(indices, coordinates, {order: "native"}));
writeAll("reorder", (indices, coordinates) => flip.reorder(indices, coordinates.length / 2));
// The same with typed indices and vertices of three numbers in an array.
writeAll("l1-typed", (indices, coordinates) => {
    const typed = Uint32Array.from(indices), solid = [];
    for (let i = 0; i < coordinates.length; i += 2) solid.push(coordinates[i], coordinates[i + 1], NaN);
    const flips = flip(typed, solid, {dimensions: 3});
    for (let i = 0; i < typed.length; i++) indices[i] = typed[i];
    return flips;
});
if (earcut) {
    const {refine} = await import(pathToFileURL(earcut));
    writeAll("earcut-refine", (indices, coordinates) => refine(indices, coordinates));
}
